"""What others may do instead of what is likeliest: weighted hypotheses, from what a sensor sees.

Five things an agent may do: take another of the ways that its lane allows, not let the ego pass
though it has to, brake hard for no reason, start though it has stood for a while, stop on its way
across the road. Each is an alternative with odds against the usual forecast, by Bayes' rule from
turn signal, speed, acceleration, the distance left and the time that it has stood. The joint
hypotheses are the usual forecast and those that differ from it in one agent; agents are taken to be
independent of each other, so the odds are also those of the joint hypotheses. Two unlikely things
at once are left out.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.numerics.geometry import nearest
from sumo_mcts.numerics.lanes import successors
from sumo_mcts.prediction.behaviour import TrafficParams
from sumo_mcts.prediction.forecast import OracleData, predict
from sumo_mcts.prediction.paths import MERGES, Paths, changing, conflicts_of, likely_paths, of_class
from sumo_mcts.scene import (
    BRAKES,
    FORCES,
    LEFT,
    RIGHT,
    STANDING,
    STARTS,
    STRAIGHT,
    TURNS,
    Agents,
    Bools,
    EgoState,
    Floats,
    Forecast,
    Intent,
    Ints,
    RoadMap,
    Scene,
)

OF_HYPOTHESES = ("pose", "v", "lane", "s", "valid", "yields")  # what a Forecast has for each
LEAST = 0.005  # odds below which an alternative is not worth a search of its own
EGO_VIEW = 100.0  # m of the ego's way on which it matters who else may come
TURN_VIEW = 50.0  # m before a branch within which a driver who is going to turn shows it
SPREAD = 1.0  # m/s2, standard deviation of an acceleration about what the way asks for
SHOWN = 0.9  # probability that who turns has the turn signal on ...
WRONG = 0.015  # ... and that it is on, left or right, where it means nothing
# the same for who comes over from the next lane: it may be on for that (18 of 72 in the varied left
# turns)
COMES_OVER = 0.25
OFF_CENTRE = 0.01  # m from the centre line of its lane from which somebody comes over
TURNS_BACK = 0.02  # how often anybody turns round, against any other way
FORCING = (
    0.02  # odds that one who has to let the ego pass does not, as long as it need not brake yet
)
NO_HURRY = 1.0  # m/s2: whoever could still stop with this need not brake yet
FORCING_GAIN = (
    2.0  # growth of the logarithm of these odds for each m/s2 of braking that is due and not seen
)
BRAKING = 0.01  # odds that one ahead brakes hard, as long as nothing tells
BRAKING_GAIN = (
    2.0  # growth of the logarithm of these odds for each m/s2 of braking that nothing explains
)
# s within which it matters that somebody starts (docs/tried.md: 14 of 35 did so within 2 s after 2
# to 4 s, 8 of 71 after 8 to 16 s)
STARTING_S = 1.5
START_VIEW = 20.0  # m about the ego, and what it drives in a second, within which it matters
MOST_TOLD = 3.0  # m/s2 beyond which neither tells any more
CRAWLS = 1.0  # m/s below which somebody ahead waits
MOVING_OFF = 0.3  # m/s2 of acceleration of late that show that it waits no longer
STAYING = 0.5  # odds that one ahead that waits, and is expected to move off, goes on waiting
SLOW = 2.0  # m/s below which nobody is in danger of braking hard
LEADERS = 2  # how many ahead of the ego may brake
FOLLOWING = 4.0  # s within which somebody ahead is followed (and 10 m)
# odds that who walks across the ego's way stops on it: in SUMO whoever sees a vehicle come near may
HALTING = 0.1
IN_THE_WAY = 2.0  # m from the middle of the ego's way to who stands in it


class Alternative(NamedTuple):
    """Something that an agent may do, and how likely it is against what it usually does."""

    odds: float
    intent: Intent


def predict_hypotheses(
    road: RoadMap, scene: Scene, ego_lanes: Ints, nominal: Floats, params: TrafficParams,
    seconds: float, ego_stood_s: float, most: int
) -> Forecast:  # fmt: skip
    """A forecast of up to `most` joint hypotheses, the likeliest first, with what sensors see (see
    traffic.predict for the arguments)."""
    usual = predict(road, scene, ego_lanes, nominal, params, seconds, OracleData(), ego_stood_s)
    if most == 1 or not params.interacting:
        return usual
    found, odds = [usual], [1.0]
    plain = predict(
        road,
        scene,
        ego_lanes,
        nominal,
        params._replace(persistence=0.0),
        params.step,
        OracleData(),
        ego_stood_s,
    )
    expected = (
        plain.v[0, 1] - plain.v[0, 0]
    ) / plain.dt  # what an agent does otherwise is the evidence, so it must not be in here
    for other in alternatives(road, scene, ego_lanes, usual, expected, params):
        forecast = predict(
            road,
            scene,
            ego_lanes,
            nominal,
            params,
            seconds,
            OracleData(),
            ego_stood_s,
            other.intent,
        )
        if (
            other.intent.does != STARTS or forecast.v[0, :, other.intent.agent].max() > STANDING
        ):  # else it is not patience alone that holds it
            found.append(forecast)
            odds.append(other.odds)
        if len(found) == most:
            break
    return together(found, odds)


def together(found: Sequence[Forecast], odds: Sequence[float]) -> Forecast:
    """Forecasts of one hypothesis each as one forecast, the likeliest first."""
    order = np.argsort(-np.array(odds), kind="stable")
    weight = np.array(odds)[order] / np.sum(odds)
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(found[h], name) for h in order]) for name in OF_HYPOTHESES
    }
    return found[0]._replace(
        weight=weight,
        intents=tuple(intent for h in order for intent in found[h].intents),
        **columns,
    )


def likeliest(forecast: Forecast) -> Forecast:
    """Its first hypothesis alone."""
    return forecast._replace(
        weight=np.ones(1),
        intents=forecast.intents[:1],
        **{name: getattr(forecast, name)[:1] for name in OF_HYPOTHESES},
    )


def alternatives(
    road: RoadMap,
    scene: Scene,
    ego_lanes: Ints,
    usual: Forecast,
    expected: Floats,
    params: TrafficParams,
) -> list[Alternative]:
    """What agents may do that matters to the ego, the likeliest first;

    `expected` [N]: their accelerations now if they did what is usual, m/s2.
    """
    agents = changing(road, scene.agents, ego_lanes, params.aside)
    paths = likely_paths(road, agents, scene.ego, ego_lanes, {}, usual.dt * usual.v.shape[1])
    found = [
        *_other_ways(road, agents, paths, scene.ego.s, usual, expected, params),
        *_forcing(road, agents, paths, scene.ego.s, usual.yields[0]),
        *_braking(agents, paths, scene.ego.s, scene.ego.v, expected),
        *_starting(agents, scene.ego, usual, params.stays_after),
        *_halting(road, agents, paths, scene.ego),
    ]
    return sorted((each for each in found if each.odds >= LEAST), key=lambda each: -each.odds)


# --- another way ---


def _other_ways(
    road: RoadMap, agents: Agents, paths: Paths, ego_s: float, usual: Forecast, expected: Floats,
    params: TrafficParams
) -> Iterator[Alternative]:  # fmt: skip
    """Whoever is about to come to where its lane branches, with each other way that meets the
    ego's."""
    theirs, kind = _meeting(road, paths, ego_s), of_class(agents.vclass)
    driven = usual.v[0].sum(axis=0) * usual.dt
    ego_lane = {int(lane): k for k, lane in enumerate(paths.lane[0, : paths.count[0]])}
    for i in np.flatnonzero((agents.lane >= 0) & (driven > 1.0)):
        if ego_lane.get(int(agents.lane[i])) == 0 and agents.s[i] < ego_s:
            continue  # behind the ego: it cannot come before the ego has gone on
        k = _branch(road, paths, int(i) + 1)
        room = paths.offset[i + 1, k + 1] - agents.s[i]
        if k < 0 or not 0.0 < room < min(TURN_VIEW, driven[i]):
            continue
        likely, lane = int(paths.lane[i + 1, k + 1]), int(paths.lane[i + 1, k])
        against = way_worth(road, agents, int(i), likely, room, expected[i], params.decel)
        for way in successors(road, lane):
            if (
                way != likely
                and road.classes[way] & road.classes[road.exit[way]] & kind[i]
                and any(theirs[inside] for inside in _through(road, way))
            ):
                worth = way_worth(road, agents, int(i), way, room, expected[i], params.decel)
                yield Alternative(
                    worth / against,
                    Intent(
                        int(i),
                        TURNS,
                        (*(int(x) for x in paths.lane[i + 1, : k + 1]), *_through(road, way)),
                    ),
                )


