"""The fail-safe: situations whose answer is known, what holds for every manoeuvre that it verifies,
a naive twin, and planners that fail in SUMO."""

import json
import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import helpers
import numpy as np
import pytest
from helpers import Agent, crossing, edges, ego_at
from helpers_model import PHYSICS, lanes_east, scenario, scene_of, situation_of, task_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from naive import Box
from typer.testing import CliRunner

from sumo_mcts import config, scenarios
from sumo_mcts.arrays import Floats
from sumo_mcts.cli import app
from sumo_mcts.config import ScenarioConfig, builtin
from sumo_mcts.driver import driver, factories
from sumo_mcts.driver.factories import make_planner
from sumo_mcts.driver.params import assumed
from sumo_mcts.driver.warmup import warm_up
from sumo_mcts.episode import EpisodeResult, run_episode
from sumo_mcts.model.motion import can_change, obey
from sumo_mcts.numerics.kernel import Stopwatch, entry
from sumo_mcts.planners import base
from sumo_mcts.planners.base import Situation, Task
from sumo_mcts.planners.failsafe import LONGEST_S, FailSafe
from sumo_mcts.planners.failsafe_reach import ACCELERATE, ALONG, BRAKE, HOLD, drive
from sumo_mcts.planners.validity import why_invalid
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Decision, EgoState, Follow, Plan, Release, Sideways
from sumo_mcts.world.command import Bounds, bounded

PERIOD = 0.5  # s
DT = PHYSICS.step


class Case(NamedTuple):
    """A scene, and what the ego is told."""

    task: Task
    situation: Situation
    command: Follow

    def __repr__(self) -> str:
        """What hypothesis shows."""
        agents = self.situation.scene.agents
        return (
            f"{self.situation.state} {self.command} "
            f"{[(agents.lane[i], agents.s[i], agents.v[i]) for i in range(len(agents.ids))]}"
        )

    @property
    def fail_safe(self) -> FailSafe:
        """One that has seen nothing yet."""
        result = FailSafe(assumed(scenario()), PERIOD)
        result.start(self.task)
        return result


def case(
    road: RoadMap, ego: EgoState, *agents: Agent, speed: float | None = None, side: int = 0
) -> Case:
    """`speed`: what the ego is told, by default to go on as it does."""
    task = task_of(road, ego)
    return Case(
        task,
        situation_of(task, scene_of(ego, road, *agents)),
        Follow(np.full(10, ego.v if speed is None else speed), side),
    )


def objection(
    road: RoadMap, ego: EgoState, *agents: Agent, speed: float | None = None, side: int = 0
) -> str:
    """What the fail-safe says."""
    those = case(road, ego, *agents, speed=speed, side=side)
    return those.fail_safe.objection(those.situation, those.command)


def ready(fail_safe: FailSafe, situation: Situation) -> Plan:
    """The whole manoeuvre that was just verified."""
    plan = fail_safe.fall_back(situation, "asked for", None).plan
    assert plan is not None
    return plan


# --- situations ---

LANES = lanes_east(3, 900.0)


def on_lane(v: float = 15.0, s: float = 200.0) -> EgoState:
    return ego_at(LANES, "a_1", s, v)


def test_alone_nothing_is_objected_to() -> None:
    assert objection(LANES, on_lane()) == ""
    assert objection(LANES, on_lane(), side=1) == ""


@pytest.mark.parametrize(("gap", "safe"), [(15.0, False), (40.0, True)])
def test_a_standing_car_needs_a_stopping_distance(gap: float, safe: bool) -> None:
    """At 15 m/s: 7.5 m in the period, 14 m of braking with 8 m/s2, some for the jerk."""
    said = objection(LANES, on_lane(), Agent("wall", "a_1", 200.0 + gap + 5.0, 0.0))
    assert (said == "") == safe
    assert safe or "wall (ahead" in said


