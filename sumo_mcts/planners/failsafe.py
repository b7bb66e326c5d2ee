"""The last check: a decision is executed only if a safe end can still be reached after it, whatever
the others do within bounds.

The idea is Pek and Althoff's (Fail-safe motion planning for online verification of autonomous
vehicles using convex optimization, IEEE Transactions on Robotics, 2021). Here each agent keeps to
the way that the forecast has for it, and drives it as slowly or as fast as the bounds allow. What
it may cover meanwhile has to stay clear of the ego, which carries the decision out for one period
and then stops, or leaves the junction or ends its lane change first. What is left to the others:
whoever is behind the ego keeps its distance; whoever the ego moves in front of, and whoever stands
and would set off towards it, brakes after a reaction time.
"""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.model.local_map import (
    COS,
    DRIVEN,
    GONE,
    HALF_LENGTH,
    HALF_WIDTH,
    NODE,
    REACTS,
    SIN,
    LocalMap,
    S,
    State,
    V,
    X,
    Y,
    apart,
    chain_gap,
)
from sumo_mcts.model.motion import (
    GOAL,
    EgoParams,
    advance,
    begin_change,
    obey,
    pose_of,
    within_step,
)
from sumo_mcts.model.route import INTERNAL, LEFT_NODE, LENGTH, NEXT, RIGHT_NODE
from sumo_mcts.numerics.geometry import Box, boxes_touch
from sumo_mcts.numerics.kernel import entry, kernel
from sumo_mcts.planners.base import Situation, Task, local_of
from sumo_mcts.scene import (
    Agents,
    Decision,
    EgoState,
    Floats,
    Follow,
    Indices,
    Manoeuvre,
    Plan,
    Release,
    RootChild,
)

LONGEST_S = 30.0  # a manoeuvre that has not come to its end by then is none
CHECK_S = 0.25  # longest time between two checks
ALONG = 0.8  # cosine of the angle between two headings up to which one vehicle follows the other
AT_REST = 0.01  # m/s
NOBODY, NO_END = -1, -2  # in place of the agent in the way
# How a manoeuvre begins after the decision period, until the ego has left the junction and ended
# its lane change; then, with BRAKE at once, it brakes.
BRAKE, HOLD, ACCELERATE = range(3)
REASON = "fail-safe"


class Assumed(NamedTuple):
    """What the others may do; see config.FailSafeConfig. SI units, decelerations positive."""

    decel: float
    accel: float
    over_limit: float
    reaction: float
    yield_decel: float
    horizon: float


class Obstacle(NamedTuple):
    """What is in the way of a manoeuvre."""

    agent: int  # index, NOBODY, or NO_END
    time: float  # s from now