def way_worth(
    road: RoadMap, agents: Agents, i: int, way: int, room: float, expected: float, decel: float
) -> float:
    """Probability of what is seen of agent i if it takes the lane `way`, `room` m ahead, times how
    often anybody does; up to a common factor.

    `expected`: its acceleration in the usual forecast, m/s2; `decel`: with which it brakes for a
    turn in comfort, m/s2.
    """
    turn, v, limit = int(road.direction[way]), float(agents.v[i]), float(road.speed[way])
    too_fast = max(0.0, (v * v - limit * limit) / (2.0 * max(room, 1.0)) - decel)
    explained = decel if limit < v - 1.0 else max(0.0, -expected)
    slows = max(0.0, -float(agents.trend[i]) - explained)
    often = 1.0 if turn in (STRAIGHT, LEFT, RIGHT) else TURNS_BACK
    blinker = int(agents.blinker[i])
    wrong = COMES_OVER if blinker * agents.d[i] < -OFF_CENTRE else WRONG
    return (
        often
        * signal_worth(turn, blinker, wrong)
        * max(math.exp(-0.5 * (too_fast**2 + slows**2) / SPREAD**2), 1e-3)
    )


def signal_worth(turn: int, blinker: int, wrong: float = WRONG) -> float:
    """Probability of a turn signal (-1 right, 0 none, 1 left) where somebody is going to make a
    turn; `wrong`: that it is on for something else."""
    if turn == STRAIGHT:
        return wrong if blinker else 1.0 - 2.0 * WRONG
    if blinker == 0:
        return 1.0 - SHOWN
    meant = 1 if turn == LEFT else -1 if turn == RIGHT else blinker
    return SHOWN - wrong if blinker == meant else WRONG


