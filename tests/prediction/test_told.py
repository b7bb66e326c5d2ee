"""What connected egos tell each other, and what it makes of a forecast. No SUMO."""

from dataclasses import dataclass

import numpy as np
import pytest
from helpers import Agent, agents_at, crossing, ego_at, lane
from helpers_model import PHYSICS, lanes_east, scenario, scene_of

from sumo_mcts.driver.forecaster import Cycle, Forecaster, LastDecision
from sumo_mcts.prediction.hypotheses import together
from sumo_mcts.prediction.interface import Oracles, no_plan
from sumo_mcts.prediction.told import Told, states_told, with_plans
from sumo_mcts.scene import BRAKES, USUAL, Forecast, Intent, Plan, Scene, Scripted

ROAD = lanes_east(1)
OTHER = 300.0  # m, where the front of the other ego is
STEP = 0.2  # s, of forecasts
LANES = np.zeros(1, np.int32)  # of the ego


def plan(v: np.ndarray, step: float = 0.1) -> Plan:
    """Drive at these speeds from OTHER on; a box is 5 m long."""
    s = OTHER + np.cumsum(v * step)
    pose = np.column_stack([s - 2.5, np.zeros(len(v)), np.ones(len(v)), np.zeros(len(v))])
    return Plan(step * np.arange(1.0, len(v) + 1), v, np.zeros(len(v), np.int32), s, pose)


def told(v: np.ndarray, at: float = 10.0, step: float = 0.1) -> Told:
    """A decision to do so, at the time `at` (s)."""
    return Told(ego_at(ROAD, "a_0", OTHER, 4.0), plan(v, step), at)


@dataclass
class Situation:
    """An ego behind another one that moves at 8 m/s."""

    scene: Scene
    forecast: Forecast


def situation(*sets: str) -> Situation:
    scene = scene_of(
        ego_at(ROAD, "a_0", 200.0, 8.0),
        ROAD,
        Agent("car", "a_0", 360.0, 9.0),
        Agent("other", "a_0", OTHER, 8.0),
    )
    forecaster = Forecaster(scenario(*sets), ROAD, PHYSICS, None)
    cycle = Cycle(scene, np.zeros(1, np.int32), LastDecision(), -np.inf)
    return Situation(scene, forecaster.ask("idm", cycle, 4.0))


# --- a plan as states ---


def test_a_plan_is_told_from_now_on() -> None:
    speeds = np.linspace(4.1, 6.0, 20)
    found = states_told(told(speeds), 10.0, STEP, 11)
    assert found.v == pytest.approx([4.0, *speeds[1::2]]), "where the ego is, then every other step"
    assert found.pose[0] == pytest.approx([OTHER - 2.5, 0.0, 1.0, 0.0])
    later = states_told(told(speeds), 10.5, STEP, 8)
    assert later.v == pytest.approx(speeds[4::2])
    assert later.s == pytest.approx(plan(speeds).s[4::2])
    assert later.pose == pytest.approx(plan(speeds).pose[4::2])
    assert later.valid.all()


def test_a_plan_is_told_as_far_as_it_reaches() -> None:
    assert (
        states_told(told(np.full(10, 5.0)), 10.5, STEP, 6).valid.tolist()
        == [True] * 3 + [False] * 3
    )
    assert not states_told(told(np.full(3, 5.0)), 10.5, STEP, 6).valid.any()


def test_between_two_steps_a_plan_is_in_between() -> None:
    """SUMO's step may be longer than the forecast's, or no part of it."""
    found = states_told(told(np.full(4, 6.0), step=0.5), 10.5, STEP, 3)
    assert found.s == pytest.approx(OTHER + 3.0 + np.array([0.0, 1.2, 2.4]))
    assert found.pose[:, 0] == pytest.approx(found.s - 2.5)


# --- in a forecast ---


def test_the_forecast_says_what_the_plan_says_in_every_hypothesis() -> None:
    seen = situation()
    usual = seen.forecast
    both = together([usual, usual._replace(intents=(Intent(0, BRAKES),))], [0.8, 0.2])
    states = states_told(told(np.linspace(8.0, 0.0, 60), at=0.0), 0.0, STEP, usual.v.shape[1])
    found = with_plans(both, ROAD, seen.scene.agents, LANES, {1: states})
    assert found.weight == pytest.approx([0.8, 0.2])
    for name in Scripted._fields:
        for h in range(2):
            assert (getattr(found, name)[h, :, 1] == getattr(states, name)).all()
            assert (getattr(found, name)[h, :, 0] == getattr(both, name)[h, :, 0]).all()
    assert (found.reacts == both.reacts).all() and (found.yields == both.yields).all()
    assert (both.pose[0] == usual.pose[0]).all(), "the predictor's own forecast is left alone"


def test_what_a_plan_contradicts_is_no_hypothesis() -> None:
    seen = situation()
    usual = seen.forecast
    intents = (Intent(-1, USUAL), Intent(0, BRAKES), Intent(1, BRAKES))
    three = together([usual._replace(intents=(each,)) for each in intents], [0.5, 0.3, 0.2])
    states = states_told(told(np.full(60, 5.0), at=0.0), 0.0, STEP, usual.v.shape[1])
    found = with_plans(three, ROAD, seen.scene.agents, LANES, {1: states})
    assert found.intents == intents[:2]
    assert found.weight == pytest.approx([0.625, 0.375])
    assert len(found.v) == len(found.yields) == 2
    only = with_plans(
        usual._replace(intents=intents[2:]), ROAD, seen.scene.agents, LANES, {1: states}
    )
    assert only.weight == pytest.approx([1.0])