class FailSafe:
    """Verifies the decisions for one ego, and has a manoeuvre ready where there is none to
    execute."""

    def __init__(self, assumed: Assumed, period_s: float) -> None:
        self._assumed, self._period = assumed, period_s
        self.ready: Manoeuvre | None = None  # the last one verified

    def start(self, task: Task) -> None:
        """Take the ego over."""
        self._task, self.ready = task, None

    def forget(self) -> None:
        """What was verified is no longer what the ego does."""
        self.ready = None

    def objection(self, situation: Situation, command: Follow) -> str:
        """Why the command must not be executed; "" where it may, and then the manoeuvre after it is
        the one to fall back on."""
        manoeuvre, obstacle = self._search(situation, command)
        if manoeuvre is None:
            return _in_words(situation, obstacle)
        self.ready = manoeuvre
        return ""

    def fall_back(self, situation: Situation, why: str, replaced: Decision | None) -> Decision:
        """The last manoeuvre verified, from where it is now; without one the first that can be
        verified from here; else the strongest braking in the lane. `replaced`: what the planner
        decided, if anything."""
        now, nothing = situation.scene.time, Follow(np.zeros(0), 0)
        if self.ready is None:
            self.ready, _ = self._search(situation, nothing)
        manoeuvre = self.ready
        if manoeuvre is None:
            plan, _ = self._drive(
                local_of(self._task, situation), situation, nothing, BRAKE, self._task.ego.max_decel
            )
            manoeuvre = Manoeuvre(now, plan, False)
        plan = _rest(manoeuvre, now)
        reason = f"{REASON}: {why}" if manoeuvre.verified else f"{REASON}, unverified: {why}"
        if replaced is None:
            return Decision(Follow(plan.v, 0), plan, (), -1, reason, 0, 0)
        return replaced._replace(command=Follow(plan.v, 0), plan=plan, chosen=-1, reason=reason)

    def _search(self, situation: Situation, command: Follow) -> tuple[Manoeuvre | None, Obstacle]:
        """The gentlest manoeuvre after a command that nobody can be in the way of; without one,
        what is in the way of the strongest braking."""
        local, ego = local_of(self._task, situation), self._task.ego
        blocked = Obstacle(NOBODY, 0.0)
        for decel in (ego.comfort_decel, ego.max_decel):
            for begin in (BRAKE, HOLD, ACCELERATE):
                plan, obstacle = self._drive(local, situation, command, begin, decel)
                if obstacle.agent == NOBODY:
                    return Manoeuvre(situation.scene.time, plan, True), obstacle
                blocked = obstacle if begin == BRAKE else blocked
        return None, blocked

    def _drive(
        self, local: LocalMap, situation: Situation, command: Follow, begin: int, decel: float
    ) -> tuple[Plan, Obstacle]:
        """What a command and the manoeuvre after it come to; without speeds the manoeuvre begins at
        once."""
        ego, steps = self._task.ego, math.ceil(LONGEST_S / self._task.ego.step)
        speeds = np.asarray(command.speeds, np.float64)
        period = max(1, round(self._period / ego.step)) if len(speeds) else 0
        nodes, motion, pose = np.zeros(steps, np.int64), np.zeros((steps, 2)), np.zeros((steps, 4))
        used, agent, when = drive(
            local, ego, self._assumed, self._top_speeds(situation), situation.state, speeds,
            command.lane_change, period, begin, decel,
            nodes, motion, pose,
        )  # fmt: skip
        times = (np.arange(used, dtype=np.float64) + 1.0) * ego.step
        lanes = self._task.route.lane[nodes[:used]].astype(np.int32)
        return Plan(
            times, motion[:used, 1].copy(), lanes, motion[:used, 0].copy(), pose[:used].copy()
        ), Obstacle(agent, when)

    def _top_speeds(self, situation: Situation) -> Floats:
        """[N] what each agent may reach, m/s: somewhat more than the limits of its way, at least
        what it drives already."""
        agents, lane = situation.scene.agents, situation.forecast.lane
        limit = np.where(lane >= 0, self._task.road.speed[lane], 0.0).max(axis=(0, 1), initial=0.0)
        return np.maximum(self._assumed.over_limit * limit, agents.v)


def nonsense(task: Task, state: State, decision: object) -> str:
    """Why this is no decision that SUMO could be told; "" where it is one."""
    command = getattr(decision, "command", None)
    if isinstance(command, Release):
        return ""
    if not isinstance(decision, Decision) or not isinstance(command, Follow):
        return f"no decision but {type(decision).__name__}"
    speeds, side = np.asarray(command.speeds), command.lane_change
    if speeds.ndim != 1 or not len(speeds) or speeds.dtype.kind not in "fiu":
        return f"speeds of shape {speeds.shape} and type {speeds.dtype}"
    if not np.isfinite(speeds).all() or (speeds < 0.0).any():
        return f"a speed of {speeds[~(np.isfinite(speeds) & (speeds >= 0.0))][0]:g} m/s"
    if side not in (-1, 0, 1):
        return f"a lane change by {side!r}"
    if side != 0 and state.progress > 0.0:
        return "a lane change during another one"
    if side != 0 and task.route.table[state.node, LEFT_NODE if side > 0 else RIGHT_NODE] < 0.0:
        return f"a lane change to the {'left' if side > 0 else 'right'}, where there is no lane"
    if not isinstance(decision.children, tuple) or not all(
        isinstance(child, RootChild) for child in decision.children
    ):
        return "children that are no tuple of RootChild"
    return "" if decision.plan is None else _nonsense_plan(decision.plan)


