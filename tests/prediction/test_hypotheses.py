"""Hypotheses about what others will do: what they are, what they follow from, and that they are
forecasts like any other."""

from itertools import pairwise

import numpy as np
import pytest
from helpers import Agent, agents_at, crossing, edges, ego_at, lane, straight_road
from helpers_model import scene_of, traffic_params
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_mcts.prediction.alternatives import (
    COMES_OVER,
    FORCING,
    HALTING,
    LEAST,
    STAYING,
    alternatives,
    braking_odds,
    distance_to_path,
    forcing_odds,
    signal_likelihood,
    starting_odds,
    turn_likelihood,
)
from sumo_mcts.prediction.behaviour import HARD
from sumo_mcts.prediction.forecast import Question, expected_accels, ground_of, predict
from sumo_mcts.prediction.hypotheses import likeliest, predict_hypotheses
from sumo_mcts.prediction.paths import likely_paths
from sumo_mcts.road import ALLWAY, LEFT, RIGHT, STRAIGHT, VEHICLE_CLASSES, RoadMap
from sumo_mcts.scene import BRAKES, FORCES, STARTS, TURNS, EgoState, Forecast, Intent, Scene


def _crossing() -> RoadMap:
    """Of the ways from the west one goes straight on and one to the left."""
    road = crossing(bridge=False)
    direction = road.direction.copy()
    direction[lane(road, ":wn_0")] = LEFT
    return road._replace(direction=direction)


ROAD = _crossing()
NORTHBOUND = (1, 3)  # edges si, no: has to let the others pass
EASTBOUND = (0, 2)  # edges wi, eo: has the right of way
FIELDS = ("pose", "v", "lane", "s", "valid", "yields")


def ego_lanes(road: RoadMap, ego: EgoState) -> np.ndarray:
    """The ego's lanes through the crossing."""
    return np.array(
        [
            lane(road, name)
            for name in (
                ("wi_0", ":we_0", "eo_0") if ego.route == EASTBOUND else ("si_0", ":sn_0", "no_0")
            )
        ],
        np.int32,
    )


def question(scene: Scene, road: RoadMap = ROAD) -> Question:
    return Question(scene, ego_lanes(road, scene.ego), np.zeros(0), traffic_params(), 10.0)


def foreseen(scene: Scene, most: int, road: RoadMap = ROAD) -> Forecast:
    return predict_hypotheses(road, question(scene, road)._replace(hypotheses=most))


def usual(scene: Scene, intent: Intent | None = None, road: RoadMap = ROAD) -> Forecast:
    more = {} if intent is None else {"intent": intent}
    return predict(road, question(scene, road), **more)


def expected(scene: Scene, road: RoadMap = ROAD) -> np.ndarray:
    """What the agents would do now, whatever they did of late, m/s2."""
    params = traffic_params()._replace(persistence=0.0)
    plain = predict(road, question(scene, road)._replace(params=params))
    return (plain.v[0, 1] - plain.v[0, 0]) / plain.dt


def others(scene: Scene, road: RoadMap = ROAD) -> dict[tuple[int, int], float]:
    """Odds of every alternative, by agent and what it does."""
    asked = question(scene, road)
    agents = ground_of(road, asked).agents
    found = alternatives(road, asked, agents, usual(scene, road=road), expected(scene, road))
    return {(each.intent.agent, each.intent.does): each.odds for each in found}


def seen(scene: Scene, **columns: list[float]) -> Scene:
    """The scene with other columns of its agents."""
    return scene._replace(
        agents=scene.agents._replace(
            **{k: np.array(c, dtype=getattr(scene.agents, k).dtype) for k, c in columns.items()}
        )
    )


def may_turn(road: RoadMap = ROAD) -> Scene:
    """A car from the west that goes straight on or turns left, 30 m before the junction; the ego
    comes from the south."""
    return scene_of(
        ego_at(road, "si_0", 50.0, 8.0, route=NORTHBOUND), road, Agent("w", "wi_0", 60.0, 9.0)
    )


