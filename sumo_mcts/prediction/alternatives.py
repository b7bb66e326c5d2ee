"""What one agent may do instead of the likeliest, and the odds of it.

    TURNS    takes another turn that its lane allows
    FORCES   does not let the ego pass, though it has to
    BRAKES   brakes hard for no reason, goes on waiting, or stops walking on the ego's path
    STARTS   drives off after it has stood for a while

The odds are against the usual forecast, by Bayes' rule. They use what a sensor sees: turn signal,
speed, acceleration, the distance left, the time that the agent has stood.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices
from sumo_mcts.numerics.geometry import nearest
from sumo_mcts.numerics.lanes import limit, of_class, successors
from sumo_mcts.prediction.conflicts import FOE_BEGIN, MERGES, OWN_BEGIN, conflicts_of
from sumo_mcts.prediction.course import stop_signs
from sumo_mcts.prediction.drivers import TrafficParams
from sumo_mcts.prediction.forecast import Question
from sumo_mcts.prediction.paths import Paths, likely_paths
from sumo_mcts.road import LEFT, RIGHT, STRAIGHT, RoadMap
from sumo_mcts.scene import (
    BRAKES,
    FORCES,
    STANDING,
    STARTS,
    TURNS,
    Agents,
    EgoState,
    Forecast,
    Intent,
)

LEAST = 0.005  # odds below which an alternative gets no search of its own
EGO_VIEW = 100.0  # m of the ego's path on which other traffic matters
MOST_DUE = 3.0  # m/s2 of braking, due or unexplained, beyond which the odds grow no more
FOLLOWING = 4.0, 10.0  # s and m within which an agent ahead matters to the ego

# Turning.
TURN_VIEW = 50.0  # m before a branch within which drivers show that they are going to turn
SPREAD = 1.0  # m/s2, standard deviation of an acceleration about what the turn asks for
SHOWN = 0.9  # probability of a turn signal where the driver is going to turn
WRONG = 0.015  # probability of a left (or right) turn signal that means nothing
# The same for a vehicle that comes over from the next lane, which may be the reason of the signal
# (18 of 72 in the varied left turns).
COMES_OVER = 0.25
OFF_CENTRE = 0.01  # m off the centre line of its lane from which a vehicle comes over
TURNS_BACK = 0.02  # how often a driver turns round, against any other turn
LEAST_LIKELIHOOD = 1e-3  # of an acceleration, whatever it is

# Not letting the ego pass.
FORCING = 0.02  # odds, as long as the agent need not brake yet
NO_HURRY = 1.0  # m/s2: an agent that can still stop with this need not brake yet
FORCING_GAIN = 2.0  # growth of the logarithm of the odds for each m/s2 that is due and not seen

# Braking for no reason.
LEADERS = 2  # how many ahead of the ego may brake
BRAKING = 0.01  # odds without any sign of it
BRAKING_GAIN = 2.0  # growth of the logarithm of the odds for each m/s2 that nothing explains
SLOW = 2.0  # m/s: slower vehicles do not brake hard
CRAWLS = 1.0  # m/s below which an agent ahead waits
MOVING_OFF = 0.3  # m/s2 of smoothed acceleration above which it waits no longer
STAYING = 0.5  # odds that an agent that waits, and is expected to move off, goes on waiting

# Starting.
# s within which a start matters. Of agents that had stood for 2 to 4 s 14 of 35 started within 2 s,
# after 8 to 16 s 8 of 71 (docs/decisions/standing-and-crawling.md).
STARTING_S = 1.5
START_VIEW = 20.0  # m about the ego, and what it drives in a second, within which it matters

# Stopping while walking.
HALTING = 0.1  # odds: in SUMO a person that sees a vehicle come near may stop
BLOCKS_PATH = 2.0  # m from the centre of the ego's path to a person that stands in it


class Alternative(NamedTuple):
    """Something that an agent may do, and how likely it is against what it usually does."""

    odds: float
    intent: Intent


class _Evidence(NamedTuple):
    """What the odds are computed from."""

    road: RoadMap
    ego: EgoState
    agents: Agents  # those that change lanes on the lane that they move to
    paths: Paths  # row 0: the ego's, row i + 1: the usual one of agent i
    usual: Forecast
    expected: Floats  # [N] accelerations now if the agents did what is usual, m/s2
    params: TrafficParams


def alternatives(
    road: RoadMap, question: Question, agents: Agents, usual: Forecast, expected: Floats
) -> list[Alternative]:
    """What agents may do that matters to the ego, the likeliest first.

    `agents`: those that change lanes on the lane that they move to (paths.changing); `usual`: the
    forecast without alternatives; `expected` [N]: accelerations now if the agents did what is
    usual, whatever they did of late, m/s2.
    """
    scene, lanes, params = question.scene, question.ego_lanes, question.params
    paths = likely_paths(road, agents, scene.ego, lanes, {}, usual.dt * usual.v.shape[1])
    seen = _Evidence(road, scene.ego, agents, paths, usual, expected, params)
    found = [
        *_turning(seen),
        *_forcing(seen),
        *_braking(seen),
        *_starting(seen),
        *_halting(seen),
    ]
    return sorted((each for each in found if each.odds >= LEAST), key=lambda each: -each.odds)


# --- another turn ---


def _turning(seen: _Evidence) -> Iterator[Alternative]:
    """Agents about to come to where their lane branches, with each other turn that meets the ego's
    path."""
    road, agents, paths = seen.road, seen.agents, seen.paths
    meets, kind = _meeting(road, paths, seen.ego.s), of_class(agents.vclass)
    driven = seen.usual.v[0].sum(axis=0) * seen.usual.dt
    ego_lane = {int(lane): k for k, lane in enumerate(paths.lane[0, : paths.count[0]])}
    for i in np.flatnonzero((agents.lane >= 0) & (driven > 1.0)):
        if ego_lane.get(int(agents.lane[i])) == 0 and agents.s[i] < seen.ego.s:
            continue  # behind the ego: it cannot come before the ego has gone on
        k = _branch(road, paths, int(i) + 1, float(agents.s[i]))
        distance = paths.offset[i + 1, k + 1] - agents.s[i]
        if k < 0 or not 0.0 < distance < min(TURN_VIEW, driven[i]):
            continue
        likely, lane = int(paths.lane[i + 1, k + 1]), int(paths.lane[i + 1, k])
        usual = _turn_likelihood(seen, int(i), likely, distance)
        for turn in successors(road, lane):
            if (
                turn != likely
                and road.classes[turn] & road.classes[road.exit[turn]] & kind[i]
                and any(meets[inside] for inside in _through(road, turn))
            ):
                before = (int(x) for x in paths.lane[i + 1, : k + 1])
                yield Alternative(
                    _turn_likelihood(seen, int(i), turn, distance) / usual,
                    Intent(int(i), TURNS, (*before, *_through(road, turn))),
                )


def _turn_likelihood(seen: _Evidence, i: int, lane: int, distance: float) -> float:
    params, expected = seen.params, seen.expected[i]
    return turn_likelihood(
        seen.road, seen.agents, i, lane, distance, expected, params.decel, params.euler
    )


def turn_likelihood(
    road: RoadMap,
    agents: Agents,
    i: int,
    lane: int,
    distance: float,
    expected: float,
    decel: float,
    euler: float = 0.0,
) -> float:
    """Probability of the observations of agent i if it takes the lane `lane`, `distance` m ahead,
    times the share of drivers that do. A factor common to all lanes is left out.

    `expected`: its acceleration in the usual forecast, m/s2; `decel`: with which it brakes for a
    turn in comfort, m/s2; `euler`: as in TrafficParams.
    """
    turn, v = int(road.direction[lane]), float(agents.v[i])
    allowed = limit(road, lane, int(agents.vclass[i]))
    # The step that brings it onto the lane is driven with the speed at its end: until then it may
    # brake once more.
    distance += euler * (v + allowed)
    too_fast = max(0.0, (v * v - allowed * allowed) / (2.0 * max(distance, 1.0)) - decel)
    explained = decel if allowed < v - 1.0 else max(0.0, -expected)
    slows = max(0.0, -float(agents.trend[i]) - explained)
    often = 1.0 if turn in (STRAIGHT, LEFT, RIGHT) else TURNS_BACK
    blinker = int(agents.blinker[i])
    wrong = COMES_OVER if blinker * agents.d[i] < -OFF_CENTRE else WRONG
    return (
        often
        * signal_likelihood(turn, blinker, wrong)
        * max(math.exp(-0.5 * (too_fast**2 + slows**2) / SPREAD**2), LEAST_LIKELIHOOD)
    )


def signal_likelihood(turn: int, blinker: int, wrong: float = WRONG) -> float:
    """Probability of a turn signal (-1 right, 0 none, 1 left) before a turn.

    `wrong`: the probability that the signal is on for another reason.
    """
    if turn == STRAIGHT:
        return wrong if blinker else 1.0 - 2.0 * WRONG
    if blinker == 0:
        return 1.0 - SHOWN
    meant = 1 if turn == LEFT else -1 if turn == RIGHT else blinker
    return SHOWN - wrong if blinker == meant else WRONG


def _branch(road: RoadMap, paths: Paths, row: int, s: float) -> int:
    """The first lane of a path that ends within TURN_VIEW of `s` (m) and from which the path could
    go on otherwise; -1 where there is none."""
    ends, lanes = paths.offset[row, 1 : paths.count[row]] - s, paths.lane[row]
    for k, lane in enumerate(lanes[: np.searchsorted(ends, TURN_VIEW)].tolist()):
        if road.successor_offset[lane + 1] - road.successor_offset[lane] > 1:
            return k
    return -1


def _through(road: RoadMap, lane: int) -> list[int]:
    """A lane with those that follow it inside the junction, and the one behind it."""
    lanes = [lane]
    while road.internal[lanes[-1]] and successors(road, lanes[-1]):
        lanes.append(successors(road, lanes[-1])[0])
    return lanes


def _meeting(road: RoadMap, paths: Paths, ego_s: float) -> Bools:
    """[L] lanes that share a stretch with the next EGO_VIEW metres of the ego's path."""
    result = np.zeros(len(road.lane_ids), np.bool_)
    for lane, begin in zip(paths.lane[0, : paths.count[0]], paths.offset[0], strict=False):
        if begin - ego_s < EGO_VIEW:
            first, last = road.conflict_offset[lane], road.conflict_offset[lane + 1]
            result[lane] = True
            result[road.conflict_lane[first:last]] = True
    return result