def _nonsense_plan(plan: object) -> str:
    """Why this is no plan; "" where it is one."""
    if not isinstance(plan, Plan):
        return f"no plan but {type(plan).__name__}"
    arrays = [np.asarray(each) for each in plan]
    m = len(arrays[0]) if arrays[0].ndim else 0
    shapes = [(m,)] * 4 + [(m, 4)]
    wrong = [
        i
        for i, each in enumerate(arrays)
        if each.shape != shapes[i] or each.dtype.kind not in "fiu" or not np.isfinite(each).all()
    ]
    return (
        f"a plan whose {Plan._fields[wrong[0]]} has shape {arrays[wrong[0]].shape}, or is not "
        "finite"
        if wrong
        else ""
    )


def _rest(manoeuvre: Manoeuvre, now: float) -> Plan:
    """The plan as far as it is not driven yet; at its end its last state goes on."""
    time, v, lane, s, pose = manoeuvre.plan
    driven = now - manoeuvre.time
    left = slice(min(int(np.searchsorted(time, driven + 1e-6)), len(time) - 1), None)
    return Plan(
        time[left] - driven, v[left].copy(), lane[left].copy(), s[left].copy(), pose[left].copy()
    )


def _in_words(situation: Situation, obstacle: Obstacle) -> str:
    """Who is where, and what could happen."""
    if obstacle.agent == NO_END:
        return "the ego would not come to a stop"
    ego, agents, i = situation.scene.ego, situation.scene.agents, obstacle.agent
    away = math.hypot(agents.x[i] - ego.x, agents.y[i] - ego.y)
    return (
        f"no stop and no way out that {agents.ids[i]} ({coming(ego, agents, i)}, {away:.0f} m "
        f"away, {agents.v[i]:.1f} m/s) could not meet, "
        f"the hardest stop in {obstacle.time:.1f} s"
    )


def coming(ego: EgoState, agents: Agents, i: int) -> str:
    """How agent i comes, seen from the ego: crossing, oncoming, or the same way ahead or behind."""
    turned = agents.heading[i] - ego.heading
    if abs(math.sin(turned)) > math.sin(math.acos(ALONG)):
        return "crossing"
    before = (agents.x[i] - ego.x) * math.cos(ego.heading) + (agents.y[i] - ego.y) * math.sin(
        ego.heading
    ) > 0.0
    return "oncoming" if math.cos(turned) <= 0.0 else "ahead" if before else "behind"


# --- compiled ---