def may_force(v: float = 10.0, s: float = 55.0) -> Scene:
    """A car from the south that has to let the ego pass."""
    return scene_of(
        ego_at(ROAD, "wi_0", 55.0, 10.0, route=EASTBOUND), ROAD, Agent("n", "si_0", s, v)
    )


def behind(*ahead: Agent) -> Scene:
    """The ego at 10 m/s behind others on its lane."""
    return scene_of(ego_at(ROAD, "wi_0", 20.0, 10.0, route=EASTBOUND), ROAD, *ahead)


# --- forecasts ---


def test_one_hypothesis_is_the_plain_forecast() -> None:
    for scene in (may_turn(), may_force(), behind(Agent("a", "wi_0", 45.0, 10.0))):
        plain, single, several = usual(scene), foreseen(scene, 1), foreseen(scene, 8)
        assert len(several.weight) > 1 and single.weight.tolist() == [1.0]
        for name in FIELDS:  # and it is one of several
            assert np.array_equal(getattr(plain, name), getattr(single, name))
            assert any(
                np.array_equal(getattr(plain, name)[0], getattr(several, name)[h])
                for h in range(len(several.weight))
            )


agents = st.lists(
    st.tuples(st.sampled_from(["wi_0", "si_0", "eo_0", ":we_0", ":sn_0", ":wn_0"]),
    st.floats(0.0, 1.0), st.floats(0.0, 15.0), st.floats(-5.0, 2.0)), max_size=5
)  # fmt: skip


@given(
    agents,
    st.integers(1, 8),
    st.sampled_from([("wi_0", EASTBOUND), ("si_0", NORTHBOUND)]),
    st.integers(0, 2),
)
@settings(max_examples=40, deadline=None)
def test_of_any_scene(
    those: list[tuple[str, float, float, float]],
    most: int,
    ego: tuple[str, tuple[int, ...]],
    blinker: int,
) -> None:
    cars = [
        Agent(f"a{k}", on, share * float(ROAD.length[lane(ROAD, on)]), v)
        for k, (on, share, v, _) in enumerate(those)
    ]
    scene = scene_of(ego_at(ROAD, ego[0], 40.0, 9.0, route=ego[1]), ROAD, *cars)
    scene = seen(scene, trend=[trend for *_, trend in those], blinker=[blinker - 1] * len(those))
    forecast = foreseen(scene, most)
    count = len(forecast.weight)
    assert 1 <= count <= most and forecast.weight.sum() == pytest.approx(1.0)
    assert np.all(np.diff(forecast.weight) <= 0.0) and np.all(forecast.weight > 0.0)
    assert all(len(getattr(forecast, name)) == count for name in FIELDS)
    successors = [
        set(ROAD.successor[a:b].tolist())
        for a, b in zip(ROAD.successor_offset[:-1], ROAD.successor_offset[1:], strict=True)
    ]
    for h in range(count):
        assert np.array_equal(
            forecast.pose[h, 0], forecast.pose[0, 0]
        )  # everybody begins where he is
        for i in range(len(those)):
            way = list(dict.fromkeys(forecast.lane[h, :, i].tolist()))
            assert all(b in successors[a] for a, b in pairwise(way)), "only where lanes lead"


def test_no_more_than_asked_for_and_the_likeliest_of_them() -> None:
    scene = behind(
        Agent("a", "wi_0", 45.0, 10.0),
        Agent("b", "wi_0", 60.0, 10.0),
        Agent("n", "si_0", 55.0, 10.0),
    )
    weights = [foreseen(scene, most).weight for most in (1, 2, 3, 8)]
    assert [len(weight) for weight in weights] == [1, 2, 3, 1 + len(others(scene))]
    odds = sorted(others(scene).values(), reverse=True)
    for weight in weights:
        assert weight[1:] / weight[0] == pytest.approx(odds[: len(weight) - 1])


def test_constant_velocity_has_no_alternatives() -> None:
    scene = may_turn()
    params = traffic_params(interacting=False)
    forecast = predict_hypotheses(
        ROAD, question(scene)._replace(params=params, seconds=5.0, hypotheses=4)
    )
    assert forecast.weight.tolist() == [1.0]


# --- another way ---


