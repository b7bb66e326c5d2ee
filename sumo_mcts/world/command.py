"""From a command to SUMO: a speed every step, lane changes, and SUMO's own driver again at the
end."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.model.motion import HALF, OVERSHOOT
from sumo_mcts.numerics.lanes import against_traffic
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Follow, Release
from sumo_mcts.world.library import running_sumo
from sumo_mcts.world.observe import Change, departure
from sumo_mcts.world.places import Places
from sumo_mcts.world.roadmap import sumo_lane
from sumo_mcts.world.sideways import Aside
from sumo_mcts.world.stops import skip_next
from sumo_mcts.world.wish import Wish

_SLACK = 1e-6  # m/s2: rounding is no trespass
_ALIGNED = 1e-3  # m off the centre line that are no lane change


class Bounds(NamedTuple):
    """The bounds of every command to a vehicle."""

    step: float  # s
    change_duration: float  # s that a lane change takes, 0: SUMO jumps
    accel: float  # m/s2
    decel: float  # m/s2, positive
    jerk: float  # m/s3


class _Own(NamedTuple):
    """The settings that a vehicle had before it was taken over."""

    departure: float  # s; another vehicle of the same id has another one
    speed_mode: int
    lane_change_mode: int
    action_step: float  # s


class Commander:
    """Drives one vehicle.

    SUMO adds no bounds and no safety (speedMode 0, laneChangeMode 0): the bounds here are the last
    line of defence.
    """

    def __init__(
        self, vehicle: str, road: RoadMap, lanes: Mapping[str, int], bounds: Bounds
    ) -> None:
        """`lanes`: lane id -> index in `road`."""
        self._get: Any = running_sumo().vehicle
        self._vehicle, self._road, self._bounds = vehicle, road, bounds
        self._places = Places(running_sumo(), road, lanes)
        self._aside = Aside(running_sumo(), road)
        self._against = against_traffic(road)
        self._profile: Floats = np.zeros(0)
        self._at = 0
        self._own: _Own | None = None  # to be given back; None: SUMO drives
        self._wish = Wish(vehicle)
        self._asks, self._asks_on = 0, -1  # the side asked for, and the lane it is asked from
        self.change = Change()

    def bind(self, bounds: Bounds) -> None:
        """Keep these bounds from now on."""
        self._bounds = bounds

    def accept(self, command: Follow | Release) -> None:
        """Play this from the coming step on."""
        if isinstance(command, Release):
            self.release()
            return
        if self._own is None:
            self._own = self._taken_over()
        self._profile, self._at = command.speeds, 0
        busy = command.lane_change != 0 or self.change.target >= 0 or self._is_aside()
        self._ask(0 if busy else command.asks)
        if command.lane_change != 0:
            self._begin_change(command.lane_change)
        elif command.shift != 0.0 and self.change.target < 0:
            self._aside.shift(self._vehicle, command.shift)
        if command.skips_stop:
            skip_next(self._vehicle)

    @property
    def asks(self) -> int:
        """The side on which others are asked for room now: 1 left, -1 right, 0 neither."""
        return self._asks if self._wish.on else 0

    @property
    def can_ask(self) -> bool:
        """Whether SUMO's model of the vehicle's lane changes knows such a wish."""
        return self._wish.possible

    @property
    def played(self) -> bool:
        """Whether the profile is over."""
        return self._at >= len(self._profile)

    def before_step(self) -> None:
        """Command the step that begins now."""
        if self._own is None:
            return
        if (
            self._get.getSpeedMode(self._vehicle) != 0
            or self._get.getLaneChangeMode(self._vehicle) != self._wish.mode
        ):
            # a state was loaded, or the user set modes: those are to be given back then
            self._own = self._taken_over()
            self._wish.renew()
        v = float(self._get.getSpeed(self._vehicle))
        a = float(self._get.getAcceleration(self._vehicle))
        self._get.setSpeed(self._vehicle, bounded(self._wanted(v, a), v, a, self._bounds))
        self._at += 1
        if self.change.target >= 0:
            self._go_on_changing()

    def skip(self, steps: int) -> None:
        """So many steps were made without a command: SUMO held the speed, and went on changing
        lanes."""
        self._at += steps
        if self.change.target >= 0:
            self._go_on_changing(steps)

    def notice(self) -> None:
        """Find out, after each step of SUMO, whether it began the change that was asked for.

        It may where no other vehicle has to brake. Then no more is asked: the change is under way.
        """
        own = self._own
        if not self._wish.on or own is None or own.departure != departure(self._vehicle):
            return
        lane, side = self._here(), self._asks
        aside = self._is_aside()
        source = self._asks_on
        if lane == source and not aside:
            return
        target = self._beside(source, side)
        self._ask(0)
        # past the middle SUMO has it on the target lane already
        if aside and lane in (source, target):
            self.change = Change(0.0, source, target)
            self._go_on_changing()

    def release(self) -> None:
        """Hand the vehicle back to SUMO, also while it is being teleported, with the modes that it
        was taken over with."""
        own, self._own = self._own, None
        self.change = Change()
        if own is not None and own.departure == departure(self._vehicle):
            self._ask(0)
            self._get.setSpeed(self._vehicle, -1.0)
            self._get.setSpeedMode(self._vehicle, own.speed_mode)
            self._get.setLaneChangeMode(self._vehicle, own.lane_change_mode)
            self._act_every(own.action_step, own)
        self._wish.forget()

    def _taken_over(self) -> _Own:
        """Take the vehicle from SUMO's driver; returns what to give back."""
        get, vehicle = self._get, self._vehicle
        own = _Own(
            departure=get.getDeparture(vehicle),
            speed_mode=get.getSpeedMode(vehicle),
            lane_change_mode=get.getLaneChangeMode(vehicle),
            action_step=get.getActionStepLength(vehicle),
        )
        if self._own is not None and own.action_step <= self._bounds.step + _SLACK:
            own = own._replace(action_step=self._own.action_step)
        get.setSpeedMode(vehicle, 0)
        get.setLaneChangeMode(vehicle, 0)
        self._act_every(self._bounds.step, own)
        return own

    def _act_every(self, seconds: float, own: _Own) -> None:
        """Set how often SUMO lets a vehicle act that acts less often than every step."""
        if own.action_step > self._bounds.step + _SLACK:
            self._get.setActionStepLength(self._vehicle, seconds)

    def _wanted(self, v: float, a: float) -> float:
        """The speed of the profile, m/s.

        Past its end braking goes on, else the speed is kept; no profile at all means stop.
        """
        if self._at < len(self._profile):
            return float(self._profile[self._at])
        return v + min(a, 0.0) * self._bounds.step if len(self._profile) else 0.0

    def _begin_change(self, side: int) -> None:
        """Begin a lane change to the left (1) or right (-1), where there is a lane, or give up the
        one to the other side that is under way."""
        if self._gives_up(side):
            self._go_back()
            return
        source = self._here()
        target = self._beside(source, side)
        if target < 0:
            return
        takes_time = self._bounds.change_duration > 0.0
        # SUMO drops the wish where the change before, begun at a stand, takes one step more than
        # its duration: then it is held for a step.
        held = self._bounds.step if self._is_aside() else 0.0
        if self._against[source] or self._against[target]:  # SUMO has no number for that lane
            outwards = -side if self._road.lefthand else side  # it counts as its lanes do
            self._get.changeLaneRelative(self._vehicle, outwards, held)
        elif self._aside.divided:  # a wish for the lane would be dropped where little room is
            self._aside.shift(self._vehicle, self._apart(source, target))
        else:
            self._get.changeLane(self._vehicle, sumo_lane(self._road, target), held)
        if takes_time:
            self.change = Change(0.0, source, target)

    def _gives_up(self, side: int) -> bool:
        """Whether a change to this side means giving up the one under way to the other side."""
        source, target = self.change.source, self.change.target
        under_way = self._aside.divided and target >= 0 and self._here() == source
        return under_way and self._beside(source, -side) == target

    def _go_back(self) -> None:
        """Give up a change, unless it has come too far: SUMO moves the vehicle to the middle of its
        lane again."""
        source, target, aside = (
            self.change.source,
            self.change.target,
            self._places.of(self._vehicle).d,
        )
        share = 2.0 * abs(aside) / float(self._road.width[source] + self._road.width[target])
        if share < HALF - OVERSHOOT:
            self._aside.shift(self._vehicle, -aside)
            self.change = Change(1.0 - (share + OVERSHOOT), target, source)

    def _apart(self, source: int, target: int) -> float:
        """m to the left from where the vehicle is on one lane to the middle of another, beside."""
        apart = 0.5 * float(self._road.width[source] + self._road.width[target])
        left = apart if self._road.left[source] == target else -apart
        return left - self._places.of(self._vehicle).d

    def _ask(self, side: int) -> None:
        """Ask for room on a side (1 left, -1 right), or no longer (0)."""
        self._asks, self._asks_on = side, self._here() if side != 0 else -1
        self._wish.turn(side != 0)

    def _is_aside(self) -> bool:
        """Whether a lane change that takes time has the vehicle off the middle of its lane."""
        return (
            self._bounds.change_duration > 0.0
            and abs(float(self._get.getLateralLanePosition(self._vehicle))) > _ALIGNED
        )

    def _here(self) -> int:
        """The lane that the vehicle is on, -1: none that is known."""
        return self._places.of(self._vehicle).lane

    def _beside(self, lane: int, side: int) -> int:
        """The lane to the left (1) or right (-1) of a lane, -1: none."""
        return int((self._road.left if side > 0 else self._road.right)[lane]) if lane >= 0 else -1

    def _go_on_changing(self, steps: int = 1) -> None:
        """SUMO moves the vehicle sideways for change_duration; the same clock runs here."""
        progress = self.change.progress + steps * self._bounds.step / self._bounds.change_duration
        if progress >= 1.0 - 1e-9 and self._is_late():
            return
        self.change = self.change._replace(progress=progress) if progress < 1.0 - 1e-9 else Change()

    def _is_late(self) -> bool:
        """Whether the vehicle is still on its way to the middle of its lane: where lanes are
        divided SUMO takes longer for wide ones, and for going back."""
        return self._aside.moves(self._vehicle) and self._is_aside()


def bounded(wanted: float, v: float, a: float, bounds: Bounds) -> float:
    """The speed to command, m/s: `wanted` within what the present speed and acceleration allow.

    A `wanted` that is no number counts as 0.
    """
    low = min(max(a - bounds.jerk * bounds.step, -bounds.decel), bounds.accel) - _SLACK
    high = max(min(a + bounds.jerk * bounds.step, bounds.accel), low) + _SLACK
    wanted = wanted if math.isfinite(wanted) else 0.0
    return max(0.0, min(max(wanted, v + low * bounds.step), v + high * bounds.step))
