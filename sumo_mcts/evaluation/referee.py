"""What really happened to one ego: its outcome, its faults, and which rules it broke.

Judged from the frames that SUMO's states make up, once a simulation step, for any driver of the ego
alike. It does not use what a planner intended. docs/measures.md defines all of it.
"""

from math import inf, isfinite, isnan
from typing import Any

import numpy as np

from sumo_mcts.arrays import Bools, Ints
from sumo_mcts.evaluation.contact import Contact, contacts
from sumo_mcts.evaluation.fault import Conduct, is_at_fault
from sumo_mcts.evaluation.goal import Goal, RouteProgress
from sumo_mcts.evaluation.imposed import IMPOSED, braking_for_ego, lanes_under
from sumo_mcts.evaluation.lights import LightRecord
from sumo_mcts.evaluation.metrics import comfortable_share, events, jerks, rms
from sumo_mcts.evaluation.on_lanes import clear_on_lanes
from sumo_mcts.evaluation.own_side import OwnSide
from sumo_mcts.evaluation.reachability import REACH, Drive, driven, goal_reaching_edges
from sumo_mcts.evaluation.standing import GreenRecord, longest_run
from sumo_mcts.numerics.drawn import drawing
from sumo_mcts.numerics.lanes import limit, with_changes
from sumo_mcts.road import RoadChanges, RoadMap
from sumo_mcts.scene import STANDING, EgoState, Frame

ARRIVED, COLLISION, TELEPORTED, OFF_ROUTE, TIMEOUT, ERROR = (
    "arrived",
    "collision",
    "teleported",
    "off_route",
    "timeout",
    "error",
)
HARD_BRAKE = 4.5  # m/s2
SPEEDING = 0.1  # m/s above the limit
_KNOWN_AFTER_ERROR = ("outcome", "error", "free_flow_s", "in_time", "distance_m")
_EPS = 1e-6


