"""How long the ego has waited for a gap: drivers that have waited long accept smaller ones."""

from sumo_mcts.model.local_map import LocalMap, State
from sumo_mcts.model.route import RouteMap, stop_ahead

WAITS_BELOW = 2.0  # m/s below which the ego waits,
DRIVES_FROM = 5.0  # and from which on it does not any more
LEADER_VIEW = 12.0  # m within which a leader is what it waits for,
LINE_VIEW = 30.0  # or a closed stop line


def waited_s(
    before: float, local: LocalMap, route: RouteMap, state: State, gap: float, period: float
) -> float:
    """Seconds of waiting for a gap up to the next decision, `period` s from now.

    `before`: up to now, s; `gap`: to the leader, m. Waiting behind a leader or at a closed stop
    line does not count.
    """
    if state.v >= DRIVES_FROM:
        return 0.0
    node, away = stop_ahead(route, state.node, state.s, LINE_VIEW)
    closed = away < LINE_VIEW and bool(local.closed[node - local.first, 0])
    waits = state.v < WAITS_BELOW and gap > LEADER_VIEW and not closed
    return before + period if waits else before


def patience(impatience: float, waited: float) -> float:
    """LocalMap.patience after so many seconds of waiting; `impatience`: 1/s."""
    return 1.0 / (1.0 + impatience * waited)