@entry
def drive(
    local: LocalMap, p: EgoParams, q: Assumed, top: Floats, start: State, speeds: Floats, side: int,
    period: int, begin: int, decel: float,
    nodes: Indices, motion: Floats, pose: Floats,
) -> tuple[int, int, float]:  # fmt: skip
    """The commanded `speeds` for `period` steps, then a manoeuvre that ends in braking with `decel`
    (m/s2); `top` [N] in m/s.

    Written down step by step: nodes [M], motion [M, 2] s and v, pose [M, 4]. Returns the number of
    steps written, who could be in the way (NOBODY; NO_END where the manoeuvre comes to no end, or
    is none of its own), and when, s from now.
    """
    state = begin_change(local, p, start, side) if side != 0 else start
    checks = max(1, math.ceil(p.step / CHECK_S))
    interval = p.step / checks
    clear = 0.0
    for k in range(len(nodes)):
        time, before = k * p.step, state
        if k == period:
            clear = _to_clear(local, p, state)
            if begin != BRAKE and clear <= 0.0 and state.progress == 0.0:
                return k, NO_END, time  # the same as braking at once
        if k < period:
            wanted = speeds[k] if k < len(speeds) else state.v + min(state.a, 0.0) * p.step
            state, event = obey(local, p, state, wanted, time)
        else:
            accel = (
                -decel
                if begin == BRAKE or (clear <= 0.0 and state.progress == 0.0)
                else p.max_accel
                if begin == ACCELERATE
                else 0.0
            )
            state, event = advance(local, p, state, accel, time)
            clear -= state.v * p.step
        nodes[k] = state.node
        motion[k, 0], motion[k, 1] = state.s, state.v
        pose[k, 0], pose[k, 1], pose[k, 2], pose[k, 3] = pose_of(local, p, state)
        if event == GOAL:
            return k + 1, NOBODY, time
        for r in range(checks):
            moment = time + (r + 1.0) * interval
            agent = _in_the_way(
                local,
                p,
                q,
                top,
                start,
                within_step(local, p, before, state, (r + 1.0) / checks),
                moment,
                interval,
            )
            if agent != NOBODY:
                return k + 1, agent, moment
        if k >= period and state.v < AT_REST and time + p.step >= q.horizon:
            return k + 1, NOBODY, time
    return len(nodes), NO_END, len(nodes) * p.step


@kernel
def _to_clear(local: LocalMap, p: EgoParams, state: State) -> float:
    """m to where the ego has left the junction that it is in, or that it cannot stop before in
    comfort; 0 elsewhere."""
    node, end = state.node, local.node[state.node, LENGTH] - state.s
    if local.node[node, INTERNAL] == 0.0:
        node = int(local.node[node, NEXT])
        if (
            node < 0
            or local.node[node, INTERNAL] == 0.0
            or end > state.v * state.v / (2.0 * p.comfort_decel) + state.v * p.step
        ):
            return 0.0
        end += local.node[node, LENGTH]
    while local.node[node, NEXT] >= 0.0 and local.node[int(local.node[node, NEXT]), INTERNAL] > 0.0:
        node = int(local.node[node, NEXT])
        end += local.node[node, LENGTH]
    return end + 2.0 * p.half_length


@kernel
def _in_the_way(
    local: LocalMap,
    p: EgoParams,
    q: Assumed,
    top: Floats,
    start: State,
    state: State,
    moment: float,
    interval: float,
) -> int:
    """The first agent that could be where the ego is at `moment` (s from now), half an interval
    before or after; NOBODY."""
    x, y, cs, sn = pose_of(local, p, state)
    width = p.half_width + (local.aside if state.progress > 0.0 else 0.0)
    box = Box(x, y, cs, sn, p.half_length + 0.5 * state.v * interval, width)
    early, late = max(moment - 0.5 * interval, 0.0), moment + 0.5 * interval
    for i in range(local.agent.shape[1]):
        v = local.agent[0, i, V]
        most = _driven_most(v, q.accel, top[i], late)
        reach = (
            most
            + box.half_length
            + box.half_width
            + local.trait[i, HALF_LENGTH]
            + local.trait[i, HALF_WIDTH]
        )
        if (
            local.agent[0, i, NODE] == GONE
            or abs(local.agent[0, i, X] - x) > reach
            or abs(local.agent[0, i, Y] - y) > reach
        ):
            continue
        if _is_behind(local, start, i):
            continue  # it keeps its distance
        reacting = (
            min(most, _driven_reacting(v, q, top[i], late))
            if local.trait[i, REACTS] > 0.0
            else most
        )
        if _meets(local, state, i, _driven_least(v, q.decel, early), most, reacting, box):
            return i
    return NOBODY


@kernel
def _is_behind(local: LocalMap, start: State, i: int) -> bool:
    """Whether the agent is now behind the ego on a lane that leads to it."""
    node = int(local.agent[0, i, NODE])
    for target in (start.node, start.other):
        if (
            node >= 0
            and target >= 0
            and 0.0 < chain_gap(local, node, local.agent[0, i, S], target, start.s) < math.inf
        ):
            return True
    return False