def test_a_plan_has_no_margins() -> None:
    seen = situation("sensor.position_error_m=1.0")
    assert seen.forecast.half_length.min() > 2.5
    states = states_told(told(np.full(60, 5.0), at=0.0), 0.0, STEP, seen.forecast.v.shape[1])
    found = with_plans(seen.forecast, ROAD, seen.scene.agents, LANES, {1: states})
    assert found.half_length[1] == 2.5
    assert found.half_length[0] == seen.forecast.half_length[0]


# --- beyond the end of a plan ---


def after(v: np.ndarray) -> tuple[Forecast, Forecast, int]:
    """The forecast without and with a short plan, and the last row of the plan."""
    seen = situation()
    states = states_told(told(v, at=0.0), 0.0, STEP, seen.forecast.v.shape[1])
    found = with_plans(seen.forecast, ROAD, seen.scene.agents, LANES, {1: states})
    return seen.forecast, found, int(states.valid.sum()) - 1


def test_an_ego_that_stands_at_the_end_of_its_plan_goes_on_standing() -> None:
    _, found, end = after(np.linspace(8.0, 0.0, 10))
    assert (found.v[0, end:, 1] == 0.0).all()
    assert (found.pose[0, end:, 1] == found.pose[0, end, 1]).all()


def test_beyond_a_plan_an_ego_drives_as_predicted_from_there_on() -> None:
    usual, found, end = after(np.full(10, 8.0))
    assert (found.v[0, end + 1 :, 1] == usual.v[0, end + 1 :, 1]).all()
    assert (found.pose[0, end + 1 :, 1] == usual.pose[0, end + 1 :, 1]).all()


def test_where_no_predicted_path_leads_an_ego_drives_straight_on() -> None:
    usual, found, end = after(np.full(10, 120.0))  # far beyond where it could be
    rest = found.s[0, end:, 1]
    assert rest == pytest.approx(np.minimum(rest[0] + 120.0 * STEP * np.arange(len(rest)), 600.0))
    assert np.diff(found.pose[0, end:, 1, 0]) == pytest.approx(120.0 * STEP)
    assert found.v.shape == usual.v.shape


# --- who is asked ---


@pytest.mark.parametrize(
    ("connected", "asked"),
    [("both", ["other"]), ("the asking one", []), ("the other one", []), ("none", [])],
)
def test_only_connected_egos_ask_each_other(connected: str, asked: list[str]) -> None:
    questions: list[str] = []

    def planned(vehicle: str, now: float, step: float, count: int) -> Scripted:
        questions.append(vehicle)
        return states_told(told(np.full(60, 5.0), at=0.0), now, step, count)

    egos = [
        {"id": "ego", "connected": connected in {"both", "the asking one"}},
        {"id": "other", "connected": connected in {"both", "the other one"}},
        {"id": "far_away", "connected": True},
    ]
    seen = situation()
    oracles = Oracles(no_plan, no_plan, no_plan, planned)  # type: ignore[arg-type]  # not asked
    forecaster = Forecaster(scenario(egos=egos), ROAD, PHYSICS, oracles)
    cycle = Cycle(seen.scene, np.zeros(1, np.int32), LastDecision(), -np.inf)
    for name in ("idm", "constant_velocity"):
        questions.clear()
        found = forecaster.ask(name, cycle, 4.0)
        assert questions == asked
        assert (found.v[0, 1:, 1] == 5.0).all() == bool(asked)


@pytest.mark.parametrize("predicted", [False, True])
@pytest.mark.parametrize("owed", ["by the other", "by the ego", "by both", "by neither"])
def test_it_yields_where_it_has_to_or_is_expected_to(owed: str, predicted: bool) -> None:
    """Also where no driver would count on it: it knows the plan of the ego that it lets pass."""
    road = crossing(bridge=False)
    yields = np.zeros(len(road.conflict_lane), np.bool_)
    for who, name in (("by the ego", ":we_0"), ("by the other", ":sn_0")):
        one = lane(road, name)
        here = slice(road.conflict_offset[one], road.conflict_offset[one + 1])
        yields[here] = owed in (who, "by both")
    road = road._replace(conflict_yields=yields)
    agents = agents_at(road, Agent("other", "si_0", 88.0, 5.0))
    path = [lane(road, name) for name in ("si_0", ":sn_0", "no_0")]
    states = Scripted(
        pose=np.tile([1.6, -14.0, 0.0, 1.0], (6, 1)),
        v=np.full(6, 5.0),
        lane=np.repeat(np.array(path, np.int32), 2),
        s=np.arange(6.0),
        valid=np.ones(6, np.bool_),
    )
    none = np.zeros((1, 6, 1))
    usual = Forecast(
        dt=STEP,
        weight=np.ones(1),
        pose=np.zeros((1, 6, 1, 4)),
        v=none,
        lane=np.full((1, 6, 1), path[0], np.int32),
        s=none,
        valid=none == 0.0,
        half_length=agents.length / 2,
        half_width=agents.width / 2,
        reacts=np.ones(1, np.bool_),
        yields=np.array([[predicted]]),
    )
    ego_lanes = np.array([lane(road, name) for name in ("wi_0", ":we_0", "eo_0")], np.int32)
    found = with_plans(usual, road, agents, ego_lanes, {0: states})
    assert bool(found.yields[0, 0]) == (predicted or owed == "by the other")
    turned_off = with_plans(usual, road, agents, ego_lanes[:1], {0: states})
    assert bool(turned_off.yields[0, 0]) == predicted
