"""The ego drives by each rule of the road as SUMO's driver does."""

import pytest

from sumo_mcts.config import builtin, load
from sumo_mcts.episode.run import run_episode
from sumo_mcts.situations import RULES

SEED = 1
MOST = 1.2  # travel time over SUMO's driver's, in each


def row_of(kind: str, planner: str) -> dict:
    """How an episode of a rule ends."""
    config = load(builtin.scenario_path(f"rule-{kind}"), (f"planner.name={planner}",))
    (row,) = run_episode(config, SEED).rows
    return row


@pytest.mark.slow
@pytest.mark.parametrize("kind", RULES)
def test_the_ego_keeps_a_rule_and_arrives_when_sumos_driver_does(kind: str) -> None:
    ego, twin = (row_of(kind, planner) for planner in ("mcts", "sumo"))
    assert ego["outcome"] == twin["outcome"] == "arrived", ego["error"]
    assert (ego["collisions"], ego["red_lights_run"], ego["speeding_share"]) == (0, 0, 0.0)
    assert ego["travel_time_s"] < MOST * twin["travel_time_s"]