def _branch(road: RoadMap, paths: Paths, row: int) -> int:
    """The first lane of a path from which it could go on otherwise; -1 where there is none."""
    for k in range(paths.count[row] - 1):
        if len(successors(road, int(paths.lane[row, k]))) > 1:
            return k
    return -1


def _through(road: RoadMap, way: int) -> list[int]:
    """A lane with those that follow it inside the junction, and the one behind it."""
    lanes = [way]
    while road.internal[lanes[-1]] and successors(road, lanes[-1]):
        lanes.append(successors(road, lanes[-1])[0])
    return lanes


def _meeting(road: RoadMap, paths: Paths, ego_s: float) -> Bools:
    """[L] lanes that share a stretch with the next EGO_VIEW metres of the ego's way."""
    result = np.zeros(len(road.lane_ids), np.bool_)
    for lane, begin in zip(paths.lane[0, : paths.count[0]], paths.offset[0], strict=False):
        if begin - ego_s < EGO_VIEW:
            result[lane] = True
            result[
                road.conflict_lane[road.conflict_offset[lane] : road.conflict_offset[lane + 1]]
            ] = True
    return result


# --- not letting the ego pass ---


def _forcing(
    road: RoadMap, agents: Agents, paths: Paths, ego_s: float, yields: Bools
) -> Iterator[Alternative]:
    """Whoever is expected to let the ego pass."""
    if not yields.any():
        return
    foe, kind, place = conflicts_of(road, paths)
    for i in np.flatnonzero(yields):
        meets = (
            (foe[i + 1] == 0)
            & (kind[i + 1] != MERGES)
            & (place[i + 1, :, 0] > agents.s[i])
            & (place[i + 1, :, 2] < ego_s + EGO_VIEW)
        )
        if meets.any():
            room = float(place[i + 1, meets, 0].min() - agents.s[i])
            yield Alternative(
                forcing_odds(float(agents.v[i]), float(agents.trend[i]), room),
                Intent(int(i), FORCES),
            )


