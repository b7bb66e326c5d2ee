"""Drivers to compare with: SUMO's own, car following with gap acceptance, and a blind and a random
one, which show how hard a scene is."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.config import ScenarioConfig
from sumo_mcts.model.interaction import place_is_free
from sumo_mcts.model.local_map import (
    AGENT,
    DRIVEN,
    ENTERS,
    HALF_LENGTH,
    HALF_WIDTH,
    IN_WAY,
    MERGES,
    NODE,
    OWN_NODE,
    LocalMap,
    S,
    State,
    V,
    boxes_meet,
    is_gone,
    on_other_level,
)
from sumo_mcts.model.motion import (
    EgoParams,
    advance,
    begin_change,
    can_change,
    follow_accel,
    pose_of,
)
from sumo_mcts.model.reactions import undisturbed
from sumo_mcts.model.route import LENGTH, LIMIT, NEXT, STOP_LINE, lane_pose
from sumo_mcts.numerics.geometry import COS, SIN, Box, X, Y
from sumo_mcts.numerics.kernel import entry
from sumo_mcts.planners.actions import lasting
from sumo_mcts.planners.base import STOP_DECEL, SeededPlanner, Situation, Task, local_of
from sumo_mcts.planners.candidates import follow_line
from sumo_mcts.planners.mcts import MctsParams, actions_of, in_steps, mcts_params
from sumo_mcts.planners.ply import DRIVEN_S, DRIVEN_V
from sumo_mcts.scene import Decision, Follow, Plan, PlannerMemory, Release

LOOK = 1.0  # m between the places on the path ahead at which others are looked for
VIEW_S = 6.0  # s of driving ahead for which they are
VIEW_GAP = 20.0  # m beyond that
PULLING_AWAY = 3.0  # m/s with which a stop line is reached at least, when its gap is judged


def make_sumo(_: Mapping[str, Any], scenario: ScenarioConfig) -> "SumoPlanner":
    """SUMO's own driver, whatever the scenario."""
    return SumoPlanner()


def make_constant(_: Mapping[str, Any], scenario: ScenarioConfig) -> "ConstantPlanner":
    """The planner `constant` of a scenario."""
    return ConstantPlanner(scenario.planner.period_s)


def make_idm(_: Mapping[str, Any], scenario: ScenarioConfig) -> "IdmPlanner":
    """The driver that the section `idm` describes."""
    p = scenario.idm
    params = IdmParams(
        headway=p.headway_s,
        gap=p.min_gap_m,
        accel=p.accel_mps2,
        decel=p.decel_mps2,
        critical_gap=p.critical_gap_s,
        cut_in_decel=p.cut_in_decel_mps2,
    )
    return IdmPlanner(params, scenario.planner.period_s)


def make_random(_: Mapping[str, Any], scenario: ScenarioConfig) -> "RandomPlanner":
    """The random driver with the actions of the section `planner`."""
    return RandomPlanner(mcts_params(scenario))


class SumoPlanner:
    """SUMO's own driver: the same referee, no planner. Every episode's twin."""

    needs_forecast = False

    def start(self, task: Task, seed: int) -> None:
        """Nothing to prepare."""

    def plan(self, situation: Situation) -> Decision:
        """Let SUMO drive."""
        return Decision(Release(), None, (), -1, "release", 0, 0)


class ConstantPlanner:
    """Keeps the speed of the take-over, and changes to the lanes that its route needs as soon as
    they exist. It ignores all other vehicles."""

    needs_forecast = False

    def __init__(self, period_s: float) -> None:
        self._period = period_s

    def start(self, task: Task, seed: int) -> None:
        """Take the ego over."""
        self._task = task
        self._speed = -1.0

    def memory(self) -> PlannerMemory:
        """The speed that it holds."""
        return PlannerMemory(np.array([self._speed]))

    def recall(self, memory: PlannerMemory) -> None:
        """Hold it on."""
        self._speed = float(memory.numbers[0])

    def plan(self, situation: Situation) -> Decision:
        """Hold the speed."""
        state, route = situation.state, self._task.route
        if self._speed < 0.0:
            self._speed = max(state.v, 1.0)
        side = int(np.sign(route.changes[state.node])) if state.progress == 0.0 else 0
        if (side > 0 and route.left[state.node] < 0) or (side < 0 and route.right[state.node] < 0):
            side = 0
        steps = max(1, round(self._period / self._task.ego.step))
        return Decision(
            Follow(np.full(2 * steps, self._speed), side), None, (), -1, "constant", 0, 0
        )