def test_the_turn_signal_tells_the_way() -> None:
    plain = others(may_turn())[0, TURNS]
    assert 0.03 < plain < 0.3
    left = seen(may_turn(), blinker=[1])
    forecast = foreseen(left, 4)
    assert (
        lane(ROAD, ":wn_0") in forecast.lane[0, :, 0] and forecast.weight[0] > 0.95
    )  # nearly certain
    assert (
        others(seen(may_turn(), blinker=[-1]))[0, TURNS] > plain
    )  # something is going to happen, and there is no way to the right
    for turn in (STRAIGHT, LEFT, RIGHT):
        assert sum(signal_likelihood(turn, side) for side in (-1, 0, 1)) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("blinker", "d", "tells"), [(1, 0.0, True), (1, -0.4, False), (1, 0.4, True), (-1, 0.4, False)]
)
def test_the_turn_signal_of_who_comes_over_from_the_next_lane_tells_little(
    blinker: int, d: float, tells: bool
) -> None:
    """A car that has changed lanes to its left still has its left signal on until it is in the
    middle."""
    agents = seen(may_turn(), blinker=[blinker], d=[d]).agents
    straight, left = (
        turn_likelihood(ROAD, agents, 0, lane(ROAD, name), 30.0, 0.0, 2.5)
        for name in (":we_0", ":wn_0")
    )
    if blinker > 0:
        assert (left / straight > 20.0) == tells
    assert (straight > 0.9 * COMES_OVER * left) == (not tells or blinker < 0)


def test_both_ways_are_equally_likely_where_nothing_tells() -> None:
    road = ROAD._replace(
        direction=np.full_like(ROAD.direction, LEFT), speed=np.full_like(ROAD.speed, 15.0)
    )
    assert others(may_turn(road), road)[0, TURNS] == pytest.approx(1.0)


def test_slowing_down_makes_a_turn_likelier() -> None:
    fast = [Agent("w", "wi_0", 60.0, 11.0)]
    scene = may_turn()._replace(agents=agents_at(ROAD, *fast))
    odds = [others(seen(scene, trend=[trend]))[0, TURNS] for trend in (0.0, -1.0, -2.0)]
    assert odds == sorted(odds) and odds[2] > 3.0 * odds[0]


def test_too_fast_for_a_turn() -> None:
    assert (0, TURNS) in others(
        may_turn()._replace(agents=agents_at(ROAD, Agent("w", "wi_0", 86.0, 8.0)))
    )
    assert (0, TURNS) not in others(
        may_turn()._replace(agents=agents_at(ROAD, Agent("w", "wi_0", 86.0, 15.0)))
    )


@pytest.mark.parametrize("step", [0.1, 0.5, 1.0])
def test_who_brakes_by_whole_steps_is_not_too_fast_for_its_turn(step: float) -> None:
    """A driver brakes with 4.5 m/s2 so that it has the turn's speed at the end of the step that
    brings it onto the turn. Until then it is faster, however near the turn is."""
    turn, straight, distance = lane(ROAD, ":wn_0"), lane(ROAD, ":we_0"), -0.1
    scene = seen(may_turn(), blinker=[1])
    v = float(ROAD.speed[turn])
    while distance < 20.0:
        distance, v = distance + step * v, v + step * 4.5
        agents = scene.agents._replace(v=np.array([v]), trend=np.array([-4.5]))
        goes_left, goes_on = (
            turn_likelihood(ROAD, agents, 0, way, distance, 0.0, 4.4, 0.5 * step)
            for way in (turn, straight)
        )
        assert goes_left > 20.0 * goes_on


def test_only_ways_that_cars_may_take() -> None:
    classes = ROAD.classes.copy()
    classes[lane(ROAD, ":wn_0")] = 1 << VEHICLE_CLASSES.index("bus")
    assert (0, TURNS) in others(may_turn())
    assert (0, TURNS) not in others(may_turn(), ROAD._replace(classes=classes))


def test_only_ways_that_meet_the_egos() -> None:
    scene = may_turn()
    past = np.array([lane(ROAD, "eo_0")], np.int32)  # the ego's lanes, past the junction
    asked = question(scene)._replace(ego_lanes=past)
    found = alternatives(ROAD, asked, scene.agents, usual(scene), expected(scene))
    assert all(each.intent.does != TURNS for each in found)