def forcing_odds(v: float, trend: float, room: float) -> float:
    """Odds that an agent `room` m before the stretch where it has to wait does not; its speed, and
    its acceleration of late."""
    due = v * v / (2.0 * max(room - 2.0, 1.0)) - NO_HURRY
    return FORCING * math.exp(FORCING_GAIN * min(max(due - max(0.0, -trend), 0.0), MOST_TOLD))


# --- starting ---


def _starting(
    agents: Agents, ego: EgoState, usual: Forecast, stays_after: float
) -> Iterator[Alternative]:
    """The first on each lane near the ego, if it has stood for a while and is expected to stay."""
    near = np.hypot(agents.x - ego.x, agents.y - ego.y) < START_VIEW + ego.v
    waits = (
        near
        & (agents.lane >= 0)
        & (agents.standing_s >= stays_after)
        & (usual.v[0].max(axis=0) < STANDING)
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


# --- braking for no reason ---


def _braking(
    agents: Agents, paths: Paths, ego_s: float, ego_v: float, expected: Floats
) -> Iterator[Alternative]:
    """The nearest ahead of the ego on its way, if they move or have just come to a stand."""
    begins = {
        int(lane): float(begin)
        for lane, begin in zip(paths.lane[0, : paths.count[0]], paths.offset[0], strict=False)
    }
    gap = (
        np.array([begins.get(int(lane), math.inf) for lane in agents.lane])
        + agents.s
        - agents.length
        - ego_s
    )
    near = np.flatnonzero((gap > 0.0) & (gap < 10.0 + FOLLOWING * ego_v))
    for i in near[np.argsort(gap[near], kind="stable")][:LEADERS]:
        odds = braking_odds(float(agents.trend[i]), float(expected[i]))
        if agents.v[i] < CRAWLS and agents.trend[i] < MOVING_OFF < expected[i]:
            odds = max(odds, STAYING)
        if agents.v[i] > SLOW or odds > BRAKING:  # who has just come to a stand may stay
            yield Alternative(odds, Intent(int(i), BRAKES))


def braking_odds(trend: float, expected: float) -> float:
    """Odds that an agent brakes hard to a stand: its acceleration of late, and the one that is
    expected of it, m/s2."""
    unexplained = max(0.0, -trend) - max(0.0, -expected)
    return BRAKING * math.exp(BRAKING_GAIN * min(max(unexplained, 0.0), MOST_TOLD))


# --- stopping on the way across the road ---


def _halting(road: RoadMap, agents: Agents, paths: Paths, ego: EgoState) -> Iterator[Alternative]:
    """Whoever walks, and would be in the ego's way if it stopped now."""
    for i in np.flatnonzero(agents.person & (agents.v > STANDING)):
        if math.hypot(agents.x[i] - ego.x, agents.y[i] - ego.y) < 10.0 + FOLLOWING * ego.v:
            if from_way(road, paths, ego.s, float(agents.x[i]), float(agents.y[i])) < IN_THE_WAY:
                yield Alternative(HALTING, Intent(int(i), BRAKES))


def from_way(road: RoadMap, paths: Paths, ego_s: float, x: float, y: float) -> float:
    """Distance (m) from a point to the middle of the ego's way, as far as the ego has it before
    it."""
    least = math.inf
    for lane, begin in zip(paths.lane[0, : paths.count[0]], paths.offset[0], strict=False):
        points = road.points[road.point_offset[lane] : road.point_offset[lane + 1]]
        along = begin + road.point_s[road.point_offset[lane] : road.point_offset[lane + 1]]
        passed = (ego_s - along[:-1]) / np.maximum(
            np.diff(along), 1e-9
        )  # share of each piece that lies behind the ego
        _, away = nearest(points[:-1], np.diff(points, axis=0), x, y, np.clip(passed, 0.0, 1.0))
        least = min([least, *away[passed < 1.0].tolist()])
    return least
