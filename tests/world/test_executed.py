"""The predicted ego is the executed ego: what a Plan says of the end of each decision period is
what SUMO then reports."""

import math
import subprocess
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import libsumo
import numpy as np
import pytest
import sumo
from helpers_networks import simulation

from sumo_mcts.config import ScenarioConfig, build, load
from sumo_mcts.config.builtin import scenario_path
from sumo_mcts.episode import EpisodeResult, run_episode
from sumo_mcts.episode.loop import Loop
from sumo_mcts.evaluation import hindsight
from sumo_mcts.model.local_map import LocalMap, State
from sumo_mcts.model.motion import FREE, advance, begin_change, can_change, pose_of
from sumo_mcts.planners.base import Situation, Task, local_of
from sumo_mcts.scene import Decision, Follow, Plan
from sumo_mcts.world.roadmap import read_roadmap
from sumo_mcts.world.simulation import is_ballistic

STRAIGHT, CROSSING = "straight-line", "unprotected-left-turn"
GAME = Path(sumo.SUMO_HOME) / "tools" / "game"
NETWORKS = Path(__file__).parent.parent.parent / "networks"
STEPS = [0.05, 0.1, 0.25, 0.5, 1.0]


class Erratic:
    """Does anything that it may, looks at nobody, and says beforehand what will come of it."""

    needs_forecast = False

    def start(self, task: Task, seed: int) -> None:
        """Take the ego over."""
        self._task, self._rng = task, np.random.default_rng(seed)

    def plan(self, situation: Situation) -> Decision:
        """A second of something."""
        task, state = self._task, situation.state
        local = local_of(task, situation)
        needed = int(np.sign(task.route.changes[state.node]))
        side = needed if needed and self._rng.random() < 0.8 else int(self._rng.integers(-1, 2))
        side = side if side and can_change(local, task.ego, state, side) else 0
        return self._driven(
            local, state, side, float(self._rng.choice([-8.0, -3.0, -1.0, 0.0, 1.0, 2.6, 2.6]))
        )

    def _driven(self, local: LocalMap, state: State, side: int, accel: float) -> Decision:
        task = self._task
        state = begin_change(local, task.ego, state, side) if side else state
        states, events = [], []
        for k in range(max(1, round(1.0 / task.ego.step))):
            state, event = advance(local, task.ego, state, accel, k * task.ego.step)
            states.append(state)
            events.append(event)
        plan = Plan(
            (np.arange(len(states)) + 1.0) * task.ego.step,
            np.array([s.v for s in states]),
            np.array([task.route.lane[s.node] for s in states], np.int32),
            np.array([s.s for s in states]),
            np.array([pose_of(local, task.ego, s) for s in states]),
        )
        over = next((k for k, event in enumerate(events) if event != FREE), len(events))
        return Decision(
            Follow(plan.v, side), Plan(*(field[:over] for field in plan)), (), -1, "erratic", 0, 0
        )


class Weaving(Erratic):
    """Stands, then goes from lane to lane, one change at once after the other, the first of them
    from a stand."""

    def plan(self, situation: Situation) -> Decision:
        """A second."""
        task, state = self._task, situation.state
        local = local_of(task, situation)
        drives = situation.scene.time > 8.0
        side = next(
            (side for side in (1, -1) if drives and can_change(local, task.ego, state, side)), 0
        )
        return self._driven(local, state, side, 1.0 if drives else -8.0)


def alone(name: str, step: float, change_s: float = 3.0, ballistic: bool = False) -> ScenarioConfig:
    """A built-in scene with nobody but the ego."""
    config = load(scenario_path(name))
    options = {"lanechange.duration": change_s, "step-method.ballistic": ballistic}
    return config.model_copy(
        update={
            "sumo": config.sumo.model_copy(update={"step_length_s": step, "options": options}),
            "traffic": config.traffic.model_copy(
                update={"actors": tuple(a for a in config.traffic.actors if a.id == "ego")}
            ),
            "episode": config.episode.model_copy(update={"time_limit_s": 120.0}),
        }
    )


class Difference(NamedTuple):
    """At the end of one decision period: where SUMO has the ego, and where the plan had it."""

    time: float
    lane: int
    planned_lane: int
    s: float  # m, executed less planned
    v: float  # m/s
    aside: float  # m between the centres
    turned: float  # degrees between the headings
    changing: float
    d: float