def test_who_turns_is_led_along_the_turn() -> None:
    way = tuple(lane(ROAD, name) for name in ("wi_0", ":wn_0", "no_0"))
    turned = usual(may_turn(), Intent(0, TURNS, way))
    assert [*dict.fromkeys(turned.lane[0, :, 0].tolist())] == list(way)
    assert lane(ROAD, ":we_0") in usual(may_turn()).lane[0, :, 0]


# --- not letting the ego pass ---


@pytest.mark.parametrize("s", [60.0, 70.0, 78.0])
def test_late_braking_before_a_stop_sign_shows_nothing(s: float) -> None:
    rule = ROAD.rule.copy()
    rule[[lane(ROAD, name) for name in (":we_0", ":sn_0", ":wn_0")]] = ALLWAY
    road = ROAD._replace(rule=rule, conflict_yields=np.ones_like(ROAD.conflict_yields))
    ego = ego_at(road, "wi_0", 89.5, 0.0, route=(0, 2))
    scene = scene_of(ego, road, Agent("n", "si_0", s, 12.0))
    asked = question(scene)
    found = alternatives(road, asked, scene.agents, predict(road, asked), expected(scene))
    odds = [each.odds for each in found if each.intent == Intent(0, FORCES)]
    assert odds == [FORCING]


def test_who_forces_drives_through() -> None:
    waits, drives = usual(may_force()), usual(may_force(), Intent(0, FORCES))
    assert waits.yields.tolist() == [[True]] and drives.yields.tolist() == [[False]]
    assert waits.v[0, :, 0].min() < 5.0 and drives.v[0, :, 0].min() > 9.0
    assert (0, FORCES) in others(may_force())


def test_who_need_not_let_the_ego_pass_is_no_question() -> None:
    scene = scene_of(
        ego_at(ROAD, "si_0", 55.0, 10.0, route=NORTHBOUND), ROAD, Agent("w", "wi_0", 55.0, 10.0)
    )
    assert all(does != FORCES for _, does in others(scene))


def test_who_ought_to_brake_and_does_not_forces_more_likely() -> None:
    odds = [forcing_odds(10.0, 0.0, room) for room in (80.0, 40.0, 22.0, 18.0)]
    assert odds == sorted(odds) and odds[0] < 0.05 and odds[-1] > 5.0 * odds[0]
    assert forcing_odds(10.0, -2.5, 20.0) == odds[0]  # it brakes


# --- braking for no reason ---


def test_who_brakes_comes_to_a_stand_and_the_next_one_reacts() -> None:
    scene = behind(Agent("a", "wi_0", 45.0, 10.0), Agent("b", "wi_0", 65.0, 10.0))
    forecast = usual(scene, Intent(1, BRAKES))
    times = np.arange(forecast.v.shape[1]) * forecast.dt
    assert forecast.v[0, :, 1] == pytest.approx(np.maximum(10.0 - HARD * times, 0.0))
    assert usual(scene).v[0, :, 0].min() > 8.0
    assert forecast.v[0, -1, 0] < 0.5
    assert np.all(forecast.s[0, :, 1] - forecast.s[0, :, 0] > 5.0)


def test_only_the_nearest_ahead_brake() -> None:
    scene = behind(
        *(
            Agent(name, "wi_0", s, 10.0)
            for name, s in zip("abcd", (8.0, 40.0, 55.0, 70.0), strict=True)
        )
    )
    assert {i for i, does in others(scene) if does == BRAKES} == {
        1,
        2,
    }  # a is behind, d is the third


@pytest.mark.parametrize(
    ("v", "trend", "odds"),
    [(0.0, 0.0, STAYING), (0.5, 0.2, STAYING), (0.5, 0.5, 0.0), (1.5, 0.0, 0.0), (0.0, -3.0, 1.0)],
)
def test_who_waits_ahead_may_go_on_waiting_until_it_shows_that_it_does_not(
    v: float, trend: float, odds: float
) -> None:
    """Its forecast says that it moves off at once."""
    found = others(seen(behind(Agent("a", "wi_0", 45.0, v)), trend=[trend])).get((0, BRAKES), 0.0)
    assert found >= odds if trend < 0.0 else found == odds