class IdmParams(NamedTuple):
    """See config.IdmConfig; SI units."""

    headway: float
    gap: float
    accel: float
    decel: float
    critical_gap: float
    cut_in_decel: float


class IdmPlanner:
    """Follows its leader, stops for red, yields by a critical time gap, and changes to the lanes
    that its route needs where the gap allows."""

    needs_forecast = True

    def __init__(self, params: IdmParams, period_s: float) -> None:
        self._params, self._period = params, period_s

    def start(self, task: Task, seed: int) -> None:
        """Take the ego over."""
        p = self._params
        self._task = task
        self._follower = task.ego._replace(
            max_accel=min(p.accel, task.ego.max_accel),
            approach_decel=p.decel,
            headway=p.headway,
            gap=p.gap,
        )

    def plan(self, situation: Situation) -> Decision:
        """Drive on for two periods; a new decision comes after one."""
        task, state = self._task, situation.state
        local = local_of(task, situation)
        side = self._side(local, state)
        state = begin_change(local, task.ego, state, side) if side != 0 else state
        gap, leader_v = leader_on_path(local, task.ego, state, VIEW_S * state.v + VIEW_GAP)
        steps = _two_periods(self._period, task)
        nodes, motion, pose = np.zeros(steps, np.int64), np.zeros((steps, 2)), np.zeros((steps, 4))
        _follow(
            with_yield_lines(local, state, self._params.critical_gap),
            task.ego,
            self._follower,
            state,
            gap,
            leader_v,
            nodes,
            motion,
            pose,
        )
        times = (np.arange(steps, dtype=np.float64) + 1.0) * task.ego.step
        plan = Plan(
            times,
            motion[:, DRIVEN_V].copy(),
            task.route.lane[nodes].astype(np.int32),
            motion[:, DRIVEN_S].copy(),
            pose,
        )
        return Decision(Follow(plan.v, side), plan, (), -1, "idm", 0, 0)

    def _side(self, local: LocalMap, state: State) -> int:
        """The lane change to begin now: -1, 0, 1."""
        side = int(np.sign(local.urgency[state.node - local.first]))
        if side == 0 or state.progress > 0.0:
            return 0
        if not can_change(local, self._task.ego, state, side):
            return 0
        changed = begin_change(local, self._task.ego, state, side)
        if not place_is_free(
            local, self._task.ego, self._task.cost, changed, undisturbed(local), 0
        ):
            return 0
        return (
            side
            if accel_behind(local, self._follower, changed) >= -self._params.cut_in_decel
            else 0
        )


class RandomPlanner(SeededPlanner):
    """Any action at the root of the search, each with the same probability: shows the value of
    choosing."""

    def __init__(self, params: MctsParams) -> None:
        self._params = params
        self._actions = actions_of(params)

    def plan(self, situation: Situation) -> Decision:
        """Draw until an action is possible; one that keeps the lane always is."""
        task, p = self._task, self._params
        local = local_of(task, situation)
        for accel, side, _ in self._rng.permutation(self._actions):
            plan = plan_of(task, p, local, situation.state, accel, side)
            if len(plan.v):
                break
        return Decision(Follow(plan.v, int(side)), plan, (), -1, "random", 0, 0)


def plan_of(
    task: Task, p: MctsParams, local: LocalMap, state: State, accel: float, side: float
) -> Plan:
    """Two periods of an action that the search could begin with; without steps where its lane
    change cannot begin."""
    line = lasting(accel, int(side), _two_periods(p.period_s, task))
    q = in_steps(p, task.ego.step, local.dt)
    return follow_line(local, task, q, state, undisturbed(local), line)[0]


def _two_periods(period_s: float, task: Task) -> int:
    """Steps of the simulation; the second period is for a decision that comes late."""
    return 2 * max(1, round(period_s / task.ego.step))


# --- car following and gap acceptance ---


def accel_behind(local: LocalMap, follower: EgoParams, changed: State) -> float:
    """The car following, m/s2, of the next vehicle behind in the lane of a change that has just
    begun; inf: there is none.

    The safety criterion of MOBIL (Kesting, Treiber, Helbing 2007); the other is taken to follow
    with the ego's own parameters.
    """
    now, target = local.agent[0], changed.other if changed.other >= 0 else changed.node
    now = now[now[:, NODE] >= 0.0]
    behind = (
        local.ahead[now[:, NODE].astype(np.int64) - local.first, target - local.first]
        + changed.s
        - now[:, S]
    )
    behind[behind < 0.0] = math.inf
    if behind.min(initial=math.inf) == math.inf:
        return math.inf
    nearest = int(np.argmin(behind))
    return float(
        follow_accel(
            follower,
            float(now[nearest, V]),
            local.limit,
            float(behind[nearest]) - 2.0 * follower.half_length,
            changed.v,
        )
    )