def differences(result: EpisodeResult) -> list[Difference]:
    """Of all periods that a plan covers."""
    found = []
    for trace in result.traces:
        for before, after in pairwise(trace.cycles):
            plan, ego = before.decision.plan, after.ego
            k = round((after.time - before.time) / before.step) - 1
            if plan is not None and k < len(plan.v):
                x, y, c, n = plan.pose[k]
                turned = math.degrees(abs(math.remainder(math.atan2(n, c) - ego.heading, math.tau)))
                place = (
                    after.time,
                    ego.lane,
                    int(plan.lane[k]),
                    float(ego.s - plan.s[k]),
                    float(ego.v - plan.v[k]),
                )
                found.append(
                    Difference(
                        *place, math.dist((x, y), (ego.x, ego.y)), turned, ego.changing, ego.d
                    )
                )
    return found


def changes_begun(result: EpisodeResult) -> int:
    return sum(
        cycle.decision.command.lane_change != 0
        for trace in result.traces
        for cycle in trace.cycles
        if isinstance(cycle.decision.command, Follow)
    )


def check(found: list[Difference], place: float = 0.01, speed: float = 0.001) -> None:
    for one in found:
        assert abs(one.s) < place and abs(one.v) < speed, one
        # Exactly in the middle between two lanes it is a matter of SUMO's rounding to which of them
        # a vehicle counts.
        assert one.lane == one.planned_lane or one.changing == pytest.approx(0.5, abs=1e-6), one