def test_who_brakes_for_no_reason_goes_on_braking() -> None:
    odds = [braking_odds(trend, 0.5) for trend in (1.0, 0.0, -1.0, -2.0, -3.0)]
    assert odds == sorted(odds) and odds[0] == odds[1] > LEAST and odds[-1] > 1.0
    assert braking_odds(-2.0, -2.5) == odds[0]  # it has a reason
    forecast = foreseen(seen(behind(Agent("a", "wi_0", 45.0, 10.0)), trend=[-4.0]), 2)
    assert forecast.weight[0] > 0.5 and forecast.v[0, -1, 0] == 0.0  # the likeliest comes first


@pytest.mark.parametrize(
    ("trend", "v", "asked"),
    [(0.0, 10.0, False), (-1.0, 10.0, False), (-4.0, 10.0, True), (-4.0, 0.0, True)],
)
def test_who_comes_to_a_stand_in_the_lane_beside_matters_too(
    trend: float, v: float, asked: bool
) -> None:
    """Else an ego behind a car that stops would change behind another one that stops as well."""
    road = straight_road()
    cars = [Agent("a", "a_0", 45.0, 10.0), Agent("b", "a_1", 45.0, v)]
    scene = scene_of(ego_at(road, "a_0", 20.0, 10.0, route=edges(road, "a", "b")), road, *cars)
    scene = seen(scene, trend=[-4.0, trend])
    lanes = np.array([lane(road, name) for name in ("a_0", ":m_0", "b_0")], np.int32)
    asking = Question(scene, lanes, np.zeros(0), traffic_params(), 10.0)._replace(hypotheses=4)
    forecast = predict_hypotheses(road, asking)
    brakes = {intent.agent for intent in forecast.intents if intent.does == BRAKES}
    assert brakes == ({0, 1} if asked else {0})


# --- starting ---


def at_the_line(standing_s: float, s: float = 86.0, x: float = 75.0) -> Scene:
    """A car from the south that stands before the junction; the ego comes from the west."""
    scene = scene_of(
        ego_at(ROAD, "wi_0", x, 3.0, route=EASTBOUND), ROAD, Agent("n", "si_0", s, 0.0)
    )
    return seen(scene, standing_s=[standing_s])


def test_who_has_stood_for_a_while_may_start() -> None:
    forecast = foreseen(at_the_line(3.0, x=110.0), 4)  # the ego has passed
    starts = [h for h, intent in enumerate(forecast.intents) if intent.does == STARTS]
    assert len(starts) == 1
    assert forecast.v[0, :, 0].max() < 0.1 and forecast.v[starts[0], :, 0].max() > 5.0
    assert forecast.weight[starts[0]] / forecast.weight[0] == pytest.approx(starting_odds(3.0))


def test_the_longer_it_has_stood_the_less() -> None:
    odds = [starting_odds(s) for s in (0.0, 2.0, 4.0, 8.0, 20.0, 300.0)]
    assert (
        odds == sorted(odds, reverse=True) and odds[1] > 0.5 and odds[4] < 0.1 and odds[-1] <= LEAST
    )


def test_only_those_start_whom_nothing_but_patience_holds() -> None:
    def starts(scene: Scene) -> bool:
        return any(intent.does == STARTS for intent in foreseen(scene, 4).intents)

    assert starts(at_the_line(3.0, x=110.0))
    assert not starts(at_the_line(1.0, x=110.0))  # nobody expects it to stay
    assert not starts(at_the_line(3.0, s=40.0, x=110.0))  # far away
    queued = at_the_line(3.0, x=110.0)
    queued = queued._replace(
        agents=agents_at(ROAD, Agent("m", "si_0", 80.5, 0.0), Agent("n", "si_0", 86.0, 0.0))
    )
    queued = seen(queued, standing_s=[3.0, 600.0])
    assert not starts(queued)  # behind somebody who stays


# --- stopping on the way across the road ---

