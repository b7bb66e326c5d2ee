"""A lane that the route leaves: where, and how fast and dense the stream in the next lane is."""

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Indices
from sumo_mcts.model.local_map import END
from sumo_mcts.model.route import RouteMap

VIEW_BACK, VIEW_AHEAD = 200.0, 100.0  # m of the next lane in which its stream is measured
MAKES_ROOM = 3.0  # m/s2 with which a driver brakes to make room

Stream = tuple[Indices, Floats, Floats]  # [N] node to which an agent comes, s there (m), v (m/s)


def leaving(route: RouteMap, view: slice, here: float, urgency: Floats, stream: Stream) -> Floats:
    """LocalMap.to_leave [W, 3] of the nodes in `view`; `here`, `urgency` as in local_build."""
    first, w = view.start, view.stop - view.start
    to_leave = np.zeros((w, END + 1))
    to_leave[:, END] = route.reach[view]
    end = route.station[view] + route.reach[view]
    keys = {
        (int(np.sign(urgency[i])), round(float(end[i]), 1))
        for i in np.flatnonzero((urgency != 0.0) & np.isfinite(end))
    }
    for side, at in sorted(keys):
        those = (np.sign(urgency) == side) & (np.abs(end - at) < 0.1)
        to = (route.left if side > 0 else route.right)[view] - first
        beside = np.unique(to[those & (to >= 0) & (route.changes[view] != 0)])
        if len(beside) > 0:
            to_leave[those, :END] = _stream(route, view, here, beside, stream)
    return to_leave


def _stream(
    route: RouteMap, view: slice, here: float, lanes: Indices, stream: Stream
) -> tuple[float, float]:
    """Mean speed, m/s, and vehicles a metre of those in `lanes` (of the window) or on the way to
    them."""
    first = view.start
    leads: Bools = np.zeros(view.stop - first, np.bool_)
    leads[lanes] = True
    for i in range(len(leads) - 1, -1, -1):
        after = int(route.next[first + i]) - first
        leads[i] |= 0 <= after < len(leads) and leads[after]
    begin = float(route.station[first + lanes].min())
    end = float((route.station[first + lanes] + route.length[first + lanes]).max())
    low = max(here, begin) - VIEW_BACK
    high = min(low + VIEW_BACK + VIEW_AHEAD, max(end, low + VIEW_BACK))
    node, s, v = stream
    at = node - first
    counts = (at >= 0) & (at < len(leads))
    counts &= leads[at * counts]
    where = route.station[np.maximum(node, 0)] + s
    counts &= (where >= low) & (where < high)
    if not counts.any():
        return float(route.limit[first + lanes].max()), 0.0
    return float(v[counts].mean()), float(counts.sum()) / (high - low)
