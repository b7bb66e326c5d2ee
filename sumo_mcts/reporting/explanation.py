"""Why the ego did what it did at one moment: from a trace, as plain data.

explanation_words.py puts it in words.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.driver.forecaster import no_forecast
from sumo_mcts.driver.replan import recorded_config, replan
from sumo_mcts.model.local_map import ego_state
from sumo_mcts.model.route import is_rest_of, route_map, stop_ahead
from sumo_mcts.numerics.geometry import Box, box_distance
from sumo_mcts.numerics.signals import shown
from sumo_mcts.planners.failsafe import coming
from sumo_mcts.records import SCHEMA_VERSION, CycleRecord, Row, Setting, Trace, same, scenario_of
from sumo_mcts.records.measures import BY_KEY
from sumo_mcts.registry import ORACLE_MARK, PLANNERS, PREDICTORS
from sumo_mcts.reporting.words import action_words
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import (
    BRAKES,
    FORCES,
    STARTS,
    TERMS,
    TURNS,
    Decision,
    Follow,
    Intent,
    RootChild,
)

STOOD = ("stopped_s", "longest_stop_s", "stopped_at_green_s")  # keys of the row
COLOURS = ("green", "yellow", "red", "red, may be passed after a stop")  # as scene.py numbers them


def explain(
    trace: Trace, road: RoadMap | None, number: int, row: Row | None = None
) -> dict[str, Any]:
    """What the ego knew, weighed and did in a cycle, and what came of it.

    Without `road` lanes go by their numbers. `row`: the episode's, where it is known.
    """
    cycle = trace.cycles[number]
    after = trace.cycles[number + 1] if number + 1 < len(trace.cycles) else None
    scenario = scenario_of(trace.setting)
    return {
        "schema_version": SCHEMA_VERSION,
        "key": trace.key,
        "scenario": trace.scenario,
        "time_s": cycle.time,
        "cycle": number + 1,
        "cycles": len(trace.cycles),
        "planner": scenario.get("planner", {}).get("name"),
        "prediction": _prediction(trace),
        "stood": _stood(row or {}),
        **_thought(cycle, road, trace.setting),
        "executed": {
            "until_s": None if after is None else after.time,
            "outcome": trace.outcome if after is None else None,
            "commanded_mps": _known(cycle.commanded_speed),
            "executed_mps": _known(cycle.executed_speed),
            "commanded_lane": _lane(road, cycle.commanded_lane),
            "executed_lane": _lane(road, cycle.executed_lane),
            "deviation": cycle.deviation,
        },
    }


def explain_again(
    trace: Trace,
    road: RoadMap,
    number: int,
    overrides: Sequence[str],
    *,
    allow_plugins: bool = False,
) -> dict[str, Any]:
    """The same of the decision taken again from the record, with some keys set otherwise.

    Raises ConfigError.
    """
    cycle = trace.cycles[number]
    config = recorded_config(trace.setting, overrides, allow_plugins=allow_plugins)
    thought = replan(trace, road, number, config)
    forecast = thought.forecast if thought.forecast is not None else no_forecast(cycle.step)
    again = cycle._replace(
        decision=thought.decision, forecast=forecast, intervened=thought.intervened
    )
    setting = trace.setting._replace(config=config.model_dump_json())
    return {
        "set": list(overrides),
        "identical": same(Decision, thought.decision, cycle.decision),
        "same_command": _command(thought.decision) == _command(cycle.decision),
        "reproducible": config.reproducible,
        **_thought(again, road, setting),
    }


def _stood(row: Row) -> dict[str, float | None]:
    """How long the ego stood in the whole episode; None: unknown."""
    return {key: row.get(key) if BY_KEY[key].is_within(row.get(key)) else None for key in STOOD}


def _thought(cycle: CycleRecord, road: RoadMap | None, setting: Setting) -> dict[str, Any]:
    """What was known and weighed, and the decision."""
    ego, children, nearest = cycle.ego, cycle.decision.children, closest(cycle)
    agents = [_agent(cycle, nearest, i, road) for i in range(len(cycle.agents.ids))]
    hypotheses = range(len(cycle.forecast.weight) if agents else 0)
    order = sorted(range(len(children)), key=lambda i: (children[i].best, i))
    return {
        "ego": {
            "id": ego.id, "lane": _lane(road, ego.lane), "s_m": ego.s, "v_mps": ego.v,
            "a_mps2": ego.a,
            "changing_to": _lane(road, ego.change_to) if 0.0 < ego.changing < 1.0 else None,
            "stop_line": None if road is None else _stop_line(cycle, road),
            "detour": ego.detour or None,
        },
        "agents": sorted(agents, key=_urgency),
        "hypotheses": [_hypothesis(cycle, nearest, h, road) for h in hypotheses],
        "actions": [
            {**_action(children, i, setting), "chosen": i == cycle.decision.chosen} for i in order
        ],
        "decision": _decision(cycle, setting),
    }  # fmt: skip


def _decision(cycle: CycleRecord, setting: Setting) -> dict[str, Any]:
    decision, children = cycle.decision, cycle.decision.children
    chosen = children[decision.chosen] if decision.chosen >= 0 else None
    command = decision.command if isinstance(decision.command, Follow) else None
    return {
        "action": None if chosen is None else _name(children, decision.chosen, setting),
        "words": action_words(cycle),
        "accel_mps2": None if chosen is None else chosen.accel,
        "lane_change": 0 if command is None else command.lane_change,
        "speeds_mps": None if command is None else command.speeds.tolist(),
        "cost": None if chosen is None else _known(chosen.best),
        "reason": decision.reason,
        "fail_safe": cycle.intervened,
        "iterations": decision.iterations,
        "known": decision.known,
    }


def _urgency(agent: dict[str, Any]) -> tuple[float, float]:
    """Agents are sorted by how near they may come, then by how near they are likely to come."""
    return agent["worst_m"], agent["closest_m"]


def _stop_line(cycle: CycleRecord, road: RoadMap) -> dict[str, Any] | None:
    """The next light or stop sign on the ego's route."""
    ego, edges = cycle.ego, cycle.memory.edges
    kept = is_rest_of(ego.route, edges)
    if not kept:  # a new route begins here
        edges = ego.route
    if ego.lane < 0 or not edges or -1 in edges:
        return None
    route = route_map(
        road, edges, ego.vclass, ego.length, ego.speed_factor, ego.max_speed, ego.comfort_decel
    )
    state = ego_state(route, ego)
    node, distance = (-1, math.inf) if state is None else stop_ahead(route, state.node, ego.s)
    if node < 0:
        return None
    signal, now = int(route.signal[node]), cycle.signals
    if signal < 0:
        return {
            "kind": "stop sign",
            "distance_m": distance,
            "shows": "stood there" if kept and node in cycle.memory.stood else "to stop",
            "for_s": None,
        }
    shows = COLOURS[shown(now, signal, int(route.link[node]))]
    return {
        "kind": "light",
        "distance_m": distance,
        "shows": shows,
        "for_s": _known(float(now.until[signal, 0])),
    }