MIDDLE = -1.6  # m, y of the way of who comes from the west


def on_foot(y: float, v: float = 1.0, x: float = -40.0) -> Scene:
    """The ego comes from the west; somebody walks north, `y` m from the middle of its way, and
    ahead of it where x > -60."""
    walker = Agent("w", "", v=v, length=0.4, width=0.5, x=x, y=MIDDLE + y)
    return scene_of(ego_at(ROAD, "wi_0", 40.0, 8.0, route=EASTBOUND), ROAD, walker)


@pytest.mark.parametrize("y", [-1.5, 0.0, 1.5])
def test_who_walks_across_the_way_may_stop_on_it(y: float) -> None:
    forecast = foreseen(on_foot(y), 4)
    assert [intent.does for intent in forecast.intents][1:] == [BRAKES]
    assert forecast.weight[1] / forecast.weight[0] == pytest.approx(HALTING)
    walked = forecast.pose[:, -1, 0, 1] - forecast.pose[:, 0, 0, 1]
    assert walked == pytest.approx([10.0, 0.0]) and forecast.v[1, 1:, 0].max() == 0.0


@pytest.mark.parametrize(
    "scene",
    [on_foot(-4.0), on_foot(2.5), on_foot(0.0, v=0.0), on_foot(0.0, x=-70.0), on_foot(1.0, x=-5.0)],
)
def test_but_not_who_stands_or_walks_elsewhere(scene: Scene) -> None:
    assert not others(scene)


@given(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0))
def test_distance_from_the_way_against_points_on_it(x: float, y: float) -> None:
    ego = ego_at(ROAD, "wi_0", 70.0, 8.0, route=EASTBOUND)
    paths = likely_paths(ROAD, agents_at(ROAD), ego, ego_lanes(ROAD, ego), {}, 10.0)
    on_it = np.linspace(-30.0, 100.0, 2601)
    assert distance_to_path(ROAD, paths, 70.0, x, y) == pytest.approx(
        np.hypot(on_it - x, y - MIDDLE).min(), abs=0.06
    )


def test_worth_of_a_way_is_that_of_its_evidence() -> None:
    scene, straight, left = may_turn(), lane(ROAD, ":we_0"), lane(ROAD, ":wn_0")
    against = turn_likelihood(ROAD, scene.agents, 0, straight, 30.0, 0.0, 2.5)
    assert others(scene)[0, TURNS] == pytest.approx(
        turn_likelihood(ROAD, scene.agents, 0, left, 30.0, 0.0, 2.5) / against
    )


def test_the_likeliest_alone_is_the_first() -> None:
    scene = may_turn()
    several = foreseen(scene, 4)
    alone = likeliest(several)
    assert len(several.weight) > 1 and alone.weight.tolist() == [1.0]
    for name in ("pose", "v", "lane", "s", "valid", "yields"):
        assert (
            np.array_equal(getattr(alone, name)[0], getattr(several, name)[0])
            and len(getattr(alone, name)) == 1
        )


LEFT_WAY = tuple(lane(ROAD, name) for name in ("wi_0", ":wn_0", "no_0"))


@pytest.mark.parametrize("intent", [Intent(0, BRAKES), Intent(0, TURNS, LEFT_WAY)])
def test_what_hypotheses_have_in_common_is_the_same_for_each_alone(intent: Intent) -> None:
    asked = question(may_turn())
    ground = ground_of(ROAD, asked)
    alone, shared = (
        predict(ROAD, asked, intent=intent, **more) for more in ({}, {"ground": ground})
    )
    for name in FIELDS:
        assert np.array_equal(getattr(alone, name), getattr(shared, name)), name
    assert not np.array_equal(alone.pose, predict(ROAD, asked, ground=ground).pose)


@pytest.mark.parametrize("scene", [may_turn(), may_force(), may_force(4.0, 80.0)])
def test_the_expected_accelerations_are_those_of_a_forecast_without_habits(scene: Scene) -> None:
    asked = question(scene)
    found = expected_accels(ROAD, asked, ground_of(ROAD, asked))
    assert found.tolist() == expected(scene).tolist()
