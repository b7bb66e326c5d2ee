"""What a commander tells SUMO, step by step, and what it gives back. A stand-in for SUMO notes it;
tests/world/test_executed.py shows that SUMO does it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from helpers import straight_road

from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Follow, Release
from sumo_mcts.world import command
from sumo_mcts.world.command import Bounds, Commander, bounded
from sumo_mcts.world.observe import Change

BOUNDS = Bounds(step=0.1, change_duration=3.0, accel=2.6, decel=8.0, jerk=20.0)
A_0, A_1 = 0, 1  # lanes of 3.2 m side by side


class Sumo:
    """One vehicle, and what it was told."""

    def __init__(
        self, patch: pytest.MonkeyPatch, road: RoadMap | None = None, **bounds: float
    ) -> None:
        self.vehicle = self  # libsumo.vehicle
        self.speed, self.accel, self.lateral, self.lane, self.action_step = 10.0, 0.0, 0.0, A_0, 0.1
        self.speed_mode, self.lane_change_mode, self.departed = 31, 1621, 7.0
        self.told: list[tuple[Any, ...]] = []
        self.asking, self.moving, self.skipped = False, False, 0
        self.shifts: list[float] = []
        patch.setattr(command, "running_sumo", lambda: self)
        patch.setattr(
            command,
            "Places",
            lambda *_: SimpleNamespace(
                of=lambda _: SimpleNamespace(lane=self.lane, d=self.lateral)
            ),
        )
        patch.setattr(command, "Aside", lambda *_: _Aside(self))
        patch.setattr(command, "Wish", lambda _: _Wish(self))
        patch.setattr(command, "departure", lambda _: self.departed)
        patch.setattr(command, "skip_next", lambda _: self.told.append(("skip",)))
        self.road = road or straight_road()
        self.commander = Commander("ego", self.road, {}, BOUNDS._replace(**bounds))

    def __getattr__(self, name: str) -> Any:
        values = {
            "getSpeed": "speed", "getAcceleration": "accel", "getDeparture": "departed",
            "getSpeedMode": "speed_mode", "getLaneChangeMode": "lane_change_mode",
            "getActionStepLength": "action_step", "getLateralLanePosition": "lateral",
        }  # fmt: skip
        if name in values:
            return lambda _: getattr(self, values[name])
        settings = {
            "setSpeedMode": "speed_mode", "setLaneChangeMode": "lane_change_mode",
            "setActionStepLength": "action_step",
        }  # fmt: skip

        def tell(vehicle: str, *what: Any) -> None:
            assert vehicle == "ego"
            self.told.append((name, *what))
            if name in settings:
                setattr(self, settings[name], what[0])

        return tell

    def said(self, name: str) -> list[Any]:
        """The last argument of each call of this name so far."""
        return [each[1] if len(each) > 1 else None for each in self.told if each[0] == name]


class _Aside:
    def __init__(self, sumo: Sumo) -> None:
        self.sumo = sumo

    @property
    def divided(self) -> bool:
        return self.sumo.moving

    def moves(self, _: str) -> bool:
        return self.sumo.moving

    def shift(self, _: str, left: float) -> None:
        self.sumo.shifts.append(left)


class _Wish:
    def __init__(self, sumo: Sumo) -> None:
        self.sumo, self.on, self.mode, self.possible = sumo, False, 0, True
        self.renewed = self.forgotten = 0

    def turn(self, on: bool) -> None:
        self.on, self.mode = on, int(on)

    def renew(self) -> None:
        self.renewed += 1

    def forget(self) -> None:
        self.forgotten += 1


def follow(*speeds: float, **more: Any) -> Follow:
    return Follow(np.array(speeds), more.pop("lane_change", 0), **more)


def test_a_profile_is_played_and_then_braking_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    sumo = Sumo(monkeypatch)
    sumo.commander.before_step()  # nothing was accepted: SUMO drives
    assert sumo.told == [] and sumo.commander.played
    sumo.commander.accept(follow(10.1, 10.15))
    assert not sumo.commander.played
    sumo.commander.before_step()
    assert not sumo.commander.played
    sumo.commander.before_step()
    assert sumo.commander.played and sumo.said("setSpeed") == [10.1, 10.15]
    sumo.accel = -1.5
    sumo.commander.before_step()  # 10 m/s, and a tenth of a second of braking
    sumo.accel = 1.5
    sumo.commander.before_step()
    assert sumo.said("setSpeed")[2:] == pytest.approx([9.85, 10.0])


def test_no_profile_means_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    sumo = Sumo(monkeypatch)
    sumo.commander.accept(follow())
    sumo.commander.before_step()  # from no acceleration braking grows by 20 m/s3
    assert sumo.said("setSpeed") == pytest.approx([9.8], abs=1e-5)


def test_a_new_profile_begins_at_its_beginning_and_skipped_steps_count(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sumo = Sumo(monkeypatch)
    for speeds in ((10.1, 10.2), (10.05, 10.06, 10.07, 10.08)):
        sumo.commander.accept(follow(*speeds))
        sumo.commander.before_step()
    sumo.commander.skip(2)
    sumo.commander.before_step()
    assert sumo.said("setSpeed") == [10.1, 10.05, 10.08] and sumo.commander.played


def test_no_command_leaves_the_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    sumo = Sumo(monkeypatch)
    sumo.commander.accept(follow(50.0, 50.0))
    sumo.commander.before_step()
    sumo.commander.bind(BOUNDS._replace(accel=1.0))
    sumo.commander.before_step()
    assert sumo.said("setSpeed") == pytest.approx([10.2, 10.1], abs=1e-5)


@pytest.mark.parametrize(
    ("wanted", "a", "expected"),
    [
        (99.0, 0.0, 10.2),  # jerk: 20 m/s3 for 0.1 s are 2 m/s2
        (0.0, 0.0, 9.8),
        (99.0, 1.0, 10.26),  # 2.6 m/s2
        (0.0, -7.0, 9.2),  # 8 m/s2
        (0.0, -30.0, 9.2),
        (99.0, -30.0, 9.2),
        (0.0, 30.0, 10.26),
        (10.1, 0.0, 10.1),
        (9.9, 0.0, 9.9),
    ],
)
def test_the_bounds_by_hand(wanted: float, a: float, expected: float) -> None:
    assert bounded(wanted, 10.0, a, BOUNDS) == pytest.approx(expected, abs=1e-6)
    assert bounded(0.0, 0.05, -5.0, BOUNDS) == 0.0


def test_what_was_taken_is_given_back(monkeypatch: pytest.MonkeyPatch) -> None:
    sumo = Sumo(monkeypatch)
    sumo.action_step = 1.0
    sumo.commander.accept(follow(10.0))
    assert (sumo.speed_mode, sumo.lane_change_mode, sumo.action_step) == (0, 0, 0.1)
    sumo.commander.accept(follow(10.0))  # taken over once
    assert len(sumo.said("setSpeedMode")) == 1
    sumo.commander.accept(Release())
    assert (sumo.speed_mode, sumo.lane_change_mode, sumo.action_step) == (31, 1621, 1.0)
    assert sumo.said("setSpeed") == [-1.0] and sumo.commander._wish.forgotten == 1
    sumo.commander.before_step()
    sumo.commander.release()  # nothing is left to give back
    assert sumo.said("setSpeed") == [-1.0]


def test_who_acts_in_every_step_is_left_so(monkeypatch: pytest.MonkeyPatch) -> None:
    sumo = Sumo(monkeypatch)
    sumo.commander.accept(follow(10.0))
    sumo.commander.release()
    assert sumo.said("setActionStepLength") == []


def test_another_vehicle_of_the_same_id_gets_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    sumo = Sumo(monkeypatch)
    sumo.commander.accept(follow(10.0))
    sumo.departed = 8.0
    monkeypatch.setattr(command, "departure", lambda _: 8.0)
    sumo.commander.release()
    assert sumo.said("setSpeed") == [] and sumo.speed_mode == 0


@pytest.mark.parametrize("mode", ["speed_mode", "lane_change_mode"])
def test_modes_that_another_hand_sets_are_given_back(
    mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As after a loaded state; how often it acted before is known from the first time."""
    sumo = Sumo(monkeypatch)
    sumo.action_step = 1.0
    sumo.commander.accept(follow(10.0, 10.0, 10.0))
    sumo.commander.before_step()
    assert sumo.commander._wish.renewed == 0
    setattr(sumo, mode, 5)
    sumo.commander.before_step()
    assert (sumo.speed_mode, sumo.lane_change_mode) == (0, 0) and sumo.commander._wish.renewed == 1
    sumo.commander.release()
    assert getattr(sumo, mode) == 5 and sumo.action_step == 1.0


