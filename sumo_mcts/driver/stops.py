"""Stops that cannot be served any more."""

import math

from sumo_mcts.model.local_map import State
from sumo_mcts.model.route import RouteMap
from sumo_mcts.scene import NO_STOP, Decision, EgoState, Follow, Stop

PAST = 1.0  # m behind its place at which a stop that does not count yet is missed
SURELY_PAST_S = 2.0  # s of its speed behind a waypoint likewise
LAST_HOPE = 30.0  # m beyond its braking at which an ego waits for the lane of a stop to be opened
NONE_MISSED = Stop(lane=-2)  # equal to no stop


def is_missed(route: RouteMap, stop: Stop, state: State, ego: EgoState) -> bool:
    """Whether the ego cannot serve the stop that its route was laid out for: it is behind it, too
    fast to stand there with the braking of its vehicle type, or its lane is out of reach."""
    if stop == NO_STOP:
        return False
    braking = state.v * state.v / (2.0 * max(ego.comfort_decel, math.ulp(1.0)))
    node = route.halt.node
    if node < 0:  # its lane is closed: perhaps not for long
        return _away(route, stop, state) < braking + LAST_HOPE
    leg = route.leg[node]
    if route.leg[state.node] != leg:
        return bool(route.leg[state.node] > leg)
    if route.internal[state.node] or route.lost[state.node]:
        return True  # the junction behind the edge of the stop, or a lane beside it
    if not stop.ends:
        return state.s > stop.place + PAST + SURELY_PAST_S * stop.speed
    return braking > stop.place - state.s + PAST


def _away(route: RouteMap, stop: Stop, state: State) -> float:
    """m to the place of a stop whose lane is not on the route; -inf: its edge has no lane."""
    edge = (route.leg == route.leg[-1] - stop.after) & ~route.internal
    begin = route.station[edge].min(initial=math.inf)
    here = float(route.station[state.node]) + state.s
    return float(begin) + stop.place - here if edge.any() else -math.inf


GIVEN_UP = "the stop ahead cannot be served any more: given up"


def without_stop(decision: Decision) -> Decision:
    """The decision, and the next stop given up."""
    if not isinstance(decision.command, Follow):
        return decision
    return decision._replace(
        command=decision.command._replace(skips_stop=True),
        reason=f"{decision.reason}; {GIVEN_UP}",
    )


def given_up(decision: Decision) -> str:
    """Which stop the decision gives up, in words; "": none."""
    skips = isinstance(decision.command, Follow) and decision.command.skips_stop
    return GIVEN_UP if skips else ""