@pytest.mark.parametrize(("gap", "safe"), [(0.5, False), (15.0, True)])
def test_a_leader_may_brake(gap: float, safe: bool) -> None:
    said = objection(LANES, on_lane(), Agent("leader", "a_1", 200.0 + gap + 5.0, 15.0), speed=16.0)
    assert (said == "") == safe


def test_whoever_is_behind_keeps_its_distance() -> None:
    assert objection(LANES, on_lane(), Agent("tailgater", "a_1", 193.0, 16.0), speed=10.0) == ""


@pytest.mark.parametrize(("behind", "v", "safe"), [(12.0, 22.0, False), (60.0, 16.0, True)])
def test_nobody_is_cut_off(behind: float, v: float, safe: bool) -> None:
    said = objection(LANES, on_lane(), Agent("fast", "a_2", 200.0 - behind, v), side=1)
    assert (said == "") == safe
    assert safe or "fast (behind" in said


def test_a_lane_change_into_somebody() -> None:
    beside = Agent("beside", "a_2", 200.0, 15.0)
    assert objection(LANES, on_lane(), beside) == ""
    assert "beside" in objection(LANES, on_lane(), beside, side=1)


CROSSING = crossing(bridge=False)


def from_south(s: float, v: float) -> EgoState:
    return ego_at(CROSSING, "si_0", s, v, route=edges(CROSSING, "si", "no"))


def test_it_does_not_enter_before_somebody_with_the_right_of_way() -> None:
    near = Agent("near", "wi_0", 83.0, 13.0)
    assert "near (crossing" in objection(CROSSING, from_south(89.5, 9.0), near)
    assert objection(CROSSING, from_south(89.5, 9.0)) == ""
    assert objection(CROSSING, from_south(60.0, 9.0), near) == ""  # it can still stop
    assert objection(CROSSING, from_south(89.5, 0.0), near, speed=0.0) == ""


def test_who_is_on_the_junction_may_leave_it() -> None:
    """A stop would be in the way of somebody who comes in a few seconds; going on is not."""
    ego = ego_at(CROSSING, ":sn_0", 6.0, 5.0, route=edges(CROSSING, "si", "no"))
    those = case(CROSSING, ego, Agent("coming", "wi_0", 40.0, 10.0))
    fail_safe = those.fail_safe
    assert fail_safe.objection(those.situation, those.command) == ""
    plan = ready(fail_safe, those.situation)
    assert CROSSING.lane_ids[plan.lane[-1]] == "no_0" and plan.s[-1] > 5.0


def test_a_pedestrian_on_the_road() -> None:
    ego = from_south(60.0, 12.0)
    assert "child" in objection(
        CROSSING,
        ego,
        Agent("child", "", v=1.0, x=0.5, y=-100 + 60 + 9.0, heading=0.0, length=0.5, width=0.5),
    )
    assert (
        objection(
            CROSSING,
            ego,
            Agent("child", "", v=1.0, x=6.0, y=-100 + 60 + 9.0, heading=0.0, length=0.5, width=0.5),
        )
        == ""
    )


def test_what_was_verified_goes_on() -> None:
    those = case(LANES, on_lane(), Agent("ahead", "a_1", 260.0, 10.0))
    fail_safe = those.fail_safe
    assert fail_safe.objection(those.situation, those.command) == ""
    whole = ready(fail_safe, those.situation)
    assert np.all(whole.v[:5] == 15.0) and whole.v[-1] < 0.01
    later = those.situation._replace(scene=those.situation.scene._replace(time=PERIOD))
    decision = fail_safe.fall_back(later, "why not", None)
    assert (
        decision.reason == "fail-safe: why not"
        and isinstance(decision.command, Follow)
        and decision.plan is not None
    )
    assert np.array_equal(decision.command.speeds, whole.v[5:]) and decision.plan.time[
        0
    ] == pytest.approx(DT)
    rest = fail_safe.fall_back(
        those.situation._replace(scene=those.situation.scene._replace(time=60.0)), "why not", None
    )
    assert isinstance(rest.command, Follow) and rest.command.speeds.tolist() == [whole.v[-1]]


