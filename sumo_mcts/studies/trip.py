"""A trip that SUMO's driver drives, cycle by cycle: what the cost-to-go expects in its states, and
what then happened."""

import math
from collections import deque
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.model.cost_to_go import PICK_UP, expected_wait
from sumo_mcts.model.local_map import AWAY, GAP_S, GATE, LocalMap, State
from sumo_mcts.model.route import RouteMap
from sumo_mcts.planners.base import Situation, Task, local_of
from sumo_mcts.scene import STANDING

HORIZON_S = 8.0  # s after which the search asks for the cost-to-go
# An ego that stands goes if it drives so many m within so many s.
GOES_M, GOES_S = 5.0, 8.0
BEFORE_S = 60.0  # s before SUMO's driver goes in which the planner may go,
AFTER_S = 3.0  # and s after that
Row = dict[str, Any]


class Expected(NamedTuple):
    """What the cost-to-go expects from a state on, up to the last gate in the map; without gates up
    to the map's end."""

    gate: str  # what the next one is: light, gap, light and gap, none
    away: float  # m to it; inf: none
    # [K, 2] the ego's place and the ends of the lanes up to there: m along the route, and s of
    # driving at the limit
    profile: Floats
    rest: float  # s of driving at the limit from there to the end of the route
    lost: float  # s until the ego drives as fast as it may
    waits: float  # s at the gates


def expected(local: LocalMap, route: RouteMap, state: State, time: float) -> Expected:
    """What is expected in `state` at `time`, s from now."""
    way = _way(route, state.node)
    limit = float(route.limit[state.node])
    lost = max(limit - state.v, 0.0) ** 2 / (2.0 * PICK_UP * limit)
    free = np.cumsum(route.length[way] / route.limit[way]) - state.s / limit
    here = way[way < local.first + len(local.to_gate)]
    own = local.to_gate[here - local.first]
    # the gate ahead of a node is its own where it is no further away than the node's end
    gates = np.flatnonzero((own[:, GATE] >= 0.0) & (own[:, AWAY] <= route.length[here]))
    upto = int(gates[-1]) + 1 if len(gates) else len(here)
    kind, away = "none", math.inf
    if len(gates):
        kind = _kind(local, route, int(here[gates[0]]))
        away = float(route.length[here[: gates[0] + 1]].sum()) - state.s
    ends = np.column_stack([route.station[way] + route.length[way], free])[:upto]
    profile = np.vstack([[float(route.station[state.node]) + state.s, 0.0], ends])
    waits = expected_wait(local, state, time, lost)
    return Expected(kind, away, profile, float(free[-1] - free[upto - 1]), lost, waits)


def _way(route: RouteMap, node: int) -> Indices:
    """The nodes that the ego needs from `node` on."""
    found = []
    while node >= 0:
        for _ in range(abs(int(route.changes[node]))):
            beside = int(route.left[node] if route.changes[node] > 0 else route.right[node])
            if beside < 0:  # it may change later only
                break
            node = beside
        found.append(node)
        node = int(route.next[node])
    return np.array(found)


def _kind(local: LocalMap, route: RouteMap, node: int) -> str:
    """What the gate at the end of `node` is."""
    gap = local.gate[int(local.to_gate[node - local.first, GATE]), GAP_S] > 0.0
    if route.signal[node] < 0:
        return "gap"
    return "light and gap" if gap else "light"


class Asked(NamedTuple):
    """What was expected of a state, `ahead` s before it."""

    time: float  # of the state, s
    ahead: float
    v: float  # m/s
    found: Expected


