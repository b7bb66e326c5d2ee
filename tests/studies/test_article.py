"""The article's figures and table: what its text claims holds in a recorded episode, and is denied
where it does not."""

from functools import cache
from typing import Any

import helpers_article
import numpy as np
import pytest

from sumo_mcts import load_scenario, run_episode
from sumo_mcts.commands.article import claims_table
from sumo_mcts.episode.run import EpisodeResult
from sumo_mcts.records import Trace
from sumo_mcts.scene import Agents
from sumo_mcts.studies import article
from sumo_mcts.studies.article import Figure

FIGURES = pytest.mark.parametrize("figure", article.FIGURES, ids=[f.name for f in article.FIGURES])


@cache
def episode(name: str) -> EpisodeResult:
    """The episode that the figure shows."""
    return run_episode(load_scenario(name), 0)


def truth(figure: Figure, trace: Trace | None = None, **row: Any) -> list[bool]:
    """Which claims hold, in an episode that is changed in some way."""
    found = episode(figure.scenario)
    claims = figure.claims(trace or found.traces[0], found.road, {**found.rows[0], **row})
    assert [claim.at for claim in claims] == [*figure.times, None]
    return [bool(claim.holds) for claim in claims]


def places(name: str, who: str) -> np.ndarray:
    """[K, 4] time, x, y, v of a vehicle in every cycle in which it is seen."""
    rows = []
    for cycle in episode(name).traces[0].cycles:
        if who == "ego":
            rows.append((cycle.time, cycle.ego.x, cycle.ego.y, cycle.ego.v))
        elif who in cycle.agents.ids:
            n, agents = cycle.agents.ids.index(who), cycle.agents
            rows.append((cycle.time, agents.x[n], agents.y[n], agents.v[n]))
    return np.array(rows)


@FIGURES
def test_all_that_the_article_claims_holds(figure: Figure) -> None:
    assert truth(figure) == [True] * 4


def test_the_left_turn_in_places_and_speeds() -> None:
    t, x, y, v = places("unprotected-left-turn", "ego").T
    at = {time: int(np.argmin(np.abs(t - time))) for time in (2, 4, 6)}
    assert y[at[2]] > y[0] + 1  # on its way from the middle lane to the left one
    assert y[at[4]] == pytest.approx(-1.75, abs=0.3) and x[at[4]] < -6.5  # left, before the line
    assert -6.5 < x[at[6]] < 22.5 and y[at[6]] > 0  # inside the junction, turning
    assert np.ptp(v[at[4] : at[6] + 1]) < 0.5
    assert np.diff(v).min() > -0.5 * 2.0  # in half a second


def test_the_exit_in_places_and_speeds() -> None:
    ego, slow = (places("exit-cut-in", who) for who in ("ego", "slow"))
    t, x, _, v = ego.T
    at = {time: int(np.argmin(np.abs(t - time))) for time in (4, 5, 11)}
    assert x[at[4]] < slow[at[4], 1] - 20 and slow[at[4], 3] < 5 < v[at[4]]
    lanes = [cycle.ego.lane for cycle in episode("exit-cut-in").traces[0].cycles]
    assert max(lanes) == lanes[0] + 1 and min(lanes[: len(lanes) // 2]) == lanes[0]
    behind = slow[np.argmin(np.abs(slow[:, 0] - 11))]
    assert behind[1] < x[at[11]] - 10 and v[at[11]] > v[at[4]]
    assert episode("exit-cut-in").rows[0]["outcome"] == "arrived"


@FIGURES
def test_claims_are_denied_where_they_do_not_hold(figure: Figure) -> None:
    trace = episode(figure.scenario).traces[0]
    first = trace.cycles[0].ego
    kept = tuple(
        cycle._replace(
            ego=cycle.ego._replace(lane=first.lane, v=5.0, changing=0.0, x=first.x, y=first.y),
            decision=cycle.decision._replace(
                command=cycle.decision.command._replace(lane_change=0)
            ),
            agents=cycle.agents._replace(blinker=0 * cycle.agents.blinker),
        )
        for cycle in trace.cycles
    )
    told = truth(figure, trace._replace(cycles=kept))
    assert told[:3] == [False] * 3
    assert truth(figure, outcome="timeout")[3] is False


def changed(trace: Trace, at: float, **ego: float) -> Trace:
    """The trace with other values of the ego at the decision nearest to a time, s."""
    times = [abs(cycle.time - at) for cycle in trace.cycles]
    k = times.index(min(times))
    cycle = trace.cycles[k]
    cycle = cycle._replace(ego=cycle.ego._replace(**ego))
    return trace._replace(cycles=(*trace.cycles[:k], cycle, *trace.cycles[k + 1 :]))


def test_who_sees_nobody_come_detects_nobody() -> None:
    left = article.FIGURES[0]
    trace = episode(left.scenario).traces[0]
    nobody = {name: getattr(trace.cycles[0].agents, name)[:0] for name in Agents._fields}
    alone = [cycle._replace(agents=Agents(**nobody)) for cycle in trace.cycles]
    assert truth(left, trace._replace(cycles=tuple(alone))) == [False, True, True, True]
    leaving = [
        cycle._replace(agents=cycle.agents._replace(x=cycle.agents.x + 1000 + 100 * cycle.time))
        for cycle in trace.cycles
    ]
    assert truth(left, trace._replace(cycles=tuple(leaving))) == [False, True, True, True]


def test_the_cut_in_is_by_somebody_slow_and_the_ego_does_not_slow_down() -> None:
    cut_in = article.FIGURES[1]
    trace = episode(cut_in.scenario).traces[0]
    early = min(trace.cycles, key=lambda cycle: abs(cycle.time - 4.0))
    slow = float(early.agents.v[early.agents.ids.index("slow")])
    for at, v, told in (
        (4.0, slow - 0.1, [False, True, True, True]),
        (5.0, early.ego.v - 0.1, [True, False, True, True]),
        (11.0, early.ego.v - 0.1, [True, True, False, True]),
    ):
        assert truth(cut_in, changed(trace, at, v=v)) == told


def test_a_collision_and_hard_braking_deny_what_they_concern() -> None:
    left, cut_in = article.FIGURES
    assert truth(left, hard_brakes=1) == [True, True, False, True]
    assert truth(left, collisions=1)[2] is False
    assert truth(left, imposed_max_decel_mps2=2.0) == [True, True, True, False]
    assert truth(cut_in, collisions=1) == [True, False, True, True]


def test_the_page_says_what_is_measured() -> None:
    tables = []
    for figure in article.FIGURES:
        found = episode(figure.scenario)
        tables.append(claims_table(figure.claims(found.traces[0], found.road, found.rows[0])))
        assert (helpers_article.PICTURES / f"{figure.name}.png").is_file()
    assert helpers_article.PAGE.read_text(encoding="utf-8") == helpers_article.page(tables)