def test_the_first_cycle_without_a_way_out_is_braking_as_hard_as_possible() -> None:
    those = case(LANES, on_lane(), Agent("wall", "a_1", 212.0, 0.0))
    fail_safe = those.fail_safe
    assert fail_safe.objection(those.situation, those.command) != ""
    decision = fail_safe.fall_back(those.situation, "wall", None)
    assert decision.reason == "fail-safe, unverified: wall" and decision.plan is not None
    assert np.diff(decision.plan.v).min() == pytest.approx(-8.0 * DT) and np.all(
        np.diff(decision.plan.v) < 0.0
    )


# --- what is no decision ---


@pytest.mark.parametrize(
    ("command", "why"),
    [
        (Follow(np.full(5, np.nan), 0), "a speed of nan m/s"),
        (Follow(np.array([15.0, np.inf]), 0), "a speed of inf m/s"),
        (Follow(np.array([-1.0]), 0), "a speed of -1 m/s"),
        (Follow(np.zeros(0), 0), "speeds of shape (0,)"),
        (Follow(np.zeros((5, 2)), 0), "speeds of shape (5, 2)"),
        (Follow(np.array(["fast"]), 0), "speeds of shape (1,) and type <U4"),
        (Follow(np.full(5, 15.0), 2), "a lane change by 2"),
        (Follow(np.full(5, 15.0), 1), "a lane change to the left, where there is no lane"),
        ("faster", "no decision but Decision"),
    ],
)
def test_why_a_decision_is_invalid(command: Any, why: str) -> None:
    those = case(LANES, ego_at(LANES, "a_2", 200.0, 15.0))
    assert why in why_invalid(
        those.task, those.situation, Decision(command, None, (), -1, "", 0, 0)
    )


def test_a_lane_change_during_another_one_is_invalid() -> None:
    """But back to where it came from, where SUMO divides lanes."""
    those = case(LANES, on_lane())
    state = those.situation.state._replace(progress=0.3, other=2)
    ego = those.situation.scene.ego
    for side, divided, valid in (
        (1, False, False),
        (-1, False, False),
        (1, True, False),
        (-1, True, True),
    ):
        scene = those.situation.scene._replace(ego=ego._replace(sideways=Sideways(float(divided))))
        situation = those.situation._replace(state=state, scene=scene)
        decision = Decision(Follow(np.full(5, 15.0), side), None, (), -1, "", 0, 0)
        why = why_invalid(those.task, situation, decision)
        assert why == ("" if valid else "a lane change during another one")


def test_what_is_valid() -> None:
    those = case(LANES, on_lane())
    for command in (
        Follow(np.zeros(1), 1),
        Follow(np.full(90, 15.0), -1),
        Follow(np.array([3]), 0),
        Release(),
    ):
        assert (
            why_invalid(those.task, those.situation, Decision(command, None, (), -1, "", 0, 0))
            == ""
        )
    assert why_invalid(those.task, those.situation, None) == "no decision but NoneType"


# --- properties ---


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """An ego and up to four others, on three lanes or at a crossing, and any command."""
    number = st.floats(0.0, 1.0)
    if draw(st.booleans()):
        ego = ego_at(LANES, "a_1", 200.0, 20.0 * draw(number))
        agents = [
            Agent(
                f"x{k}",
                f"a_{draw(st.integers(0, 2))}",
                150.0 + 120.0 * draw(number),
                20.0 * draw(number),
            )
            for k in range(draw(st.integers(1, 4)))
        ]
        side = draw(st.sampled_from([0, 0, -1, 1]))
        road = LANES
    else:
        ego, side, road = from_south(60.0 + 30.0 * draw(number), 14.0 * draw(number)), 0, CROSSING
        places = [
            (draw(st.sampled_from(["wi_0", "si_0", "no_0", ":we_0"])), draw(number))
            for _ in range(draw(st.integers(1, 4)))
        ]
        agents = [
            Agent(f"x{k}", on, share * (20.0 if on == ":we_0" else 90.0), 15.0 * draw(number))
            for k, (on, share) in enumerate(places)
        ]
    assume(
        all(
            math.hypot(a.x - ego.x, a.y - ego.y) > 6.0
            for a in (_centre(road, one) for one in agents)
        )
    )
    return case(road, ego, *agents, speed=20.0 * draw(number), side=side)


