"""The last check: a decision is executed only if the ego can still come to a safe end after it.

This has to hold for everything that the others may do within bounds.

The idea is Pek and Althoff's (Fail-safe motion planning for online verification of autonomous
vehicles using convex optimization, IEEE Transactions on Robotics, 2021). Here each agent keeps to
the path that the forecast has for it, and drives it as slowly or as fast as the bounds allow. What
it may cover meanwhile has to stay clear of the ego. The ego carries the decision out for one period
and then stops, or leaves the junction or ends its lane change first.

Two things are expected of the others. An agent behind the ego keeps its distance. An agent brakes
after a reaction time where the ego moves in front of it, or where it stands and would set off
towards the ego.
"""

import math
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.model.local_map import LocalMap, V
from sumo_mcts.numerics.lanes import limits
from sumo_mcts.planners.base import Situation, Task, local_of
from sumo_mcts.planners.failsafe_reach import (
    ACCELERATE,
    ALONG,
    BRAKE,
    HOLD,
    NO_AGENT,
    NO_END,
    Assumed,
    drive,
)
from sumo_mcts.planners.ply import DRIVEN_S, DRIVEN_V
from sumo_mcts.scene import Agents, Decision, EgoState, Follow, Manoeuvre, Plan

LONGEST_S = 30.0  # longest duration of a manoeuvre
REASON = "fail-safe"


class Obstacle(NamedTuple):
    """Why a manoeuvre is not safe."""

    agent: int  # index, NO_AGENT, or NO_END
    time: float  # s from now


class FailSafe:
    """Verifies the decisions for one ego, and keeps a manoeuvre for a decision that fails."""

    def __init__(self, assumed: Assumed, period_s: float) -> None:
        self._assumed, self._period = assumed, period_s
        self.ready: Manoeuvre | None = None  # the last one verified

    def start(self, task: Task) -> None:
        """Take the ego over."""
        self._task, self.ready = task, None

    def forget(self) -> None:
        """Drop the verified manoeuvre, since the ego no longer follows it."""
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
        """The gentlest manoeuvre after a command that is safe from all agents.

        If there is none: None, and the obstacle of the strongest braking.
        """
        local, ego = local_of(self._task, situation), self._task.ego
        blocked = Obstacle(NO_AGENT, 0.0)
        for decel in (ego.comfort_decel, ego.max_decel):
            for begin in (BRAKE, HOLD, ACCELERATE):
                plan, obstacle = self._drive(local, situation, command, begin, decel)
                if obstacle.agent == NO_AGENT:
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
            local, ego, self._assumed, self._top_speeds(situation, local), situation.state, speeds,
            command.lane_change, period, begin, decel,
            nodes, motion, pose,
        )  # fmt: skip
        plan = Plan(
            time=(np.arange(used, dtype=np.float64) + 1.0) * ego.step,
            v=motion[:used, DRIVEN_V].copy(),
            lane=self._task.route.lane[nodes[:used]].astype(np.int32),
            s=motion[:used, DRIVEN_S].copy(),
            pose=pose[:used].copy(),
        )
        return plan, Obstacle(agent, when)

    def _top_speeds(self, situation: Situation, local: LocalMap) -> Floats:
        """[N] what each agent may reach, m/s: somewhat more than the limits of its path, at least
        what it drives already. Who is not seen drives as fast as it may."""
        agents, lane = situation.scene.agents, situation.forecast.lane
        allowed = np.where(lane >= 0, limits(self._task.road, lane, agents.vclass), 0.0)
        seen = np.maximum(
            self._assumed.over_limit * allowed.max(axis=(0, 1), initial=0.0), agents.v
        )
        return np.append(seen, local.agent[0, len(seen) :, V])


def _rest(manoeuvre: Manoeuvre, now: float) -> Plan:
    """The plan as far as it is not driven yet; at its end its last state goes on."""
    time, v, lane, s, pose = manoeuvre.plan
    driven = now - manoeuvre.time
    left = slice(min(int(np.searchsorted(time, driven + 1e-6)), len(time) - 1), None)
    return Plan(
        time[left] - driven, v[left].copy(), lane[left].copy(), s[left].copy(), pose[left].copy()
    )


def _in_words(situation: Situation, obstacle: Obstacle) -> str:
    """Which agent is where, and what could happen."""
    if obstacle.agent == NO_END:
        return "the ego would not come to a stop"
    ego, agents, i = situation.scene.ego, situation.scene.agents, obstacle.agent
    if i >= len(agents.ids):
        return f"no way back before somebody could come that is not seen, in {obstacle.time:.1f} s"
    away = math.hypot(agents.x[i] - ego.x, agents.y[i] - ego.y)
    return (
        f"no stop and no way out that {agents.ids[i]} ({coming(ego, agents, i)}, {away:.0f} m "
        f"away, {agents.v[i]:.1f} m/s) could not meet, "
        f"the hardest stop in {obstacle.time:.1f} s"
    )


def coming(ego: EgoState, agents: Agents, i: int) -> str:
    """How agent i comes, seen from the ego: crossing, oncoming, or in the same direction ahead or
    behind."""
    turned = agents.heading[i] - ego.heading
    if abs(math.sin(turned)) > math.sin(math.acos(ALONG)):
        return "crossing"
    before = (agents.x[i] - ego.x) * math.cos(ego.heading) + (agents.y[i] - ego.y) * math.sin(
        ego.heading
    ) > 0.0
    return "oncoming" if math.cos(turned) <= 0.0 else "ahead" if before else "behind"
