"""The plans that connected egos tell each other, and what they make of a forecast.

A plan has no sensor error and no alternative: it is what the forecast says of its agent, in every
hypothesis. Where it ends the forecast goes on from there: an agent that stands then goes on
standing, another one moves as the predictor has it from that place on.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats, Indices, Ints
from sumo_mcts.numerics.geometry import COS, SIN, X, Y
from sumo_mcts.prediction.hypotheses import OF_HYPOTHESES
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import (
    STANDING,
    Agents,
    Decision,
    EgoState,
    Forecast,
    Plan,
    Release,
    Scene,
    Scripted,
)

SAME_PLACE = 2.0  # m from the end of a plan within which a predicted path leads past it


class Told(NamedTuple):
    """What an ego tells of a decision."""

    ego: EgoState  # at the decision
    plan: Plan
    time: float  # of the decision, s


def told_by(scene: Scene, decision: Decision) -> Told | None:
    """What the ego of a scene tells of its decision; None: it has no plan, or SUMO drives it."""
    if decision.plan is None or isinstance(decision.command, Release):
        return None
    return Told(scene.ego, decision.plan, scene.time)


def states_told(told: Told, now: float, step: float, count: int) -> Scripted:
    """[count] states by the plan, `step` s apart from `now` (s) on; not valid beyond its end."""
    ego, plan = told.ego, told.plan
    time = np.concatenate([[0.0], plan.time])
    pose = np.vstack([_pose(ego), plan.pose])
    v, s = np.concatenate([[ego.v], plan.v]), np.concatenate([[ego.s], plan.s])
    lane = np.concatenate([[ego.lane], plan.lane]).astype(np.int32)
    wanted = now - told.time + step * np.arange(count)
    k = np.clip(np.searchsorted(time, wanted + 1e-6, side="right") - 1, 0, len(time) - 1)
    after = np.minimum(k + 1, len(time) - 1)
    share = np.clip((wanted - time[k]) / np.maximum(time[after] - time[k], 1e-9), 0.0, 1.0)
    share = np.where(share < 1e-6, 0.0, share)
    found = pose[k] + share[:, None] * (pose[after] - pose[k])
    found[:, COS:] /= np.hypot(found[:, COS], found[:, SIN])[:, None]
    on_lane = np.where(lane[k] == lane[after], share, 0.0)
    return Scripted(
        pose=found,
        v=v[k] + share * (v[after] - v[k]),
        lane=lane[k],
        s=s[k] + on_lane * (s[after] - s[k]),
        valid=wanted <= time[-1] + 1e-6,
    )


def with_plans(
    forecast: Forecast,
    road: RoadMap,
    agents: Agents,
    ego_lanes: Ints,
    plans: Mapping[int, Scripted],
) -> Forecast:
    """The forecast with what agents (index) tell in place of what is predicted of them, to an ego
    that is going to drive `ego_lanes`.

    Their boxes have no margins. They react as predicted. They yield as predicted, and wherever they
    have to: they decide again each period, and then know the plan of the ego that asks. Hypotheses
    in which one of them does otherwise are left out.
    """
    plans = {i: states for i, states in plans.items() if states.valid[0]}
    if not plans:
        return forecast
    those = np.array(list(plans))
    kept = _kept(forecast, those)
    columns = {name: getattr(forecast, name)[kept].copy() for name in OF_HYPOTHESES}
    half_length, half_width = forecast.half_length.copy(), forecast.half_width.copy()
    half_length[those], half_width[those] = agents.length[those] / 2, agents.width[those] / 2
    for i, states in plans.items():
        columns["yields"][:, i] |= _has_to_yield(road, states.lane[states.valid], ego_lanes)
    result = forecast._replace(
        weight=forecast.weight[kept] / forecast.weight[kept].sum(),
        half_length=half_length,
        half_width=half_width,
        intents=tuple(forecast.intents[h] for h in kept) if forecast.intents else (),
        **columns,
    )
    for i, states in plans.items():
        for h in range(len(kept)):
            _write(result, road, h, i, states)
    return result


def _pose(ego: EgoState) -> Floats:
    return np.array([ego.x, ego.y, np.cos(ego.heading), np.sin(ego.heading)])


def _has_to_yield(road: RoadMap, lanes: Ints, to: Ints) -> bool:
    """Whether traffic on one of these lanes has to let that on lanes `to` pass, and not the other
    way round as well."""
    first, yields = road.conflict_offset, road.conflict_yields
    for lane in np.unique(lanes[lanes >= 0]):
        here = slice(first[lane], first[lane + 1])
        foes = road.conflict_lane[here][yields[here]]
        for foe in foes[np.isin(foes, to)]:
            there = slice(first[foe], first[foe + 1])
            if not (yields[there] & (road.conflict_lane[there] == lane)).any():
                return True
    return False


def _kept(forecast: Forecast, those: Indices) -> Indices:
    """The hypotheses that no plan contradicts; the likeliest where there is none."""
    if not forecast.intents:
        return np.arange(len(forecast.weight))
    kept = np.flatnonzero([intent.agent not in those for intent in forecast.intents])
    return kept if len(kept) else np.zeros(1, np.int64)


def _write(forecast: Forecast, road: RoadMap, h: int, i: int, states: Scripted) -> None:
    """Write a plan, and how it goes on, into hypothesis h of a forecast."""
    times = forecast.v.shape[1]
    have = min(int(states.valid.sum()), times)
    predicted = Scripted(
        pose=forecast.pose[h, :, i].copy(),
        v=forecast.v[h, :, i].copy(),
        lane=forecast.lane[h, :, i].copy(),
        s=forecast.s[h, :, i].copy(),
        valid=forecast.valid[h, :, i].copy(),
    )
    rest = _going_on(road, states, have - 1, predicted, times - have, forecast.dt)
    for name in Scripted._fields:
        column = getattr(forecast, name)
        column[h, :have, i] = getattr(states, name)[:have]
        column[h, have:, i] = getattr(rest, name)


def _going_on(
    road: RoadMap, states: Scripted, end: int, predicted: Scripted, count: int, dt: float
) -> Scripted:
    """[count] states after the last one of a plan, `end`: those predicted from that place on, as
    far as the predicted path leads there, then straight on at the same speed."""
    pose, v = states.pose[end], float(states.v[end])
    away = np.hypot(predicted.pose[:, X] - pose[X], predicted.pose[:, Y] - pose[Y])
    there = int(np.argmin(np.where(predicted.valid, away, np.inf)))
    joins = v > STANDING and predicted.valid[there] and away[there] < SAME_PLACE
    rows = there + 1 + np.arange(count if joins else 0)
    rows = rows[rows < len(predicted.v)]
    joined = Scripted(
        pose=predicted.pose[rows],
        v=predicted.v[rows],
        lane=predicted.lane[rows],
        s=predicted.s[rows],
        valid=predicted.valid[rows],
    )
    if len(rows):
        pose, v = joined.pose[-1], float(joined.v[-1])
        lane, s, valid = joined.lane[-1], float(joined.s[-1]), joined.valid[-1]
    else:
        lane, s, valid = states.lane[end], float(states.s[end]), np.True_
    metres = v * dt * (1.0 + np.arange(count - len(rows)))
    on = np.tile(pose, (len(metres), 1))
    on[:, X] += metres * pose[COS]
    on[:, Y] += metres * pose[SIN]
    most = max(s, float(road.length[lane])) if lane >= 0 else np.inf
    return Scripted(
        pose=np.concatenate([joined.pose, on]),
        v=np.concatenate([joined.v, np.full(len(metres), v)]),
        lane=np.concatenate([joined.lane, np.full(len(metres), lane, np.int32)]),
        s=np.concatenate([joined.s, np.minimum(s + metres, most)]),
        valid=np.concatenate([joined.valid, np.full(len(metres), valid)]),
    )