def _centre(road: RoadMap, agent: Agent) -> Agent:
    x, y, _ = helpers.place(road, agent.on, agent.s, agent.length)
    return agent._replace(x=x, y=y)


class Way(NamedTuple):
    """An agent's way as the forecast has it."""

    driven: Floats  # [T] m
    pose: Floats  # [T, 4]
    v: float
    top: float
    exempt: bool  # behind the ego

    def at(self, driven: float, size: tuple[float, float]) -> Box:
        """Its box after so many metres; at the end of the way it stays there."""
        x, y = (float(np.interp(driven, self.driven, self.pose[:, k])) for k in (0, 1))
        k = min(int(np.searchsorted(self.driven, driven, side="right")), len(self.driven) - 1)
        k = max(k - 1, 0)
        return Box(x, y, math.atan2(self.pose[k, 3], self.pose[k, 2]), *size)


def ways_of(those: Case) -> list[Way]:
    forecast, agents, ego = (
        those.situation.forecast,
        those.situation.scene.agents,
        those.situation.scene.ego,
    )
    road, bounds = those.task.road, assumed(scenario())
    result = []
    for i in range(len(agents.ids)):
        there = forecast.valid[0, :, i]
        v = forecast.v[0, :, i]
        driven = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * forecast.dt)])[there]
        limit = max(float(road.speed[lane]) for lane in forecast.lane[0, :, i] if lane >= 0)
        top = max(bounds.over_limit * limit, float(agents.v[i]))
        behind = agents.lane[i] == ego.lane and agents.s[i] < ego.s
        result.append(
            Way(driven, forecast.pose[0, there, i], float(agents.v[i]), top, bool(behind))
        )
    return result


def falls_short(way: Way, driven: float, at: float) -> bool:
    """Whether an agent that reacts has not come so far at a time: it accelerates for its reaction
    time, then brakes."""
    b = assumed(scenario())
    v, x = way.v, 0.0
    for k in range(round(at / 0.01)):
        a = b.accel if k * 0.01 < b.reaction - 1e-9 else -b.yield_decel
        after = min(max(v + a * 0.01, 0.0), max(way.top, v))
        x, v = x + 0.5 * (v + after) * 0.01, after
    return x < driven + 0.05


def meets(
    those: Case, plan: Plan, way: Way, size: tuple[float, float], k: int, driven: float
) -> bool:
    """Whether the ego, after k + 1 steps of its plan, meets an agent that has driven so many
    metres."""
    ego = those.task.ego
    x, y, c, s = plan.pose[k]
    if driven >= way.driven[-1] and len(way.driven) < those.situation.forecast.v.shape[1]:
        return False  # it has left the map
    box, own = way.at(driven, size), Box(x, y, math.atan2(s, c), ego.half_length, ego.half_width)
    return bool(own.polygon().intersection(box.polygon()).area > 1e-6)


def brakes_before(
    those: Case, plan: Plan, way: Way, size: tuple[float, float], k: int, driven: float
) -> bool:
    """Whether an agent that would meet the ego there can be relied on to brake: it drives up to the
    ego, or stands now, and has the time."""
    x, y, c, s = plan.pose[k]
    box = way.at(driven, size)
    cosine, sine = math.cos(box.heading), math.sin(box.heading)
    along = c * cosine + s * sine > ALONG and (x - box.x) * cosine + (y - box.y) * sine > 0.0
    return (along or way.v < 0.01) and falls_short(way, driven, (k + 1) * DT)