def closest(cycle: CycleRecord) -> Floats:
    """[H, N, 2] the least distance between the boxes of each agent and the ego, m, and its time, s
    from now. It holds if the plan is driven and the hypothesis is true.

    Boxes lie in the plane, so an agent on a bridge above the ego comes near, too. Without a plan
    the ego stays as it is now.
    """
    forecast, ego, plan, seen = cycle.forecast, cycle.ego, cycle.decision.plan, cycle.agents
    hypotheses, times, agents = forecast.pose.shape[:3]
    own = np.array([[ego.x, ego.y, math.cos(ego.heading), math.sin(ego.heading)]])
    if plan is not None and len(plan.time):
        last = min(times, int((plan.time[-1] + 1e-6) / forecast.dt) + 1)
        steps = [int(np.argmin(np.abs(plan.time - t * forecast.dt))) for t in range(1, last)]
        own = np.concatenate([own, plan.pose[steps]])
    result = np.full((hypotheses, agents, 2), np.inf)
    for h in range(hypotheses):
        for i in range(agents):
            # Without the margin that the forecast adds.
            size = float(seen.length[i]) / 2, float(seen.width[i]) / 2
            gaps = [
                _gap(own[t], (ego.length / 2, ego.width / 2), forecast.pose[h, t, i], size)
                for t in range(len(own))
                if forecast.valid[h, t, i]
            ]
            there = np.flatnonzero(forecast.valid[h, : len(own), i])
            if gaps:
                result[h, i] = min(gaps), there[int(np.argmin(gaps))] * forecast.dt
    return result


def _gap(
    pose: Floats, half: tuple[float, float], other: Floats, other_half: tuple[float, float]
) -> float:
    """m between two boxes, each given by its pose [4] and half its length and width."""
    (x, y, c, s), (ox, oy, oc, os) = pose.tolist(), other.tolist()
    return float(box_distance(Box(x, y, c, s, *half), Box(ox, oy, oc, os, *other_half)))