class Log:
    """A trip of one ego along one route."""

    def __init__(self, route: RouteMap) -> None:
        self.route = route
        self.time: list[float] = []  # s, of each cycle
        self.station: list[float] = []  # m along the route
        self.v: list[float] = []  # m/s
        self.goes: dict[int, bool] = {}  # cycle -> whether the planner would go then
        self._asked: list[Asked] = []
        self._maps: deque[tuple[float, LocalMap]] = deque()  # whose horizon has not come yet

    def note(self, time: float, state: State) -> None:
        """A cycle. What was expected of it, where it lies at the horizon of an earlier one."""
        self.time.append(time)
        self.station.append(float(self.route.station[state.node]) + state.s)
        self.v.append(state.v)
        while self._maps and time >= self._maps[0][0] + HORIZON_S - 1e-6:
            began, local = self._maps.popleft()
            self._ask(local, state, time - began)

    def ask(self, task: Task, situation: Situation) -> None:
        """What is expected of the last cycle, whose forecast is in `situation`."""
        local = local_of(task, situation)
        self._maps.append((self.time[-1], local))
        self._ask(local, situation.state, 0.0)

    def _ask(self, local: LocalMap, state: State, ahead: float) -> None:
        found = expected(local, self.route, state, ahead)
        self._asked.append(Asked(self.time[-1], ahead, state.v, found))

    def stood_within(self, seconds: float) -> bool:
        """Whether the ego stands, or stood so short a time ago."""
        since = self.time[-1] - seconds
        return any(
            v < STANDING for t, v in zip(self.time, self.v, strict=True) if t >= since - 1e-6
        )

    # --- what then happened ---

    def states(self, arrived: bool) -> list[Row]:
        """A row for each state of which something was expected, where the ego came to the place in
        question.

        Without gates the place is at most where an ego that `arrived` was seen last.
        """
        rows = []
        for time, ahead, v, found in self._asked:
            place = float(found.profile[-1, 0])
            if found.gate == "none" and arrived:
                place = min(place, self.station[-1])
            if not self._where(time) < place <= self.station[-1]:
                continue
            free = float(np.interp(place, found.profile[:, 0], found.profile[:, 1]))
            waited = self._when(place) - time - free - found.lost
            rows.append(
                {
                    "time_s": time,
                    "ahead_s": ahead,
                    "v_mps": v,
                    "gate": found.gate,
                    "gate_m": found.away if math.isfinite(found.away) else None,
                    "free_s": free,
                    "lost_s": found.lost,
                    "expected_s": found.waits,
                    "waited_s": waited,
                }
            )
        return rows

    def trips(self) -> list[Row]:
        """A row: how the expected time to the end of the route went on from state to state."""
        now = [each for each in self._asked if each.ahead == 0.0]
        value = np.array([f.lost + f.profile[-1, 1] + f.waits + f.rest for *_, f in now])
        if len(value) < 2:
            return []
        change = np.diff(value)
        rate = change / np.diff([each.time for each in now])
        return [
            {
                "states": len(value),
                "falls": int((change < 0.0).sum()),
                "median_rate": float(np.median(rate)),  # s a second
                "rise_s": float(np.maximum(change, 0.0).sum()),
            }
        ]

    def stands(self) -> list[Row]:
        """A row for each time that the ego stood and then went."""
        time = np.array(self.time)
        still = np.array(self.v) < STANDING
        rows = []
        for last in np.flatnonzero(still[:-1] & ~still[1:]).tolist():
            if self._where(time[last] + GOES_S) - self.station[last] < GOES_M:
                continue
            moving = np.flatnonzero(~still[:last])
            begin = int(moving[-1]) + 1 if len(moving) else 0
            goes = np.array([time[k] for k, would in self.goes.items() if would and k >= begin])
            early = goes[(goes <= time[last]) & (goes >= time[last] - BEFORE_S)]
            rows.append(
                {
                    "time_s": float(time[last]),
                    "stood_s": float(time[last] - time[begin]),
                    "goes": len(early) > 0,
                    "goes_soon": bool((goes <= time[last] + AFTER_S).any()),
                    "earlier_s": float(time[last] - early[0]) if len(early) else None,
                }
            )
        return rows

    def _when(self, place: float) -> float:
        """When the ego came to a place, s."""
        k = int(np.argmax(np.array(self.station) >= place))
        return float(np.interp(place, self.station[k - 1 : k + 1], self.time[k - 1 : k + 1]))

    def _where(self, time: float) -> float:
        """m along the route."""
        return float(np.interp(time, self.time, self.station))