@pytest.mark.slow
@settings(max_examples=60)
@given(cases(), st.randoms(use_true_random=False))
def test_a_verified_manoeuvre_meets_nobody_within_the_bounds(those: Case, random: Any) -> None:
    fail_safe, bounds = those.fail_safe, assumed(scenario())
    assume(
        those.command.lane_change == 0
        or can_change(
            local_of(those), those.task.ego, those.situation.state, those.command.lane_change
        )
    )
    assume(fail_safe.objection(those.situation, those.command) == "")
    plan = ready(fail_safe, those.situation)
    agents = those.situation.scene.agents
    assert plan.v[-1] < 0.01 or plan.lane[-1] == helpers.lane(those.task.road, "no_0")
    for i, way in enumerate(ways_of(those)):
        if way.exempt:
            continue
        size = float(agents.length[i]) / 2, float(agents.width[i]) / 2
        for _ in range(4):
            v, x = way.v, 0.0
            mood = random.choice([-bounds.decel, bounds.accel, 0.0, None])
            for k in range(len(plan.v)):
                a = random.uniform(-bounds.decel, bounds.accel) if mood is None else mood
                after = min(max(v + a * DT, 0.0), max(way.top, v))
                x, v = x + 0.5 * (v + after) * DT, after
                x = min(x, float(way.driven[-1]))
                if meets(those, plan, way, size, k, x):
                    assert brakes_before(those, plan, way, size, k, x)
                    break


def local_of(those: Case) -> Any:
    situation, task = those.situation, those.task
    return base.local_of(task, situation)


def reach(those: Case, way: Way, at: float) -> tuple[float, float]:
    """What an agent has driven at least and at most by then, m; at the end of its way it stays."""
    b = assumed(scenario())
    stop, rise = min(at, way.v / b.decel), min(at, (way.top - way.v) / b.accel)
    least, most = (
        way.v * stop - 0.5 * b.decel * stop**2,
        way.v * at + b.accel * rise * (at - 0.5 * rise),
    )
    return min(least, float(way.driven[-1])), min(most, float(way.driven[-1]))


def clearance(those: Case, plan: Plan, i: int, way: Way, k: int) -> tuple[float, float]:
    """The slow twin: how near (m) agent i could be to the ego after k + 1 steps of a plan, and what
    it has driven there, the first such place."""
    ego, agents = those.task.ego, those.situation.scene.agents
    least, most = reach(those, way, (k + 1) * DT)
    x, y, c, s = plan.pose[k]
    own = Box(x, y, math.atan2(s, c), ego.half_length, ego.half_width).polygon()
    places = np.linspace(least, most, max(2, math.ceil((most - least) / 0.5)))
    size = float(agents.length[i]) / 2, float(agents.width[i]) / 2
    return min(
        (round(own.distance(way.at(float(driven), size).polygon()), 6), float(driven))
        for driven in places
    )


@pytest.mark.slow
@settings(max_examples=25)
@given(cases())
def test_the_verdict_is_that_of_a_slow_twin(those: Case) -> None:
    """Whom the kernel objects to could be there, or within the metre that boxes are drawn out for
    half a step; whom it does not, could not."""
    assume(those.command.lane_change == 0)
    ways, steps, ego = ways_of(those), round(LONGEST_S / DT), those.task.ego
    top = np.array([way.top for way in ways])
    for begin in (BRAKE, HOLD, ACCELERATE):
        nodes, motion, pose = np.zeros(steps, np.int64), np.zeros((steps, 2)), np.zeros((steps, 4))
        used, agent, _ = drive(
            local_of(those),
            ego,
            assumed(scenario()),
            top,
            those.situation.state,
            those.command.speeds,
            0,
            5,
            begin,
            ego.max_decel,
            nodes,
            motion,
            pose,
        )
        plan = Plan(
            np.arange(used) * DT,
            motion[:used, 1],
            nodes[:used].astype(np.int32),
            motion[:used, 0],
            pose[:used],
        )
        if agent >= 0:
            assert (
                not ways[agent].exempt
                and clearance(those, plan, agent, ways[agent], used - 1)[0] < 2.0
            )
        size = ego.half_length, ego.half_width
        for i, way in enumerate(ways):
            for k in range(0, 0 if way.exempt else used - 1, 3):
                distance, driven = clearance(those, plan, i, way, k)
                assert distance > 0.0 or brakes_before(those, plan, way, size, k, driven)