def _agent(cycle: CycleRecord, nearest: Floats, i: int, road: RoadMap | None) -> dict[str, Any]:
    agents, ego, forecast = cycle.agents, cycle.ego, cycle.forecast
    # Without a forecast no agent has a future.
    known = i < nearest.shape[1] and math.isfinite(nearest[0, i, 0])
    away = math.hypot(agents.x[i] - ego.x, agents.y[i] - ego.y)
    worst = int(np.argmin(nearest[:, i, 0])) if known else 0
    return {
        "id": agents.ids[i],
        "comes": coming(ego, agents, i),
        "lane": _lane(road, int(agents.lane[i])),
        "away_m": away,
        "v_mps": float(agents.v[i]),
        "closest_m": float(nearest[0, i, 0]) if known else away,
        "closest_s": float(nearest[0, i, 1]) if known else 0.0,
        "worst_m": float(nearest[worst, i, 0]) if known else away,
        "worst_hypothesis": worst + 1,
        "yields": known and bool(forecast.yields[0, i]),
        "reacts": known and bool(forecast.reacts[i]),
        "person": bool(agents.person[i]),
    }


def _hypothesis(
    cycle: CycleRecord, nearest: Floats, h: int, road: RoadMap | None
) -> dict[str, Any]:
    forecast = cycle.forecast
    intent = forecast.intents[h] if h < len(forecast.intents) else None
    searched = max((len(child.hypotheses) for child in cycle.decision.children), default=0)
    about = cycle.agents.ids[intent.agent] if intent is not None and intent.agent >= 0 else None
    walks = intent is not None and about is not None and bool(cycle.agents.person[intent.agent])
    return {
        "weight": float(forecast.weight[h]),
        "about": about,
        "words": _intent_words(intent, about, walks, road),
        "closest_m": None
        if intent is None or about is None
        else _known(float(nearest[h, intent.agent, 0])),
        "searched": h < max(searched, 1),
    }


def _intent_words(
    intent: Intent | None, about: str | None, walks: bool, road: RoadMap | None
) -> str:
    does = 0 if intent is None else intent.does
    if intent is not None and does == TURNS:
        return f"{about} takes another path, to {_lane(road, intent.way[-1])}"
    words = {
        FORCES: "does not let the ego pass",
        BRAKES: "stops" if walks else "brakes hard, to a stand",
        STARTS: "starts, though it has stood for a while",
    }
    return f"{about} {words[does]}" if does in words else "all agents do what is likeliest"


def _action(children: Sequence[RootChild], i: int, setting: Setting) -> dict[str, Any]:
    child = children[i]
    return {
        "action": _name(children, i, setting),
        "accel_mps2": child.accel,
        "lane_change": child.lane_change,
        "visits": child.visits,
        "mean": _known(child.mean),
        "best": _known(child.best),
        "terms": {
            name: _known(float(value)) for name, value in zip(TERMS, child.terms, strict=True)
        },
        "hypotheses": [
            {name: _known(float(value)) for name, value in zip(TERMS, terms, strict=True)}
            for terms in child.hypotheses
        ],
    }


def _name(children: Sequence[RootChild], i: int, setting: Setting) -> str:
    """What kind of action it is.

    Where a planner carries on, car following is the first, and its last plan, carried on, is the
    last and was not visited.
    """
    row = PLANNERS.get(scenario_of(setting).get("planner", {}).get("name"))
    if row is None or not row.warm_starts:
        return "acceleration"
    if children[i].visits == 0:
        return "last plan, carried on"
    return "car following" if i == 0 else "acceleration"


def _command(decision: Decision) -> tuple[Any, ...]:
    command = decision.command
    return (*command.speeds.tolist(), command.lane_change) if isinstance(command, Follow) else ()


def _prediction(trace: Trace) -> str | None:
    """What the forecast is called that the planner read.

    None: it read none. Code that the trace names is not run: whether a plugin reads a forecast, and
    whether one is an oracle, is seen by what was recorded.
    """
    scenario = scenario_of(trace.setting)
    planner, name = (scenario.get(section, {}).get("name") for section in ("planner", "prediction"))
    if planner in PLANNERS:
        read = PLANNERS[planner].reads_forecast
    else:
        read = planner is not None and any(cycle.forecast.pose.size for cycle in trace.cycles)
    oracle = name not in PREDICTORS and any(
        cycle.answers.ways or len(cycle.answers.agent) for cycle in trace.cycles
    )
    return None if not read else f"{name}{ORACLE_MARK}" if oracle else name


def _lane(road: RoadMap | None, lane: int) -> str | None:
    if lane < 0:
        return None
    return f"lane {lane}" if road is None else road.lane_ids[lane]


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