# --- not letting the ego pass ---


def _forcing(seen: _Evidence) -> Iterator[Alternative]:
    """Agents that are expected to let the ego pass."""
    agents, yields = seen.agents, seen.usual.yields[0]
    if not yields.any():
        return
    foe, kind, place, _ = conflicts_of(seen.road, seen.paths)
    sign = stop_signs(seen.road, seen.paths)
    for i in np.flatnonzero(yields):
        meets = (
            (foe[i + 1] == 0)
            & (kind[i + 1] != MERGES)
            & (place[i + 1, :, OWN_BEGIN] > agents.s[i])
            & (place[i + 1, :, FOE_BEGIN] < seen.ego.s + EGO_VIEW)
        )
        if meets.any():
            begin = float(place[i + 1, meets, OWN_BEGIN].min())
            way = seen.paths.offset[i + 1, : sign.shape[1]]
            # a driver before a stop sign stops there whatever it does then: late braking shows
            # nothing
            stops = (sign[i + 1] & (way > agents.s[i]) & (way <= begin)).any()
            odds = (
                FORCING
                if stops
                else forcing_odds(
                    float(agents.v[i]), float(agents.trend[i]), begin - float(agents.s[i])
                )
            )
            yield Alternative(odds, Intent(int(i), FORCES))