VERDICTS = """
import json
from test_failsafe import LANES, Agent, case, on_lane, ready
result = []
for gap in (15.0, 40.0, 60.0):
    for side in (0, 1):
        those = case(LANES, on_lane(), Agent("ahead", "a_1", 205.0 + gap, 5.0), Agent("behind", "a_2", 200.0 - gap, 18.0), side=side)
        fail_safe = those.fail_safe
        said = fail_safe.objection(those.situation, those.command)
        result.append([said, [float(v).hex() for v in ready(fail_safe, those.situation).pose.ravel()]])
print(json.dumps(result))
"""


@pytest.mark.slow
def test_without_compilation_the_verdicts_are_the_same() -> None:
    def run(disable: str) -> Any:
        paths = [str(Path(__file__).parent), str(Path(helpers.__file__).parent), *sys.path]
        env = {**os.environ, "NUMBA_DISABLE_JIT": disable, "PYTHONPATH": os.pathsep.join(paths)}
        return json.loads(
            subprocess.run(
                [sys.executable, "-c", VERDICTS],
                env=env,
                capture_output=True,
                text=True,
                check=True,
                timeout=120,
            ).stdout
        )

    compiled = run("0")
    assert compiled == run("1")
    assert {said == "" for said, _ in compiled} == {True, False}


@given(st.floats(0.0, 30.0), st.floats(-9.0, 3.0), st.floats(0.0, 60.0))
def test_a_command_is_obeyed_as_far_as_it_is_let_through(v: float, a: float, wanted: float) -> None:
    those = case(LANES, on_lane(v))
    p = those.task.ego
    after, _ = obey(local_of(those), p, those.situation.state._replace(a=a), wanted, 0.0)
    assert after.v == pytest.approx(
        bounded(wanted, v, a, Bounds(DT, 3.0, p.max_accel, p.max_decel, p.emergency_jerk)), abs=1e-5
    )
    assert after.s == pytest.approx(200.0 + after.v * DT) and after.a == pytest.approx(
        (after.v - v) / DT, abs=1e-6
    )


# --- in SUMO ---


class Sick:
    """A planner that fails now and then."""

    needs_forecast = True

    def __init__(
        self,
        scene: ScenarioConfig,
        fails: Callable[[int], bool],
        failure: Callable[[Decision], Any],
    ) -> None:
        self._healthy, self._fails, self._failure, self._cycle = (
            make_planner(scene),
            fails,
            failure,
            0,
        )

    def start(self, task: Task, seed: int) -> None:
        self._healthy.start(task, seed)

    def plan(self, situation: Situation) -> Decision:
        self._cycle += 1
        decision = self._healthy.plan(situation)
        result: Decision = self._failure(decision) if self._fails(self._cycle) else decision
        return result


def episode(
    monkeypatch: pytest.MonkeyPatch,
    fails: Callable[[int], bool],
    failure: Callable[[Decision], Any],
    *sets: str,
) -> EpisodeResult:
    """The left turn at seed 1 with a sick planner."""
    healthy = factories.make_planner
    monkeypatch.setattr(
        "sumo_mcts.driver.driver.make_planner", lambda scene: Sick(scene, fails, failure)
    )
    monkeypatch.setattr(sys.modules[__name__], "make_planner", healthy)
    return run_episode(
        config.load(
            builtin.scenario_path("unprotected-left-turn"), ("planner.iterations=100", *sets)
        ),
        1,
    )