@kernel
def _driven_least(v: float, decel: float, time: float) -> float:
    """m that an agent drives at least: braking from now on."""
    time = min(time, v / decel)
    return v * time - 0.5 * decel * time * time


@kernel
def _driven_most(v: float, accel: float, top: float, time: float) -> float:
    """m that an agent drives at most: accelerating up to its top speed."""
    rise = min(time, (top - v) / accel)
    return v * rise + 0.5 * accel * rise * rise + (v + accel * rise) * (time - rise)


@kernel
def _driven_reacting(v: float, q: Assumed, top: float, time: float) -> float:
    """m that an agent drives at most which brakes for the ego after its reaction time."""
    before = min(time, q.reaction)
    return _driven_most(v, q.accel, top, before) + _driven_least(
        min(v + q.accel * before, top), q.yield_decel, time - before
    )


@kernel
def _meets(
    local: LocalMap, state: State, i: int, least: float, most: float, reacting: float, box: Box
) -> bool:
    """Whether a box meets what agent i covers of its way from `least` to `most` (m from now); only
    to `reacting` where it would drive up to the box from behind, or set off towards it."""
    last = local.agent.shape[0] - 1
    if local.agent[last, i, NODE] != GONE:
        least = min(
            least, local.agent[last, i, DRIVEN]
        )  # the forecast's way ends there: it waits, or the forecast is over
    for t in range(max(last, 1)):
        then = min(t + 1, last)
        if local.agent[then, i, NODE] == GONE or local.agent[t, i, DRIVEN] > most:
            return False
        if local.agent[then, i, DRIVEN] < least or (
            t > 0 and local.agent[then, i, DRIVEN] - local.agent[t, i, DRIVEN] < 1e-6
        ):
            continue
        if _covers(local, state, i, t, then, least, most, box):
            ahead = (box.x - local.agent[t, i, X]) * local.agent[t, i, COS] + (
                box.y - local.agent[t, i, Y]
            ) * local.agent[t, i, SIN]
            along = (
                ahead > 0.0
                and box.cos * local.agent[t, i, COS] + box.sin * local.agent[t, i, SIN] > ALONG
            )
            if not along and local.agent[0, i, V] > AT_REST:
                return True
            return local.agent[t, i, DRIVEN] <= reacting and _covers(
                local, state, i, t, then, least, reacting, box
            )
    return False


@kernel
def _covers(
    local: LocalMap, state: State, i: int, t: int, then: int, least: float, most: float, box: Box
) -> bool:
    """Whether a box meets agent i anywhere between forecast times t and `then`, as far as that lies
    between `least` and `most` on its way."""
    here, way = local.agent[t, i, DRIVEN], local.agent[then, i, DRIVEN] - local.agent[t, i, DRIVEN]
    first, final = (
        (max((least - here) / way, 0.0), min((most - here) / way, 1.0))
        if way > 1e-6
        else (0.0, 0.0)
    )
    dx, dy = (
        local.agent[then, i, X] - local.agent[t, i, X],
        local.agent[then, i, Y] - local.agent[t, i, Y],
    )
    middle, half = (
        0.5 * (first + final),
        local.trait[i, HALF_LENGTH] + 0.5 * (final - first) * math.sqrt(dx * dx + dy * dy),
    )
    x, y, width = (
        local.agent[t, i, X] + middle * dx,
        local.agent[t, i, Y] + middle * dy,
        local.trait[i, HALF_WIDTH],
    )
    close = box.half_length + box.half_width + half + width
    if (
        abs(x - box.x) > close
        or abs(y - box.y) > close
        or apart(local, state.node, state.s, 2.0 * box.half_length, t, i)
    ):
        return False
    return boxes_touch(box, Box(x, y, local.agent[t, i, COS], local.agent[t, i, SIN], half, width))