# --- lane changes ---


@pytest.mark.parametrize(("lane", "side", "target"), [(A_0, 1, A_1), (A_1, -1, A_0)])
def test_a_change_is_asked_for_once_and_lasts_its_duration(
    lane: int, side: int, target: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    sumo = Sumo(monkeypatch)
    sumo.lane = lane
    sumo.commander.accept(follow(10.0, lane_change=side))
    assert sumo.told[-1] == ("changeLane", target, 0.0)
    assert sumo.commander.change == Change(0.0, lane, target)
    for _ in range(10):
        sumo.commander.before_step()
    assert sumo.commander.change.progress == pytest.approx(1.0 / 3.0)
    sumo.commander.skip(18)
    assert sumo.commander.change.progress == pytest.approx(28.0 / 30.0)
    sumo.commander.before_step()
    assert sumo.commander.change.target == target
    sumo.commander.before_step()
    assert sumo.commander.change == Change()
    assert len(sumo.said("changeLane")) == 1


def test_where_there_is_no_lane_nothing_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    sumo = Sumo(monkeypatch)
    for lane, side in ((A_0, -1), (A_1, 1), (-1, 1), (-1, -1)):
        sumo.lane = lane
        sumo.commander.accept(follow(10.0, lane_change=side))
        assert sumo.said("changeLane") == [] and sumo.commander.change == Change()


def test_without_a_duration_sumo_jumps(monkeypatch: pytest.MonkeyPatch) -> None:
    sumo = Sumo(monkeypatch, change_duration=0.0)
    sumo.lateral = 0.5  # nothing under way: a change takes no time
    sumo.commander.accept(follow(10.0, lane_change=1))
    assert sumo.told[-1] == ("changeLane", A_1, 0.0) and sumo.commander.change == Change()


def test_the_wish_is_held_for_a_step_where_the_last_change_is_not_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sumo = Sumo(monkeypatch)
    for lateral, held in ((0.5, 0.1), (-0.5, 0.1), (0.0005, 0.0)):
        sumo.lateral = lateral
        sumo.commander.accept(follow(10.0, lane_change=1))
        assert sumo.told[-1] == ("changeLane", A_1, held)


@pytest.mark.parametrize(
    ("lefthand", "side", "outwards"), [(False, 1, 1), (False, -1, -1), (True, 1, -1), (True, -1, 1)]
)
def test_a_lane_of_the_oncoming_is_named_as_sumo_counts(
    lefthand: bool, side: int, outwards: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "against_traffic", lambda road: road.length < -1.0)
    sumo = Sumo(monkeypatch, straight_road()._replace(lefthand=lefthand))
    sumo.lane = A_0 if side > 0 else A_1
    for which in (A_0, A_1):
        sumo.commander.change = Change()
        sumo.commander._against = np.arange(len(sumo.road.length)) == which
        sumo.commander.accept(follow(10.0, lane_change=side))
        assert sumo.told[-1] == ("changeLaneRelative", outwards, 0.0)


def test_who_moves_within_its_lane_is_moved_to_the_next_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From 0.5 m left of the middle: 2.7 m to the left, or 3.7 m to the right."""
    sumo = Sumo(monkeypatch)
    sumo.moving, sumo.lateral = True, 0.5
    for lane, side in ((A_0, 1), (A_1, -1)):
        sumo.lane = lane
        sumo.commander.change = Change()
        sumo.commander.accept(follow(10.0, lane_change=side))
    assert sumo.shifts == pytest.approx([2.7, -3.7]) and sumo.said("changeLane") == []


def test_such_a_change_lasts_until_it_is_in_the_middle(monkeypatch: pytest.MonkeyPatch) -> None:
    sumo = Sumo(monkeypatch)
    sumo.moving, sumo.lateral = True, 1.0
    sumo.commander.accept(follow(10.0, lane_change=1))
    sumo.commander.skip(29)
    sumo.commander.skip(4)
    assert sumo.commander.change == Change(pytest.approx(29.0 / 30.0), A_0, A_1)
    sumo.lane, sumo.lateral = A_1, -0.5
    sumo.commander.skip(1)
    assert sumo.commander.change == Change(pytest.approx(29.0 / 30.0), A_0, A_1)
    sumo.lateral = 0.0
    sumo.commander.skip(1)
    assert sumo.commander.change == Change()


def test_a_shift_within_the_lane_waits_for_a_change(monkeypatch: pytest.MonkeyPatch) -> None:
    sumo = Sumo(monkeypatch)
    sumo.commander.accept(follow(10.0))
    sumo.commander.accept(follow(10.0, shift=0.4))
    assert sumo.shifts == [0.4]
    sumo.commander.accept(follow(10.0, shift=0.4, lane_change=1))
    sumo.commander.accept(follow(10.0, shift=0.3))
    assert sumo.shifts == [0.4]


def test_a_stop_is_skipped_when_that_is_commanded(monkeypatch: pytest.MonkeyPatch) -> None:
    sumo = Sumo(monkeypatch)
    sumo.commander.accept(follow(10.0))
    assert ("skip",) not in sumo.told
    sumo.commander.accept(follow(10.0, skips_stop=True))
    assert sumo.told.count(("skip",)) == 1


# --- asking for room ---


def test_room_is_asked_for_but_during_a_change(monkeypatch: pytest.MonkeyPatch) -> None:
    sumo = Sumo(monkeypatch)
    assert sumo.commander.can_ask and sumo.commander.asks == 0
    for asks in (1, 0, -1):
        sumo.commander.accept(follow(10.0, asks=asks))
        assert sumo.commander.asks == asks and sumo.commander._wish.on == (asks != 0)
    sumo.lateral = 0.5
    sumo.commander.accept(follow(10.0, asks=1))
    assert sumo.commander.asks == 0
    sumo.lateral = 0.0
    sumo.commander.accept(follow(10.0, asks=1, lane_change=1))
    assert sumo.commander.asks == 0
    sumo.commander.accept(follow(10.0, asks=1))  # under way
    assert sumo.commander.asks == 0
    sumo.commander.change = Change()
    sumo.commander.accept(follow(10.0, asks=1))
    assert sumo.commander._wish.on
    sumo.commander.release()
    assert not sumo.commander._wish.on


@pytest.mark.parametrize(
    ("lane", "lateral", "asks", "change"),
    [
        (A_0, 0.0, 1, Change()),  # not yet
        (A_0, 0.3, 0, Change(1.0 / 30.0, A_0, A_1)),  # it has begun: a step of it is over
        (A_1, -1.5, 0, Change(1.0 / 30.0, A_0, A_1)),
        (4, 0.3, 0, Change()),
        (4, 0.0, 0, Change()),  # it drove on: what is asked for is to be decided again
    ],
)
def test_sumo_may_begin_the_change_that_was_asked_for(
    lane: int, lateral: float, asks: int, change: Change, monkeypatch: pytest.MonkeyPatch
) -> None:
    sumo = Sumo(monkeypatch)
    sumo.commander.accept(follow(10.0, asks=1))
    sumo.lane, sumo.lateral = lane, lateral
    sumo.commander.notice()
    assert sumo.commander.asks == asks
    assert sumo.commander.change == pytest.approx(change)


def test_nothing_is_noticed_of_who_does_not_ask_or_is_another(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sumo = Sumo(monkeypatch)
    sumo.commander.accept(follow(10.0))
    sumo.lane, sumo.lateral = A_1, -1.5
    sumo.commander.notice()
    assert sumo.commander.change == Change()
    sumo.lane, sumo.lateral = A_0, 0.0
    sumo.commander.accept(follow(10.0, asks=1))
    monkeypatch.setattr(command, "departure", lambda _: 99.0)
    sumo.lane, sumo.lateral = A_1, -1.5
    sumo.commander.notice()
    assert sumo.commander.change == Change()