def raises(_: Decision) -> Any:
    raise RuntimeError("no idea")


def told(speeds: Any, side: int = 0) -> Callable[[Decision], Decision]:
    return lambda decision: decision._replace(command=Follow(speeds, side))


FAILURES: dict[str, tuple[Callable[[Decision], Any], str]] = {
    "raises": (raises, "RuntimeError: no idea"),
    "nothing": (lambda _: None, "no decision but NoneType"),
    "nan": (told(np.full(5, np.nan)), "a speed of nan m/s"),
    "infinite": (told(np.full(5, np.inf)), "a speed of inf m/s"),
    "shape": (told(np.zeros((2, 3))), "speeds of shape (2, 3)"),
    "empty": (told(np.zeros(0)), "speeds of shape (0,)"),
    "side": (told(np.full(5, 5.0), 7), "a lane change by 7"),
}


@pytest.mark.parametrize(
    ("name", "on"), [*((name, "true") for name in FAILURES), ("raises", "false"), ("nan", "false")]
)
def test_the_episode_survives_its_planner(
    name: str, on: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    failure, words = FAILURES[name]
    result = episode(
        monkeypatch, lambda cycle: cycle in (1, 9, 10, 11), failure, f"failsafe.on={on}"
    )
    row, notes = result.rows[0], [cycle.decision.reason for cycle in result.traces[0].cycles]
    assert row["outcome"] == "arrived", row
    assert row["failsafe_interventions"] >= 4
    assert all(
        notes[k].startswith("fail-safe: the planner failed: ") and words in notes[k]
        for k in (0, 8, 9, 10)
    )
    assert sum(note.startswith("fail-safe") for note in notes) == row["failsafe_interventions"]
    deviating = [cycle for cycle in result.traces[0].cycles[:-1] if cycle.deviation]
    assert not deviating  # the fail-safe manoeuvre, too, is driven as planned


def test_a_planner_that_only_fails_ends_the_episode_with_its_message(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    row = episode(monkeypatch, lambda cycle: cycle > 5, raises, "failsafe.most_failures=3").rows[0]
    assert (row["outcome"], row["error"]) == ("error", "PlannerError: RuntimeError: no idea")
    assert (row["cycles"], row["failsafe_interventions"]) == (8, 3)


def late(decision: Decision) -> Decision:
    time.sleep(0.3)
    return decision


@pytest.mark.slow
def test_a_late_decision_is_dropped_where_the_deadline_is_enforced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sets = ("planner.period_s=0.3", "planner.enforce_deadline=true")
    result = episode(monkeypatch, lambda cycle: cycle in (12, 13), late, *sets)
    row, notes = result.rows[0], [cycle.decision.reason for cycle in result.traces[0].cycles]
    assert row["outcome"] == "arrived" and row["deadline_misses"] >= 2
    assert all(note.startswith("fail-safe: late: ") for note in notes[11:13])
    assert row["failsafe_interventions"] == row["deadline_misses"]
    assert result.manifest["reproducible"] is False


class Loading:
    """A planner whose first decision compiles kernels, for longer than its deadline, and whose
    second one takes as long for no reason."""

    needs_forecast = False

    def __init__(self) -> None:
        self.decisions, self.left_s, self.took_s = 0, 0.0, 0.0

    def start(self, task: Task, seed: int) -> None:
        """Nothing to prepare."""

    def plan(self, situation: Situation) -> Decision:
        """Goes on at the present speed."""
        began, self.left_s = time.perf_counter(), situation.until - time.perf_counter()
        self.decisions += 1
        if self.decisions == 1:
            while time.perf_counter() - began < 0.4:
                entry(lambda x: x * x + 1.0)(situation.state.v)
            self.took_s = time.perf_counter() - began
        else:
            time.sleep(self.took_s)
        return Decision(Follow(np.full(5, situation.state.v), 0), None, (), -1, "on", 0, 0)


@pytest.mark.smoke
def test_compiling_a_kernel_does_not_make_a_decision_late() -> None:
    road = lanes_east()
    ego, planner = ego_at(road, "a_1", 100.0), Loading()
    settings = scenario("planner.time_budget_ms=300", "planner.enforce_deadline=true")
    mind = driver.Driver(settings, road, PHYSICS, 0, planner=planner)
    warm_up(settings, road, PHYSICS)
    first, second = (mind.decide(scene_of(ego, road)) for _ in range(2))
    assert not first.intervened and first.plan_ms < 300.0
    assert second.intervened and second.decision.reason.startswith("fail-safe: late: ")
    assert (
        planner.left_s > 0.16
    )  # the time that was lost to the kernel is not taken from the next search


def test_loading_counts_where_the_kernel_is_needed_and_not_elsewhere() -> None:
    watch, other = Stopwatch(), threading.Thread(target=entry(lambda x: x - 1.0), args=(2.0,))
    other.start()
    other.join()
    assert watch.loading_s == 0.0  # this thread was free to think meanwhile
    entry(lambda x: x + 2.0)(1.0)
    assert 0.0 < watch.loading_s < time.perf_counter() - watch.began
    assert watch.seconds == pytest.approx(
        time.perf_counter() - watch.began - watch.loading_s, abs=0.05
    )


def test_a_late_decision_is_executed_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    result = episode(monkeypatch, lambda cycle: cycle == 12, late, "planner.period_s=0.3")
    assert result.rows[0]["deadline_misses"] >= 1 and result.rows[0]["failsafe_interventions"] == 0
    assert result.manifest["reproducible"] is True


def blind(name: str, on: str, seed: int) -> EpisodeResult:
    return run_episode(
        config.load(builtin.scenario_path(name), ("planner.name=constant", f"failsafe.on={on}")),
        seed,
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["unprotected-left-turn", "unprotected-left-turn-scripted"])
def test_a_blind_planner_is_kept_safe(name: str) -> None:
    seeds = (1, 3)
    without = [blind(name, "false", seed).rows[0] for seed in seeds]
    assert all(row["outcome"] == "collision" and row["at_fault"] for row in without)
    assert all(row["failsafe_interventions"] == 0 for row in without)
    kept = [blind(name, "true", seed) for seed in seeds]
    assert not [result.rows[0] for result in kept if result.rows[0]["outcome"] == "collision"]
    for result in kept:
        notes = [
            cycle.decision.reason
            for cycle in result.traces[0].cycles
            if cycle.decision.reason.startswith("fail-safe")
        ]
        assert len(notes) == result.rows[0]["failsafe_interventions"] > 0
        assert all("m away" in note for note in notes)


@pytest.mark.slow
def test_the_fail_safe_leaves_a_good_planner_alone() -> None:
    rows = [
        run_episode(
            config.load(
                builtin.scenario_path("unprotected-left-turn"),
                ("planner.iterations=300", f"failsafe.on={on}"),
            ),
            2,
        ).rows[0]
        for on in ("true", "false")
    ]
    assert [row["failsafe_interventions"] for row in rows] == [0, 0]
    assert rows[0]["trace_digest"] == rows[1]["trace_digest"]


@pytest.mark.parametrize("given_option", [True, False])
def test_the_option_sets_the_key(given_option: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []

    def resolve(*arguments: Any, **_: Any) -> None:
        said.extend(arguments[4])
        raise config.ConfigError("enough")

    monkeypatch.setattr(scenarios, "resolve", resolve)
    assert (
        CliRunner()
        .invoke(app, ["run", "straight-line", *(["--enforce-deadline"] if given_option else [])])
        .exit_code
        == 2
    )
    assert ("planner.enforce_deadline=True" in said) == given_option
    scene = config.load(builtin.scenario_path("straight-line"), tuple(said))
    assert scene.planner.enforce_deadline == given_option