def forcing_odds(v: float, trend: float, distance: float) -> float:
    """Odds that an agent `distance` m before the stretch where it has to wait does not; from its
    speed (m/s) and its smoothed acceleration (m/s2)."""
    due = v * v / (2.0 * max(distance - 2.0, 1.0)) - NO_HURRY
    return FORCING * math.exp(FORCING_GAIN * min(max(due - max(0.0, -trend), 0.0), MOST_DUE))


# --- braking for no reason ---


def _braking(seen: _Evidence) -> Iterator[Alternative]:
    """The nearest ahead of the ego on its path, if they move or have just come to a stand; and in
    each lane beside the nearest that shows that it does: the ego might change there."""
    agents, paths = seen.agents, seen.paths
    begins = {
        int(lane): float(begin)
        for lane, begin in zip(paths.lane[0, : paths.count[0]], paths.offset[0], strict=False)
    }
    for i in _ahead(seen, begins)[:LEADERS]:
        odds = _stopping_odds(seen, int(i))
        if agents.v[i] > SLOW or odds > BRAKING:  # an agent that has just come to a stand may stay
            yield Alternative(odds, Intent(int(i), BRAKES))
    for beside in (seen.road.left, seen.road.right):
        there = {int(beside[lane]): begin for lane, begin in begins.items() if beside[lane] >= 0}
        for i in _ahead(seen, {k: v for k, v in there.items() if k not in begins})[:1]:
            odds = _stopping_odds(seen, int(i))
            if odds > 1.0:  # likelier than not
                yield Alternative(odds, Intent(int(i), BRAKES))


