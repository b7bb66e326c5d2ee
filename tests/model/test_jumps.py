"""What the ego owes where vehicles jump over a junction without lanes inside."""

import pytest
from helpers import Agent, edges, ego_at
from helpers_model import compiled, local_of, scene_of, task_of
from helpers_networks import four_arms

from sumo_mcts.model.local_map import ENTERS, JOINS, JUMPS, MERGES, OWN_NODE, STRETCH_END
from sumo_mcts.model.occupancy import yielding_cost
from sumo_mcts.model.reactions import undisturbed
from sumo_mcts.road import RoadMap
from sumo_mcts.world.roadmap import read_roadmap

yielding_cost = compiled(yielding_cost)
LINE = 120.0  # m, where the lanes end
DRAWN = 14.4  # m from there to where the lanes behind begin
V = 13.9  # m/s


@pytest.fixture(scope="module")
def road(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    folder = tmp_path_factory.mktemp("jumps")
    return read_roadmap(four_arms(folder, "priority", "--no-internal-links", "true"))


def price(on: RoadMap, at: float, away: float, v: float = V) -> float:
    """Cost per second for an ego that is `at` m behind the junction, while a car of the main road is
    `away` m before its line."""
    ego = ego_at(on, "sc_0", LINE - 1.0, v, route=edges(on, "sc", "cn"))
    task = task_of(on, ego)
    local, state = local_of(task, scene_of(ego, on, Agent("a", "wc_0", LINE - 20.0, V)))
    (row,) = local.obligation
    onto = int(row[OWN_NODE])
    assert task.route.lane[onto] == on.lane_ids.index("cn_0") and row[MERGES] == JUMPS
    assert row[STRETCH_END] == pytest.approx(DRAWN) and row[ENTERS] == pytest.approx(20.0)
    row[ENTERS] = away
    there = state._replace(node=onto, s=at)
    return float(yielding_cost(local, task.ego, task.cost, there, undisturbed(local), 0))


@pytest.mark.parametrize(
    ("at", "away", "due"),
    [
        (1.0, 10.0, True),  # it comes within a second,
        (1.0, 20.0, False),  # later,
        (1.0, -2.0, True),  # its rear is not over yet,
        (1.0, -6.0, False),  # it is
        (6.0, 10.0, False),  # the ego's is
    ],
)
def test_who_jumps_across_has_a_second_of_room(
    road: RoadMap, at: float, away: float, due: bool
) -> None:
    assert (price(road, at, away) > 0.0) == due


def test_the_short_jump_costs_as_much_as_the_way_as_drawn(road: RoadMap) -> None:
    """Its rear is over after the ego's length of 5 m."""
    claim = task_of(road, ego_at(road, "sc_0", 10.0, route=edges(road, "sc", "cn"))).cost.claim
    assert price(road, 1.0, -2.0) == pytest.approx(claim * (DRAWN + 5.0) / 5.0)


def test_who_comes_onto_the_same_lane_follows_the_ego(road: RoadMap) -> None:
    """From the main road to the right: the forecast of one that blinks so leads there."""
    ego = ego_at(road, "sc_0", LINE - 1.0, V, route=edges(road, "sc", "cn"))
    scene = scene_of(ego, road, Agent("a", "ec_0", LINE - 20.0, V))
    agents = scene.agents._replace(blinker=scene.agents.blinker * 0 - 1)
    (row,) = local_of(task_of(road, ego), scene._replace(agents=agents))[0].obligation
    assert row[MERGES] == JOINS