@pytest.mark.parametrize("ballistic", [False, True], ids=["euler", "ballistic"])
@pytest.mark.parametrize("change_s", [3.0, 0.0], ids=["3s", "jump"])
@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("name", [STRAIGHT, CROSSING])
def test_whatever_it_does_alone(
    name: str, step: float, change_s: float, ballistic: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sumo_mcts.driver.driver.make_planner", lambda _: Erratic())
    result = run_episode(alone(name, step, change_s, ballistic), seed=1)
    assert result.rows[0]["error"] is None
    found = differences(result)
    assert len(found) > 25 and changes_begun(result) > 3
    check(found)
    for one in found:
        if change_s == 0.0 and name == STRAIGHT:
            assert one.aside < 0.01 and one.turned < 0.5, one


def test_one_lane_change_at_once_after_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that begins at a stand takes SUMO a step longer than its duration, and a wish that comes
    in this step is dropped."""
    monkeypatch.setattr("sumo_mcts.driver.driver.make_planner", lambda _: Weaving())
    result = run_episode(alone(STRAIGHT, 0.1), seed=1)
    found = differences(result)
    assert changes_begun(result) > 3
    check(found)
    assert all(one.aside < 0.15 and one.turned < 5.0 for one in found)


def test_where_drivers_act_seldom(monkeypatch: pytest.MonkeyPatch) -> None:
    """SUMO then integrates ballistically, whatever its option says, and fails in lane changes of a
    vehicle that itself acts seldom."""
    monkeypatch.setattr("sumo_mcts.driver.driver.make_planner", lambda _: Erratic())
    config = alone(CROSSING, 0.1)
    seldom = config.sumo.model_copy(
        update={"options": {"lanechange.duration": 3.0, "default.action-step-length": 1.0}}
    )
    result = run_episode(config.model_copy(update={"sumo": seldom}), seed=1)
    assert result.rows[0]["error"] is None and changes_begun(result) > 3
    check(differences(result))


@pytest.mark.parametrize("name", [STRAIGHT, CROSSING, "highway-exit"])
def test_the_search_among_others(name: str) -> None:
    result = run_episode(load(scenario_path(name), ("planner.iterations=200",)), seed=3)
    found = differences(result)
    assert len(found) > 10
    check(found)
    for one in found:
        assert one.aside < 0.12 and one.turned < 2.5, one


@pytest.mark.slow
def test_where_people_drive_on_the_left(tmp_path: Path) -> None:
    """There SUMO counts lanes and lateral positions from the other side."""
    sources = [
        flag + str(NETWORKS / STRAIGHT / f"{STRAIGHT}.{kind}.xml")
        for flag, kind in (("-n=", "nod"), ("-e=", "edg"), ("-x=", "con"))
    ]
    net_file = tmp_path / "left.net.xml"
    subprocess.run(
        [
            str(Path(sumo.SUMO_HOME) / "bin" / "netconvert"),
            *sources,
            "--lefthand",
            f"--output-file={net_file}",
        ],
        check=True,
        capture_output=True,
    )
    road = read_roadmap(str(net_file))
    assert (
        road.lefthand
        and not read_roadmap(str(NETWORKS / STRAIGHT / f"{STRAIGHT}.net.xml")).lefthand
    )
    lanes = [road.lane_ids.index(f"road_{k}") for k in (2, 1, 0)]
    assert road.index[lanes].tolist() == [0, 1, 2] and road.left[lanes].tolist() == [
        lanes[1],
        lanes[2],
        -1,
    ]
    config = load(scenario_path(STRAIGHT), ("planner.iterations=200",))
    result = run_episode(
        config.model_copy(update={"sumo": config.sumo.model_copy(update={"net": str(net_file)})}),
        seed=3,
    )
    assert result.rows[0]["lane_changes"] > 0
    found = differences(result)
    check(found)
    for one in found:
        assert one.aside < 0.12 and one.turned < 2.5, one
    for cycle in result.traces[0].cycles:
        assert (
            np.abs(cycle.forecast.pose[0, 1, :, 1] - cycle.forecast.pose[0, 0, :, 1]).max(
                initial=0.0
            )
            < 0.6
        ), "an agent jumps to its mirror image"


@pytest.mark.slow
def test_where_lanes_and_their_shapes_differ_in_length() -> None:
    data = {
        "name": "grid6",
        "sumo": {"sumocfg": str(GAME / "grid6.sumocfg")},
        "egos": [{"id": "topBottom.0"}],
        "planner": {"iterations": 100},
        "episode": {"time_limit_s": 60},
    }
    found = differences(run_episode(build(data, "test"), seed=1))
    assert len(found) > 10
    check(found, place=0.3)


@pytest.mark.parametrize(
    ("name", "seed"), [(STRAIGHT, 1), (STRAIGHT, 4), ("highway-exit", 1), (CROSSING, 1)]
)
def test_an_escape_is_one_in_sumo(name: str, seed: int) -> None:
    """What the search for an escape finds, driven: the box is where and as it was expected, and
    touches no other."""
    with mock.patch.object(hindsight, "escape", wraps=hindsight.escape) as search:
        loop = Loop(load(scenario_path(f"{name}-scripted")), seed)
        loop.scenes()
    local, p, state, choice, home, (ply, *_) = search.call_args.args
    for k, action in enumerate(hindsight.escape(*search.call_args.args)):
        accel, side = float(choice[action, 0]), int(choice[action, 1])
        state = begin_change(local, p, state, side) if side else state
        speeds = np.zeros(ply)
        for i in range(ply):
            state, _ = hindsight.drive(local, p, home, state, accel, k * ply + i, 1, 1)
            speeds[i] = state.v
        loop.apply({"ego": Decision(Follow(speeds, side), None, (), -1, "escape", 0, 0)})
        scenes = loop.scenes()
        if not scenes:
            break
        ego, (x, y, c, n) = scenes["ego"].ego, pose_of(local, p, state)
        assert math.dist((ego.x, ego.y), (x, y)) < 0.12, (
            k
        )  # whoever stands goes sideways a little slower in SUMO
        assert abs(math.remainder(ego.heading - math.atan2(n, c), 2.0 * math.pi)) < 0.04, k
    loop.close()
    assert loop.rows()[0]["outcome"] in (None, "arrived")


@pytest.mark.parametrize(
    ("types", "expected"),
    [('<vType id="t"/>', False), ('<vType id="t" actionStepLength="1.0"/>', True)],
)
def test_how_sumo_integrates_is_told_without_touching_the_traffic(
    tmp_path: Path, types: str, expected: bool
) -> None:
    """Asking SUMO for a type draws from its random numbers where that is a distribution."""
    vehicles = "".join(
        f'<vehicle id="v{k}" type="any" depart="{k}"><route edges="from_west to_east"/></vehicle>'
        for k in range(20)
    )
    distribution = (
        '<vTypeDistribution id="any"><vType id="a" maxSpeed="8" speedDev="0.2"/><vType '
        'id="b" speedDev="0.3"/></vTypeDistribution>'
    )
    (tmp_path / "x.rou.xml").write_text(f"<routes>{types}{distribution}{vehicles}</routes>")
    seen = []
    for ask in (False, True):
        with simulation(str(NETWORKS / "crossing" / "crossing.net.xml"), [tmp_path / "x.rou.xml"]):
            if ask:
                assert is_ballistic() == expected
            for _ in range(250):
                libsumo.simulationStep()
            seen.append(
                [libsumo.vehicle.getPosition(name) for name in sorted(libsumo.vehicle.getIDList())]
            )
    assert len(seen[0]) > 5 and seen[0] == seen[1]