class Referee:
    """Judges one ego.

    Feed it every frame from the take-over on; it answers with the outcome once there is one.
    """

    def __init__(
        self, road: RoadMap, goal: Goal, step: float, take_over: Frame | None = None
    ) -> None:
        """`step` in s. take_over: the state in which the ego was taken over, right after its
        departure; else the first frame observed is it."""
        self._road, self._goal, self._step = road, goal, step
        self._road_now = (RoadChanges(), road)  # the map as it was in the last frame
        self._outcome: str | None = None
        self._error: str | None = None
        self._at_fault: bool | None = None
        self._collided: list[str] = []
        self._last: Frame | None = None
        self._departed = 0.0
        self._finished: float | None = None
        self._route: tuple[int, ...] = ()  # of the ego, as SUMO has it
        self._reaching: Bools = np.zeros(0, np.bool_)  # [edges] that lead to the goal
        self._drawing, self._own_side = drawing(road), OwnSide(road, step)
        self._progress = RouteProgress(road, goal)
        self._lights = LightRecord(road)
        self._green = GreenRecord(road)
        # one entry a state, from take-over on
        self._v: list[float] = []
        self._heading: list[float] = []
        self._odometer: list[float] = []
        self._speeding = 0
        self._changes = 0
        self._change_began = -inf
        self._trail: list[int] = []  # lanes under the ego, the front's last
        self._imposed: list[tuple[float, float]] = []  # time, deceleration
        self._ttc, self._pet, self._drac = inf, inf, -inf
        if take_over is not None:
            self._begin(take_over)

    def fail(self, message: str) -> None:
        """The run could not go on for a reason that the frames do not show.

        Changes nothing once there is an outcome.
        """
        if self._outcome is None:
            self._outcome, self._error = ERROR, message

    def observe(self, frame: Frame) -> str | None:
        """The outcome, from the step on in which the episode ended for this ego; until then
        None."""
        if self._outcome is not None:
            return self._outcome
        before = self._last
        hits: dict[str, Contact | None] = {}
        if before is None:
            self._begin(frame)
            if frame.present:
                everyone = np.arange(len(frame.agents.ids), dtype=np.int32)
                hits.update(self._contacts(frame, frame, everyone))
        elif frame.present:
            known = _match(before.agents.ids, frame.agents.ids)
            self._keep_goal(frame)
            seen, frame = frame, self._own_side.seen(before.ego, frame)
            if frame is not seen:  # on the lane of the oncoming traffic it can meet both
                hits.update(self._contacts(before, seen, known))
            self._move(before, frame)
            self._lights.note_red_runners(before, frame, known)
            self._note_imposed_braking(before, frame, known)
            hits.update(self._contacts(before, frame, known))
        elif frame.arrived and before.ego.lane >= 0 and self._odometer:
            # what is left of the last lane was driven before SUMO took the ego out
            rest = float(self._road.length[before.ego.lane]) - before.ego.s
            self._odometer[-1] += min(max(rest, 0.0), before.ego.v * self._step)
        for name in frame.collisions:
            hits.setdefault(name, None)
        self._note_surrogates(frame)
        self._outcome = self._judge(frame, bool(hits))
        if self._outcome == COLLISION:
            self._collided = sorted(hits)
            self._at_fault = self._is_at_fault(before or frame, frame, hits)
        if self._outcome == ARRIVED:
            self._finished = frame.time
        self._last = frame
        return self._outcome

    def row(self) -> dict[str, Any]:
        """The keys of an episode's row that follow from states alone; None where undefined."""
        row = {
            "outcome": self._outcome,
            "error": self._error,
            "at_fault": self._at_fault,
            "collisions": len(self._collided),
            "travel_time_s": None if self._finished is None else self._finished - self._departed,
            "free_flow_s": self._goal.free_flow if isfinite(self._goal.free_flow) else None,
            "in_time": self._outcome == ARRIVED,
            "distance_m": self._odometer[-1] if self._odometer else 0.0,
            **self._delays(),
            **self._motion(),
            "lane_changes": self._changes,
            "red_lights_run": self._lights.red,
            "yellow_run": self._lights.yellow,
            **self._imposed_braking(),
            "min_ttc_s": self._ttc if isfinite(self._ttc) else None,
            "min_pet_s": self._pet if isfinite(self._pet) else None,
            "max_drac_mps2": self._drac if isfinite(self._drac) else None,
        }
        if self._outcome != ERROR:
            return row
        # an ego that could not go on must not look careful
        return {**dict.fromkeys(row), **{key: row[key] for key in _KNOWN_AFTER_ERROR}}

    # --- parts of the row ---

    def _delays(self) -> dict[str, Any]:
        """How long the ego stood, and what it lost."""
        stands = np.array(self._v[1:]) < STANDING
        return {
            "stopped_s": float(np.sum(stands)) * self._step,
            "longest_stop_s": longest_run(stands) * self._step,
            "stopped_at_green_s": self._green.steps * self._step,
            "time_lost_s": self._time_lost(),
        }

    def _time_lost(self) -> float | None:
        """Time since departure minus the free-flow time of what the ego has come along its route;
        None where that is unknown."""
        if self._last is None or not isfinite(self._goal.free_flow):
            return None
        at_end = self._outcome == ARRIVED and (
            self._goal.success_edge < 0 or not self._last.present
        )
        left = 0.0 if at_end else self._progress.free_flow_left(self._last.ego)
        if left is None:
            return None
        return max(0.0, self._last.time - self._departed - (self._goal.free_flow - left))

    def _motion(self) -> dict[str, Any]:
        """How the ego moved."""
        v, heading = np.array(self._v), np.array(self._heading)
        decel = -np.diff(v) / self._step
        hard = np.flatnonzero(decel > HARD_BRAKE + _EPS)
        brakes = events((hard * self._step).tolist(), decel[hard].tolist(), self._step)
        return {
            "max_decel_mps2": float(max(0.0, decel.max(initial=0.0))),
            "hard_brakes": len(brakes),
            "rms_jerk_mps3": rms(jerks(v, self._step)),
            "comfortable_share": comfortable_share(v, heading, self._step),
            "speeding_share": self._speeding / (len(v) - 1) if len(v) > 1 else None,
        }

    def _imposed_braking(self) -> dict[str, Any]:
        """How others braked for the ego."""
        times = [time for time, _ in self._imposed]
        strengths = [strength for _, strength in self._imposed]
        found = events(times, strengths, self._step)
        return {
            "imposed_max_decel_mps2": float(max(strengths, default=0.0)),
            **{
                f"imposed_brakes_{limit:.0f}": sum(strength > limit + _EPS for strength in found)
                for limit in IMPOSED
            },
        }

    # --- the ego's motion ---

    def _begin(self, frame: Frame) -> None:
        ego = frame.ego
        self._last, self._departed, self._route = frame, frame.time, ego.route
        self._reaching = goal_reaching_edges(self._road, self._goal.edges[-1], ego.vclass)
        if frame.present:
            self._note_state(frame, 0.0)
            self._trail = [ego.lane] if ego.lane >= 0 else []
            self._change_began = frame.time if ego.changing > 0 else -inf
            self._progress.advance(self._trail)
        self._note_surrogates(frame)

    def _keep_goal(self, frame: Frame) -> None:
        """Where the simulation gave the ego a route that ends elsewhere, that is the goal."""
        ego, before = frame.ego, self._route
        self._route = ego.route
        if ego.route[-1:] == before[-1:]:
            return
        goal = self._progress.rerouted(ego, frame.time - self._departed)
        if goal is not None:
            self._goal, self._progress = goal, RouteProgress(self._road, goal)
            self._reaching = goal_reaching_edges(self._road, goal.edges[-1], ego.vclass)

    def _move(self, before: Frame, frame: Frame) -> None:
        """Take the ego one step further: distance, lane changes, lights, limits."""
        was, ego, road = before.ego, frame.ego, self._road
        self._lights.leave_junction(self._trail)
        drive = self._follow(was, ego)
        if ego.lane >= 0:
            self._trim_trail(ego)
            self._progress.advance((*drive.lanes, ego.lane))
            allowed = limit(self._road_in(frame), ego.lane, ego.vclass) * ego.speed_factor
            self._speeding += ego.v > allowed + SPEEDING + _EPS
        began = ego.changing > 0 and (was.changing <= 0 or ego.changing < was.changing - _EPS)
        at_once = drive.changes > 0 and ego.changing <= 0 and was.changing <= 0
        if began or at_once:
            self._change_began = frame.time
        self._changes += drive.changes
        for lane, line in zip(drive.lanes, drive.lines, strict=True):
            if road.signal[lane] >= 0:
                there = self._odometer[-1] + line
                self._lights.cross_stop_line(before, frame, lane, there, self._v, self._odometer)
        self._note_state(frame, self._odometer[-1] + drive.distance)

    def _road_in(self, frame: Frame) -> RoadMap:
        """The map as it is in this frame."""
        if frame.changes is not self._road_now[0]:
            self._road_now = frame.changes, with_changes(self._road, frame.changes)
        return self._road_now[1]

    def _follow(self, was: EgoState, ego: EgoState) -> Drive:
        """How the front came from the last state to this one; the trail gets longer by that."""
        drive = None
        if was.lane >= 0 and ego.lane >= 0:
            reach = 1.5 * max(was.v, ego.v) * self._step + REACH
            drive = driven(self._road, was.lane, was.s, ego.lane, ego.s, reach)
        if drive is None:  # off the lanes, or put somewhere else
            self._trail = [ego.lane] if ego.lane >= 0 else []
            return Drive((), (), 0, ego.v * self._step)
        if drive.lanes:
            self._trail = [*self._trail, *drive.lanes]
        if drive.lanes or drive.changes:
            self._trail[-1:] = [ego.lane]
        return drive

    def _trim_trail(self, ego: EgoState) -> None:
        """Forget the lanes that the ego's rear has left."""
        start, k = -ego.s, len(self._trail) - 1
        while k > 0 and start > -ego.length:
            k -= 1
            start -= float(self._road.length[self._trail[k]])
        del self._trail[:k]

    def _note_state(self, frame: Frame, odometer: float) -> None:
        self._v.append(frame.ego.v)
        self._heading.append(frame.ego.heading)
        self._odometer.append(odometer)
        self._lights.note_state(frame.signals, len(self._v) - 1)
        self._green.note_state(frame)

    def _note_imposed_braking(self, before: Frame, frame: Frame, known: Ints) -> None:
        braking = braking_for_ego(self._road, self._trail, self._step, before, frame, known)
        if braking:
            self._imposed.append((frame.time, max(decel for _, decel in braking)))

    def _note_surrogates(self, frame: Frame) -> None:
        self._ttc = self._ttc if isnan(frame.ttc) else min(self._ttc, frame.ttc)
        self._pet = self._pet if isnan(frame.pet) else min(self._pet, frame.pet)
        self._drac = self._drac if isnan(frame.drac) else max(self._drac, frame.drac)

    def _contacts(self, before: Frame, frame: Frame, known: Ints) -> dict[str, Contact]:
        hits = contacts(self._road, self._drawing, self._step, before, frame, known)
        past = dict(zip(frame.agents.ids, known.tolist(), strict=True))
        return {
            name: hit
            for name, hit in hits.items()
            if not clear_on_lanes(self._road, before, frame, name, past[name], hit)
        }

    # --- judgement ---

    def _judge(self, frame: Frame, hit: bool) -> str | None:
        """The outcome in this step, precedence as measures.md lists them."""
        lane = frame.ego.lane
        arrived = self._progress.arrived or (frame.arrived and self._ends_at_goal())
        if not (frame.present or frame.arrived or frame.teleported or hit):
            self._error = "vanished"
            return ERROR
        if hit:
            return COLLISION
        if frame.teleported:
            return TELEPORTED
        # another goal: it was given another route, or one that leaves out the edge that counts
        if frame.arrived and not arrived:
            return OFF_ROUTE
        if frame.present and lane >= 0 and not (arrived or self._reaching[self._road.edge[lane]]):
            return OFF_ROUTE
        if frame.time - self._departed > self._goal.time_limit + _EPS:
            return TIMEOUT
        return ARRIVED if arrived else None

    def _ends_at_goal(self) -> bool:
        last = None if self._last is None else self._last.ego
        return self._progress.ends_at_goal(last, self._step)

    def _is_at_fault(self, before: Frame, frame: Frame, hits: dict[str, Contact | None]) -> bool:
        """Whether the ego is at fault in one of these collisions."""
        conduct = Conduct(
            lanes_under(self._road, frame.ego, self._trail),
            self._change_began,
            self._lights.red_junction,
            self._lights.red_runners,
        )
        return any(
            is_at_fault(self._road, conduct, self._step, before, frame, name, contact)
            for name, contact in hits.items()
        )


def _match(before: tuple[str, ...], now: tuple[str, ...]) -> Ints:
    """[len(now)] where each id stood before, -1 nowhere."""
    if before == now:
        return np.arange(len(now), dtype=np.int32)
    place = {name: i for i, name in enumerate(before)}
    return np.array([place.get(name, -1) for name in now], dtype=np.int32)