def with_yield_lines(local: LocalMap, state: State, critical_gap: float) -> LocalMap:
    """The local map with additional closed stop lines: before each stretch of the ego's path that
    an agent with the right of way is to reach too soon.

    Too soon: before the ego could be at the line and `critical_gap` (s) more have passed. An ego
    that cannot stop any more with STOP_DECEL goes on.
    """
    closed, table = local.closed.copy(), local.node.copy()
    for each in local.obligation:
        to_line = (
            float(local.ahead[state.node - local.first, int(each[OWN_NODE]) - local.first])
            - state.s
        )
        if (
            not state.v**2 / (2.0 * STOP_DECEL) <= to_line < math.inf
            or int(each[OWN_NODE]) == state.node
            or math.isinf(each[ENTERS])  # it waits at the kerb
            or each[MERGES] == IN_WAY  # it is there already, and waited for in the motion
        ):
            continue
        arrives = (
            float(np.argmax(local.agent[:, int(each[AGENT]), DRIVEN] >= each[ENTERS])) * local.dt
        )
        if arrives < to_line / max(state.v, PULLING_AWAY) + critical_gap:
            line = _before(table, state.node, int(each[OWN_NODE]))
            table[line, STOP_LINE], closed[line - local.first] = 1.0, 1
    return local._replace(node=table, closed=closed)


def _before(table: Floats, node: int, target: int) -> int:
    """The node on the path from `node` that leads into `target`."""
    while int(table[node, NEXT]) != target:
        node = int(table[node, NEXT])
    return node


@entry
def leader_on_path(
    local: LocalMap, p: EgoParams, state: State, reach: float
) -> tuple[float, float]:
    """The distance (m, up to `reach`) until the ego's box would meet another one, and the speed
    (m/s) of that vehicle along the ego's path.

    Boxes count, not lanes: the rear of a vehicle that turns off also blocks the path, and so does a
    vehicle that waits at an angle. During a change both lanes count.
    """
    gap, leader_v = math.inf, 0.0
    for lane in range(2):
        node, s, driven = (state.node if lane == 0 else state.other), state.s, 0.0
        while node >= 0 and driven < min(reach, gap):
            x, y, c, n = lane_pose(local.node, local.row, node, s)
            for i in range(local.agent.shape[1]):
                dx, dy = local.agent[0, i, X] - x, local.agent[0, i, Y] - y
                length, width = local.trait[i, HALF_LENGTH], local.trait[i, HALF_WIDTH]
                near = p.half_length + p.half_width + length + width
                if (
                    is_gone(local, 0, i)
                    or abs(dx) > near
                    or abs(dy) > near
                    or dx * c + dy * n < 0.0
                    or on_other_level(local, node, s, 2.0 * p.half_length, 0, i)
                ):
                    continue
                bc, bs = local.agent[0, i, COS], local.agent[0, i, SIN]
                other = Box(x + dx, y + dy, bc, bs, length, width)
                own = Box(x, y, c, n, p.half_length, p.half_width)
                if driven < gap and boxes_meet(local, node, s, p.half_length, own, other, 0, i):
                    gap, leader_v = driven, max(0.0, local.agent[0, i, V] * (c * bc + n * bs))
            driven, s = driven + LOOK, s + LOOK
            while node >= 0 and s > local.node[node, LENGTH]:
                s -= local.node[node, LENGTH]
                node = int(local.node[node, NEXT])
    return gap, leader_v


@entry
def _follow(
    local: LocalMap,
    p: EgoParams,
    follower: EgoParams,
    state: State,
    gap: float,
    leader_v: float,
    nodes: Indices,
    motion: Floats,
    pose: Floats,
) -> None:
    """Car following by the parameters of `follower` behind a leader that keeps its speed. Each step
    fills a row of nodes [M], motion [M, 2] DRIVEN_S and DRIVEN_V, and poses [M, 4]."""
    for k in range(len(nodes)):
        wanted = follow_accel(follower, state.v, local.node[state.node, LIMIT], gap, leader_v)
        state, _ = advance(local, p, state, wanted, k * p.step)
        gap += (leader_v - state.v) * p.step
        nodes[k], motion[k, DRIVEN_S], motion[k, DRIVEN_V] = state.node, state.s, state.v
        pose[k, X], pose[k, Y], pose[k, COS], pose[k, SIN] = pose_of(local, p, state)