def _stopping_odds(seen: _Evidence, i: int) -> float:
    """Odds that an agent brakes to a stand, or goes on waiting."""
    trend, expected = float(seen.agents.trend[i]), float(seen.expected[i])
    waits = seen.agents.v[i] < CRAWLS and trend < MOVING_OFF < expected
    return max(braking_odds(trend, expected), STAYING if waits else 0.0)


def _ahead(seen: _Evidence, begins: dict[int, float]) -> Indices:
    """Agents within the following distance ahead of the ego on lanes that begin so many metres from
    the start of its path, the nearest first."""
    agents, ego = seen.agents, seen.ego
    begin = np.array([begins.get(int(lane), math.inf) for lane in agents.lane])
    gap = begin + agents.s - agents.length - ego.s
    near = np.flatnonzero((gap > 0.0) & (gap < _following_distance(ego)))
    found: Indices = near[np.argsort(gap[near], kind="stable")]
    return found


def braking_odds(trend: float, expected: float) -> float:
    """Odds that an agent brakes hard to a stand; from its smoothed acceleration, and the one that
    is expected of it, m/s2."""
    unexplained = max(0.0, -trend) - max(0.0, -expected)
    return BRAKING * math.exp(BRAKING_GAIN * min(max(unexplained, 0.0), MOST_DUE))


def _following_distance(ego: EgoState) -> float:
    seconds, metres = FOLLOWING
    return metres + seconds * ego.v


# --- starting ---


def _starting(seen: _Evidence) -> Iterator[Alternative]:
    """The first on each lane near the ego, if it has stood for a while and is expected to stay."""
    agents, ego = seen.agents, seen.ego
    near = np.hypot(agents.x - ego.x, agents.y - ego.y) < START_VIEW + ego.v
    waits = (
        near
        & (agents.lane >= 0)
        & (agents.standing_s >= seen.params.stays_after)
        & (seen.usual.v[0].max(axis=0) < STANDING)
    )
    first = {
        int(agents.lane[i]): i for i in sorted(np.flatnonzero(waits), key=lambda i: agents.s[i])
    }
    for i in first.values():
        yield Alternative(starting_odds(float(agents.standing_s[i])), Intent(int(i), STARTS))


def starting_odds(standing_s: float) -> float:
    """Odds that an agent starts at once: what has lasted for a while goes on for as long again
    about as often as not."""
    return STARTING_S / max(standing_s, STARTING_S)


# --- stopping while walking ---


def _halting(seen: _Evidence) -> Iterator[Alternative]:
    """Persons that walk, and would stand on the ego's path if they stopped now."""
    agents, ego = seen.agents, seen.ego
    for i in np.flatnonzero(agents.person & (agents.v > STANDING)):
        x, y = float(agents.x[i]), float(agents.y[i])
        if math.hypot(agents.x[i] - ego.x, agents.y[i] - ego.y) < _following_distance(ego):
            if distance_to_path(seen.road, seen.paths, ego.s, x, y) < BLOCKS_PATH:
                yield Alternative(HALTING, Intent(int(i), BRAKES))


def distance_to_path(road: RoadMap, paths: Paths, ego_s: float, x: float, y: float) -> float:
    """Distance (m) from a point to the centre line of the ego's path, as far as the ego has it
    before it."""
    least = math.inf
    for lane, begin in zip(paths.lane[0, : paths.count[0]], paths.offset[0], strict=False):
        points = road.points[road.point_offset[lane] : road.point_offset[lane + 1]]
        along = begin + road.point_s[road.point_offset[lane] : road.point_offset[lane + 1]]
        # the share of each piece that lies behind the ego
        passed = (ego_s - along[:-1]) / np.maximum(np.diff(along), 1e-9)
        _, away = nearest(points[:-1], np.diff(points, axis=0), x, y, np.clip(passed, 0.0, 1.0))
        least = min([least, *away[passed < 1.0].tolist()])
    return least
