"""What the article shows and claims, beside what an episode of ours shows.

The ego is judged by its recorded states, which are SUMO's, and by the row of the episode.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sumo_mcts.records import CycleRecord, Row, Trace
from sumo_mcts.road import RoadMap

STEADY = 0.5  # m/s: a speed that varies by less is kept
UNFELT = 1.0  # m/s2: others that brake less for the ego are not slowed down


class Claim(NamedTuple):
    """A sentence of the article about its figure, and whether it is true of our ego."""

    at: float | None  # s; None: of the end
    said: str
    holds: bool
    measured: str


class Figure(NamedTuple):
    """A figure of the article: moments of an episode."""

    name: str
    caption: str
    scenario: str
    times: tuple[float, ...]  # s
    claims: Callable[[Trace, RoadMap, Row], list[Claim]]


def left_turn(trace: Trace, road: RoadMap, row: Row) -> list[Claim]:
    """The claims about the left turn at 2, 4 and 6 s."""
    early, middle, late = (_nearest(trace, time) for time in (2.0, 4.0, 6.0))
    began, coming = _began(trace, 1), _coming_nearer(trace, early)
    speeds = [cycle.ego.v for cycle in trace.cycles if middle.time <= cycle.time <= late.time]
    through = bool(road.internal[late.ego.lane]) or late.ego.lane in _after_junction(trace, road)
    return [
        Claim(
            2.0,
            "detects a car that approaches, and changes to the left in advance",
            bool(coming) and began is not None and began <= early.time,
            f"sees {len(early.agents.ids)} cars, of which {len(coming)} come nearer; "
            f"{_change(began, 'left')}",
        ),
        Claim(
            4.0,
            "on its new lane, finds a gap and passes with the speed it has",
            road.left[middle.ego.lane] < 0 and float(np.ptp(speeds)) < STEADY,
            f"{'on' if road.left[middle.ego.lane] < 0 else 'not on'} the left lane; "
            f"{min(speeds):.1f} to {max(speeds):.1f} m/s until 6 s",
        ),
        Claim(
            6.0,
            "passes through the intersection without emergency braking",
            through and row["hard_brakes"] == 0 and row["collisions"] == 0,
            f"{'inside or through' if through else 'not in'} the junction; brakes with "
            f"{row['max_decel_mps2']:.1f} m/s2 at most, {row['collisions']} collisions",
        ),
        Claim(
            None,
            "does not slow down the traffic",
            row["outcome"] == "arrived" and row["imposed_max_decel_mps2"] < UNFELT,
            f"{row['outcome']}; others brake for it with {row['imposed_max_decel_mps2']:.1f} m/s2 "
            "at most",
        ),
    ]


def exit_cut_in(trace: Trace, road: RoadMap, row: Row) -> list[Claim]:
    """The claims about the exit with a sudden cut-in at 4, 5 and 11 s; `slow` cuts in."""
    early, middle, late = (_nearest(trace, time) for time in (4.0, 5.0, 11.0))
    began, speed = _began(trace, 1), _speed_of(early, "slow")
    ahead = _ahead_of(late, "slow")
    changing = middle.ego.changing > 0 and road.left[middle.ego.change_from] == middle.ego.change_to
    return [
        Claim(
            4.0,
            "detects a slow car that intends to cut in",
            _blinks_left(early, "slow") and speed < early.ego.v,
            f"sees it {'with' if _blinks_left(early, 'slow') else 'without'} its blinker, at "
            f"{speed:.0f} m/s; the ego has {early.ego.v:.0f} m/s",
        ),
        Claim(
            5.0,
            "changes to the left, neither colliding nor slowed down by the cut-in",
            changing and middle.ego.v >= early.ego.v and row["collisions"] == 0,
            f"{_change(began, 'left')}; {middle.ego.v:.1f} m/s at 5 s",
        ),
        Claim(
            11.0,
            "accelerates and overtakes it",
            ahead > 0 and late.ego.v > early.ego.v,
            f"{abs(ahead):.0f} m {'ahead of' if ahead > 0 else 'behind'} it, with "
            f"{late.ego.v:.0f} m/s",
        ),
        Claim(
            None,
            "changes lanes again and leaves the highway by the ramp",
            row["outcome"] == "arrived" and _began(trace, -1) is not None,
            f"{_change(_began(trace, -1), 'right')}; {row['outcome']} after "
            f"{row['travel_time_s']:.1f} s"
            if row["travel_time_s"] is not None
            else str(row["outcome"]),
        ),
    ]


FIGURES = (
    Figure(
        "left-turn",
        "The autonomous vehicle successfully negotiating an intersection without slowing down the "
        "traffic flow",
        "unprotected-left-turn",
        (2.0, 4.0, 6.0),
        left_turn,
    ),
    Figure(
        "exit-cut-in",
        "The autonomous vehicle successfully handles a sudden cut-in and exits the highway ramp in "
        "heavy traffic flow",
        "exit-cut-in",
        (4.0, 5.0, 11.0),
        exit_cut_in,
    ),
)

# The article's Table 1: near-optimal and collisions, %, by scene and number of iterations.
TABLE = {
    "unprotected-left-turn-scripted": {
        3000: (64.33, 4.33), 2500: (57.00, 7.00), 2000: (54.00, 10.67), 1000: (52.00, 17.33),
    },
    "highway-exit-scripted": {
        3000: (96.67, 0.33), 2500: (96.67, 0.33), 2000: (96.67, 0.33), 1000: (95.33, 0.33),
    },
    "straight-line-scripted": {
        3000: (99.67, 0.00), 2500: (99.67, 0.33), 2000: (99.33, 0.33), 1000: (100.00, 0.00),
    },
}  # fmt: skip


def _nearest(trace: Trace, time: float) -> CycleRecord:
    """The decision that is nearest to a time, s."""
    return min(trace.cycles, key=lambda cycle: abs(cycle.time - time))


def _coming_nearer(trace: Trace, cycle: CycleRecord) -> list[str]:
    """The agents whose distance to the ego is less at the next decision."""
    after = next((each for each in trace.cycles if each.time > cycle.time), cycle)
    now, then = _distances(cycle), _distances(after)
    return [name for name, metres in now.items() if then.get(name, metres) < metres]


def _distances(cycle: CycleRecord) -> dict[str, float]:
    """How far each agent is from the ego, m."""
    agents, ego = cycle.agents, cycle.ego
    return dict(zip(agents.ids, np.hypot(agents.x - ego.x, agents.y - ego.y).tolist(), strict=True))


def _began(trace: Trace, side: int) -> float | None:
    """When the first lane change to a side (1 left, -1 right) was commanded, s."""
    changes = (
        cycle.time
        for cycle in trace.cycles
        if getattr(cycle.decision.command, "lane_change", 0) == side
    )
    return next(changes, None)


def _change(began: float | None, side: str) -> str:
    return f"no change to the {side}" if began is None else f"change to the {side} at {began:.1f} s"


def _after_junction(trace: Trace, road: RoadMap) -> set[int]:
    """The ordinary lanes on which the ego was after its first junction."""
    lanes = [cycle.ego.lane for cycle in trace.cycles]
    inside = [k for k, lane in enumerate(lanes) if road.internal[lane]]
    return set() if not inside else {lane for lane in lanes[inside[0] :] if not road.internal[lane]}


def _speed_of(cycle: CycleRecord, name: str) -> float:
    """The speed of an agent, m/s; nan where it is not seen."""
    ids = cycle.agents.ids
    return float(cycle.agents.v[ids.index(name)]) if name in ids else float("nan")


def _blinks_left(cycle: CycleRecord, name: str) -> bool:
    ids = cycle.agents.ids
    return name in ids and int(cycle.agents.blinker[ids.index(name)]) == 1


def _ahead_of(cycle: CycleRecord, name: str) -> float:
    """How far the ego is ahead of an agent, in the direction in which it drives itself, m; nan
    where the agent is not seen."""
    if name not in cycle.agents.ids:
        return float("nan")
    n, ego = cycle.agents.ids.index(name), cycle.ego
    along = np.array([np.cos(ego.heading), np.sin(ego.heading)])
    return float(along @ (ego.x - cycle.agents.x[n], ego.y - cycle.agents.y[n]))
