"""What really happened to one ego: its outcome, who was to blame, and which rules and which other
drivers it bent.

Judged from the frames that SUMO's states make up, once a simulation step, for any driver of the ego
alike. Nothing here knows what a planner intended.
"""

from collections.abc import Iterable
from math import hypot, inf, isfinite, isnan
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.evaluation.contact import (
    Contact,
    ahead_of,
    as_pose,
    boxes_of,
    boxes_overlap,
    first_contact,
    jumped,
    kept_apart,
    touch_point,
)
from sumo_mcts.evaluation.metrics import comfortable_share, events, jerks, rms
from sumo_mcts.evaluation.reachability import (
    REACH,
    Drive,
    can_meet,
    driven,
    goal_reaching_edges,
    spread,
)
from sumo_mcts.numerics.lanes import successors
from sumo_mcts.numerics.signals import shows
from sumo_mcts.scene import GREEN, RED, STANDING, Agents, Bools, EgoState, Frame, Ints, RoadMap

ARRIVED, COLLISION, TELEPORTED, OFF_ROUTE, TIMEOUT, ERROR = (
    "arrived",
    "collision",
    "teleported",
    "off_route",
    "timeout",
    "error",
)
HARD_BRAKE = 4.5  # m/s2
IMPOSED = (2.0, 3.0, 4.0)  # m/s2
STOPPABLE_RED, STOPPABLE_YELLOW = (
    4.5,
    3.0,
)  # m/s2: whoever needed more to stop could not be asked to
SPEEDING = 0.1  # m/s above the limit
TOUCHING = 0.1  # m: a contact this close to the plane of a bumper is on it
CHANGE_COUNTS_S = 3.0
DRIFT = 0.02  # m sideways within one step: on the way into another lane
BLOCKED_GAP, BLOCKED_SPEED = (
    5.0,
    1.0,
)  # m, m/s: a leader this close and this slow blocks whoever stands behind it
PATH_S, MIN_PATH = 4.0, 10.0  # s, m of an agent's path on which an ego is in its way
ENTERING_S = 2.0  # s of an ego's route that count as about to be entered
_EPS = 1e-6


class Goal(NamedTuple):
    """Where the ego has to go, and until when."""

    edges: tuple[
        int, ...
    ]  # its route at departure: the first is where it departed, the last the goal
    # -1: arrived at the end of the goal edge; else as soon as the front is on this edge or on one
    # after it
    success_edge: int
    time_limit: float  # s after departure
    free_flow: float  # s; nan unknown


class _Stretch(NamedTuple):
    """A part of a lane that the ego is on or comes over: positions on that lane, m."""

    lane: int
    begin: float
    end: float
    front: float  # where the ego's front is, as this lane counts; below 0: not on it yet


def needed_decel(v: float, distance: float) -> float:
    """Deceleration, m/s2, that stops from v, m/s, within distance, m."""
    return v * v / (2.0 * max(distance, 1e-3))


class Referee:
    """Judges one ego.

    Feed it every frame from the take-over on; it answers with the outcome once there is one.
    """

    def __init__(
        self, road: RoadMap, goal: Goal, step: float, take_over: Frame | None = None
    ) -> None:
        """``step`` in s. take_over: the state in which the ego was taken over, right after its
        departure; else the first frame observed is it."""
        self._road, self._goal, self._step = road, goal, step
        self._outcome: str | None = None
        self._error: str | None = None
        self._at_fault: bool | None = None
        self._last: Frame | None = None
        self._departed = 0.0
        self._finished: float | None = None
        self._reaching: Bools = np.zeros(0, np.bool_)
        # position on the route, as an index into goal.edges; the success edge may come twice on it,
        # the last time counts
        self._at = 0
        self._success = max(
            (k for k, edge in enumerate(goal.edges) if edge == goal.success_edge), default=-1
        )
        self._on_goal = self._done = False
        # one entry a state, from take-over on
        self._v: list[float] = []
        self._heading: list[float] = []
        self._odometer: list[float] = []
        self._speeding = 0
        self._changes = 0
        self._change_began = -inf
        self._trail: list[int] = []  # lanes under the ego, the front's last
        self._last_green: NDArray[np.int64] = np.zeros(
            0, np.int64
        )  # per signalled link: the state in which it last showed green
        self._red = self._yellow = 0
        self._red_junction = -1  # entered against red
        self._red_runners: dict[str, int] = {}  # agent -> junction that it entered against red
        self._collided: list[str] = []
        self._imposed: list[tuple[float, float]] = []  # time, deceleration
        self._ttc, self._pet, self._drac = inf, inf, -inf
        if take_over is not None:
            self._begin(take_over)

    def fail(self, message: str) -> None:
        """The run could not go on for a reason that the frames do not show.

        Changes nothing once there is an outcome.
        """
        if self._outcome is None:
            self._outcome, self._error = ERROR, message

    def observe(self, frame: Frame) -> str | None:
        """The outcome, from the step on in which the episode ended for this ego; until then
        None."""
        if self._outcome is not None:
            return self._outcome
        before = self._last
        hits: dict[str, Contact | None] = {}
        if before is None:
            self._begin(frame)
            if frame.present:
                hits = self._contacts(
                    frame, frame, np.arange(len(frame.agents.ids), dtype=np.int32)
                )
        elif frame.present:
            self._move(before, frame)
            known = _match(before.agents.ids, frame.agents.ids)
            self._note_red_runners(before, frame, known)
            self._note_imposed_braking(before, frame, known)
            hits = self._contacts(before, frame, known)
        elif frame.arrived and before.ego.lane >= 0 and self._odometer:
            # what is left of the last lane was driven before SUMO took the ego out
            rest = float(self._road.length[before.ego.lane]) - before.ego.s
            self._odometer[-1] += min(max(rest, 0.0), before.ego.v * self._step)
        for name in frame.collisions:
            hits.setdefault(name, None)
        self._note_surrogates(frame)
        self._outcome = self._judge(frame, bool(hits))
        if self._outcome == COLLISION:
            self._collided = sorted(hits)
            self._at_fault = any(
                self._blame(before or frame, frame, name, contact) for name, contact in hits.items()
            )
        if self._outcome == ARRIVED:
            self._finished = frame.time
        self._last = frame
        return self._outcome

    def row(self) -> dict[str, Any]:
        """The keys of an episode's row that states alone can tell; None where undefined."""
        v, heading = np.array(self._v), np.array(self._heading)
        decel = -np.diff(v) / self._step
        hard = np.flatnonzero(decel > HARD_BRAKE + _EPS)
        imposed = np.array([strength for _, strength in self._imposed])
        found = events([time for time, _ in self._imposed], imposed.tolist(), self._step)
        counted = {
            f"imposed_brakes_{limit:.0f}": sum(strength > limit + _EPS for strength in found)
            for limit in IMPOSED
        }
        row = {
            "outcome": self._outcome,
            "error": self._error,
            "at_fault": self._at_fault,
            "collisions": len(self._collided),
            "travel_time_s": None if self._finished is None else self._finished - self._departed,
            "free_flow_s": self._goal.free_flow if isfinite(self._goal.free_flow) else None,
            "in_time": self._outcome == ARRIVED,
            "distance_m": self._odometer[-1] if self._odometer else 0.0,
            "stopped_s": float(np.sum(v[1:] < STANDING)) * self._step,
            "max_decel_mps2": float(max(0.0, decel.max(initial=0.0))),
            "hard_brakes": len(
                events((hard * self._step).tolist(), decel[hard].tolist(), self._step)
            ),
            "rms_jerk_mps3": rms(jerks(v, self._step)),
            "comfortable_share": comfortable_share(v, heading, self._step),
            "speeding_share": self._speeding / (len(v) - 1) if len(v) > 1 else None,
            "lane_changes": self._changes,
            "red_lights_run": self._red,
            "yellow_run": self._yellow,
            "imposed_max_decel_mps2": float(imposed.max(initial=0.0)),
            **counted,
            "min_ttc_s": self._ttc if isfinite(self._ttc) else None,
            "min_pet_s": self._pet if isfinite(self._pet) else None,
            "max_drac_mps2": self._drac if isfinite(self._drac) else None,
        }
        # who could not go on must not look careful
        known = ("outcome", "error", "free_flow_s", "in_time", "distance_m")
        return (
            row
            if self._outcome != ERROR
            else {**dict.fromkeys(row), **{key: row[key] for key in known}}
        )

    # --- the ego's way ---

    def _begin(self, frame: Frame) -> None:
        ego = frame.ego
        self._last, self._departed = frame, frame.time
        self._reaching = goal_reaching_edges(self._road, self._goal.edges[-1], ego.vclass)
        if frame.present:
            self._note_state(frame, 0.0)
            self._trail = [ego.lane] if ego.lane >= 0 else []
            self._change_began = frame.time if ego.changing > 0 else -inf
            if ego.lane >= 0:
                self._advance((ego.lane,))
        self._note_surrogates(frame)

    def _note_state(self, frame: Frame, odometer: float) -> None:
        self._v.append(frame.ego.v)
        self._heading.append(frame.ego.heading)
        self._odometer.append(odometer)
        if len(self._last_green) != len(frame.signals.state):
            self._last_green = np.full(len(frame.signals.state), -1, np.int64)
        if len(self._last_green):
            self._last_green[frame.signals.state[:, 0] == GREEN] = len(self._v) - 1

    def _move(self, before: Frame, frame: Frame) -> None:
        """Takes the ego one step further: way driven, lane changes, lights, limits."""
        was, ego, road = before.ego, frame.ego, self._road
        if self._red_junction not in {int(road.junction[lane]) for lane in self._trail}:
            self._red_junction = -1  # it has left it; who comes back enters anew
        drive = None
        if was.lane >= 0 and ego.lane >= 0:
            drive = driven(
                road, was.lane, was.s, ego.lane, ego.s, 1.5 * max(was.v, ego.v) * self._step + REACH
            )
        if drive is None:  # off the lanes, or put somewhere else
            drive = Drive((), (), 0, ego.v * self._step)
            self._trail = [ego.lane] if ego.lane >= 0 else []
        elif drive.lanes or drive.changes:
            self._trail = [*self._trail, *drive.lanes] if drive.lanes else self._trail
            self._trail[-1:] = [ego.lane]
        if ego.lane >= 0:
            self._trim_trail(ego)
            self._advance((*drive.lanes, ego.lane))
            limit = float(road.speed[ego.lane]) * ego.speed_factor
            self._speeding += ego.v > limit + SPEEDING + _EPS
        began = ego.changing > 0 and (was.changing <= 0 or ego.changing < was.changing - _EPS)
        at_once = drive.changes > 0 and ego.changing <= 0 and was.changing <= 0
        if began or at_once:
            self._change_began = frame.time
        self._changes += drive.changes
        for lane, line in zip(drive.lanes, drive.lines, strict=True):
            if road.signal[lane] >= 0:
                self._cross_stop_line(before, frame, lane, self._odometer[-1] + line)
        self._note_state(frame, self._odometer[-1] + drive.distance)

    def _trim_trail(self, ego: EgoState) -> None:
        """Forgets the lanes that the ego's rear has left."""
        start, k = -ego.s, len(self._trail) - 1
        while k > 0 and start > -ego.length:
            k -= 1
            start -= float(self._road.length[self._trail[k]])
        del self._trail[:k]

    def _advance(self, lanes: Iterable[int]) -> None:
        """Follows the route along the lanes that the front has come over, and sees whether the goal
        lies behind it."""
        edges, success = self._goal.edges, self._goal.success_edge
        for lane in lanes:
            edge = int(self._road.edge[lane])
            left_goal = self._on_goal and edge != edges[-1]
            if edge in edges[self._at :]:
                self._at = edges.index(edge, self._at)
            self._on_goal = edge == edges[-1] and self._at == len(edges) - 1
            if success < 0:
                self._done |= left_goal
            else:
                self._done |= edge == success if self._success < 0 else self._at >= self._success

    # --- lights ---

    def _cross_stop_line(self, before: Frame, frame: Frame, lane: int, line: float) -> None:
        """The front went over the stop line before internal lane ``lane``;

        ``line``: its distance from the take-over, m.
        """
        road = self._road
        earlier, later = shows(before.signals, road, lane), shows(frame.signals, road, lane)
        if GREEN in (earlier, later):
            return
        link = int(frame.signals.offset[road.signal[lane]] + road.link[lane])
        # the end of green, or take-over where it was not green since
        then = max(0, int(self._last_green[link]))
        needed = needed_decel(self._v[then], line - self._odometer[then])
        # whoever stood in between has shown that stopping was possible
        if min(self._v[then + 1 :], default=inf) < STANDING:
            needed = 0.0
        if earlier == RED and later == RED:
            self._red_junction = int(road.junction[lane])
            self._red += needed <= STOPPABLE_RED
        else:
            self._yellow += needed <= STOPPABLE_YELLOW

    def _note_red_runners(self, before: Frame, frame: Frame, known: Ints) -> None:
        """Agents that drive through red: the ego owes them no way."""
        road, lanes = self._road, frame.agents.lane
        self._red_runners = {
            name: junction
            for name, junction in self._red_runners.items()
            if self._is_on(frame, name, junction)
        }
        if not len(self._last_green) or not len(lanes):
            return
        entered = (known >= 0) & (lanes >= 0) & (road.signal[lanes] >= 0)
        for i in np.flatnonzero(entered):
            lane = int(lanes[i])
            if before.agents.lane[known[i]] != lane and shows(
                before.signals, road, lane
            ) == RED == shows(frame.signals, road, lane):
                self._red_runners[frame.agents.ids[i]] = int(road.junction[lane])

    def _is_on(self, frame: Frame, name: str, junction: int) -> bool:
        """Whether a part of an agent is on a junction."""
        agents, i = frame.agents, _find(frame.agents.ids, name)
        if i < 0 or agents.lane[i] < 0:
            return False
        under = spread(
            self._road, int(agents.lane[i]), float(agents.s[i]), float(agents.length[i]), 0.0
        )
        return any(self._road.junction[lane] == junction for lane in under)

    # --- braking of others ---

    def _note_imposed_braking(self, before: Frame, frame: Frame, known: Ints) -> None:
        braking = self.braking_for_ego(before, frame, known)
        if braking:
            self._imposed.append((frame.time, max(decel for _, decel in braking)))

    def braking_for_ego(self, before: Frame, frame: Frame, known: Ints) -> list[tuple[str, float]]:
        """Who brakes for the ego in this step beyond the smallest threshold, and with how many
        m/s2."""
        if not len(known):
            return []
        was = np.append(before.agents.v, 0.0)[known]  # a newcomer (-1) finds the 0
        decel = np.where(known >= 0, (was - frame.agents.v) / self._step, 0.0)
        braking = np.flatnonzero((decel > IMPOSED[0] + _EPS) & ~frame.agents.person)
        if len(braking) == 0:
            return []
        stretches = self._body(frame.ego) + self._coming(frame)
        for_ego = [
            i
            for i in braking
            if frame.leader[i] == frame.ego.id
            or self._in_the_way(frame, int(i), float(was[i]), stretches)
        ]
        return [(frame.agents.ids[i], float(decel[i])) for i in for_ego]

    def _body(self, ego: EgoState) -> list[_Stretch]:
        """The lanes under the ego: that of its front, those that its rear has not left, and during
        a lane change both."""
        if ego.lane < 0:
            return []
        begin, end = ego.s - ego.length, ego.s
        here = (
            [
                _Stretch(lane, begin, end, ego.s)
                for lane in {ego.change_from, ego.change_to} - {ego.lane, -1}
            ]
            if ego.changing > 0
            else []
        )
        for k in range(len(self._trail) - 1, -1, -1):
            here.append(_Stretch(self._trail[k], begin, end, begin + ego.length))
            if begin >= 0 or k == 0:
                break
            end = float(self._road.length[self._trail[k - 1]])
            begin += end
        return here

    def _coming(self, frame: Frame) -> list[_Stretch]:
        """What the ego drives over within ENTERING_S at its present speed. A red light ends it."""
        ego, road = frame.ego, self._road
        lane, front, left = ego.lane, ego.s, ego.v * ENTERING_S
        found: list[_Stretch] = []
        while lane >= 0 and left > 0:
            begin, length = max(front, 0.0), float(road.length[lane])
            found.append(_Stretch(lane, begin, min(length, begin + left), front))
            left -= length - begin
            front -= length
            lane = self._next_on_route(lane, ego.route)
            if lane >= 0 and road.signal[lane] >= 0 and shows(frame.signals, road, lane) == RED:
                break
        return found

    def _next_on_route(self, lane: int, route: tuple[int, ...]) -> int:
        road = self._road
        after = successors(road, lane)
        if road.internal[lane]:
            return after[0] if after else -1
        edge = int(road.edge[lane])
        onto = route[route.index(edge) + 1] if edge in route[:-1] else -1
        return next(
            (lane_after for lane_after in after if road.edge[road.exit[lane_after]] == onto), -1
        )

    def _in_the_way(self, frame: Frame, i: int, v: float, stretches: list[_Stretch]) -> bool:
        """Whether the ego's stretches lie on the next PATH_S of agent i, which drove at v, m/s, or
        share a conflict area with them."""
        road, agents = self._road, frame.agents
        path = frame.paths[i].tolist() or [int(agents.lane[i])]
        if path[0] < 0:
            return False
        reach, start = max(MIN_PATH, PATH_S * v), -float(agents.s[i])
        for k, lane in enumerate(path):
            # whoever brakes before its own red light does not brake for what lies behind it
            if start > reach or (
                k and road.signal[lane] >= 0 and shows(frame.signals, road, lane) == RED
            ):
                return False
            for stretch in stretches:
                if stretch.lane != lane:
                    if self._shares_conflict(frame.ego.v, stretch, lane, start, reach, v):
                        return True
                elif (
                    start + stretch.front > 0 and start + stretch.begin <= reach
                ):  # in front of it, and near enough
                    return True
            start += float(road.length[lane])
        return False

    def _shares_conflict(
        self, ego_v: float, stretch: _Stretch, path: int, start: float, reach: float, v: float
    ) -> bool:
        """Whether an ego's stretch and lane ``path`` of an agent's way, which starts ``start`` m
        ahead of it, have a conflict area in common."""
        road = self._road
        for c in range(
            int(road.conflict_offset[stretch.lane]), int(road.conflict_offset[stretch.lane + 1])
        ):
            if (
                road.conflict_lane[c] != path
                or stretch.end <= road.conflict_begin[c]
                or stretch.begin >= road.conflict_end[c]
            ):
                continue
            near, far = (
                start + float(road.conflict_other_begin[c]),
                start + float(road.conflict_other_end[c]),
            )
            if far <= 0 or near > reach:
                continue
            # where both go on in one lane, whoever comes behind is no reason for the other to brake
            left = max(0.0, float(road.conflict_end[c]) - stretch.front)
            if (
                not road.conflict_merge[c]
                or left <= far
                or left / max(ego_v, 1.0) <= far / max(v, 1.0)
            ):
                return True
        return False

    # --- collisions ---

    def _contacts(self, before: Frame, frame: Frame, known: Ints) -> dict[str, Contact | None]:
        """Agents whose box the ego's met in this step; known [N]: index of each agent in the frame
        before, -1 new."""
        agents, ego, was = frame.agents, frame.ego, before.ego
        if not len(agents.ids):
            return {}
        half = np.array([ego.length / 2, ego.width / 2])
        now, then = np.array([ego.x, ego.y, ego.heading]), np.array([was.x, was.y, was.heading])
        radius = hypot(*half) + 0.5 * np.hypot(agents.length, agents.width)
        # whoever was driven here within the step came from no further away
        fastest = max(ego.v, was.v) + np.maximum(agents.v, np.append(before.agents.v, 0.0)[known])
        far = radius + 1.1 * fastest * self._step + 0.5
        near = np.flatnonzero((agents.x - ego.x) ** 2 + (agents.y - ego.y) ** 2 < far * far)
        if len(near) == 0:
            return {}
        other = np.stack([agents.x[near], agents.y[near], agents.heading[near]], axis=1)
        past = known[near]
        earlier = other.copy()
        seen = past >= 0
        old = before.agents
        earlier[seen] = np.stack(
            [old.x[past[seen]], old.y[past[seen]], old.heading[past[seen]]], axis=1
        )
        speed = agents.v[near].copy()
        speed[seen] = np.maximum(speed[seen], old.v[past[seen]])
        leap = ~seen | jumped(earlier, other, 1.5 * speed * self._step + 3.0)
        if before is frame or jumped(
            then, now, np.array(1.5 * max(ego.v, was.v) * self._step + 3.0)
        ):
            leap[:] = True
        sizes = 0.5 * np.stack([agents.length[near], agents.width[near]], axis=1)
        close = np.flatnonzero(leap | ~kept_apart(then, now, half, earlier, other, sizes))
        hits: dict[str, Contact | None] = {}
        for k in close:
            i = int(near[k])
            size = sizes[k]
            if leap[k]:
                touching = bool(boxes_overlap(boxes_of(now, half), boxes_of(other[k], size)))
                contact = Contact(as_pose(now), as_pose(other[k]), False) if touching else None
            else:
                contact = first_contact(then, now, earlier[k], other[k], half, size)
            if contact is not None and self._level(before, frame, i):
                hits[agents.ids[i]] = contact
        return hits

    def _level(self, before: Frame, frame: Frame, i: int) -> bool:
        """Whether the ego and agent i are where two vehicles can meet; what they drove in this step
        counts as body."""
        ego, agents = frame.ego, frame.agents
        if agents.person[i]:
            return True
        first = (ego.lane, ego.s, ego.length + max(ego.v, before.ego.v) * self._step)
        return can_meet(
            self._road,
            first,
            (
                int(agents.lane[i]),
                float(agents.s[i]),
                float(agents.length[i] + agents.v[i] * self._step),
            ),
        )

    def _blame(self, before: Frame, frame: Frame, name: str, contact: Contact | None) -> bool:
        """Whether the ego is at fault in a collision with agent ``name``.

        Unclear counts as at fault.
        """
        ego, agents = frame.ego, frame.agents
        i = _find(agents.ids, name)
        if i < 0 or not frame.present:
            return True
        j = _find(before.agents.ids, name)
        if (
            not self._moves(before, frame, j, i)
            or frame.time - self._change_began < CHANGE_COUNTS_S - _EPS
        ):
            return True
        if self._against_right_of_way(frame, i) or self._stands_on_junction(frame, i):
            return True
        half, size = (
            np.array([ego.length / 2, ego.width / 2]),
            np.array([agents.length[i] / 2, agents.width[i] / 2]),
        )
        if contact is None:  # SUMO saw what the boxes do not show
            contact = Contact(
                (ego.x, ego.y, ego.heading),
                (float(agents.x[i]), float(agents.y[i]), float(agents.heading[i])),
                False,
            )
        point = touch_point(contact, half, size)
        forward, its_forward = ahead_of(contact.ego, point), ahead_of(contact.other, point)
        if not contact.exact:
            # how deep they are in each other hides where they touched: clear only where the other
            # came from behind
            return not (forward <= -half[0] / 2 and its_forward >= size[0] / 2)
        if forward >= half[0] - TOUCHING:
            return True
        # by its own lane change, or on the way of one
        drifts = j >= 0 and _shifts(self._road, before.agents, j, agents, i)
        return not (its_forward >= size[0] - TOUCHING or drifts)

    def _moves(self, before: Frame, frame: Frame, j: int, i: int) -> bool:
        """Whether agent i (j before, -1: not there) drives, or is moved to the side by a lane
        change, as SUMO does with those that stand, too."""
        if j < 0:
            return bool(frame.agents.v[i] >= STANDING)
        moved = hypot(
            frame.agents.x[i] - before.agents.x[j], frame.agents.y[i] - before.agents.y[j]
        )
        return bool(max(frame.agents.v[i], before.agents.v[j], moved / self._step) >= STANDING)

    def _against_right_of_way(self, frame: Frame, i: int) -> bool:
        """Whether the ego is inside a junction that it entered against red, or inside a conflict
        area in which it has to let agent i pass."""
        ego, agents, road = frame.ego, frame.agents, self._road
        if ego.lane < 0:
            return True
        here = [(part.lane, part.begin - ego.v * self._step, part.end) for part in self._body(ego)]
        inside = {int(road.junction[lane]) for lane, _, _ in here} - {-1}
        if self._red_junction in inside or (agents.person[i] and inside):
            return True
        if agents.lane[i] < 0:
            return False
        margin = float(agents.v[i]) * self._step + 2.0
        theirs = spread(
            road, int(agents.lane[i]), float(agents.s[i]), float(agents.length[i]) + margin, margin
        )
        runs_red = self._red_runners.get(agents.ids[i], -2)
        for lane, begin, end in here:
            for c in range(int(road.conflict_offset[lane]), int(road.conflict_offset[lane + 1])):
                inside_area = begin < road.conflict_end[c] and end > road.conflict_begin[c]
                if (
                    road.conflict_yields[c]
                    and inside_area
                    and int(road.conflict_lane[c]) in theirs
                    and road.junction[lane] != runs_red
                ):
                    return True
        return False

    def _stands_on_junction(self, frame: Frame, i: int) -> bool:
        """Whether the ego stands on a junction and nobody in front of it, other than agent i, is
        the reason."""
        ego, agents, road = frame.ego, frame.agents, self._road
        if (
            ego.v >= STANDING
            or ego.lane < 0
            or not any(road.internal[part.lane] for part in self._body(ego))
        ):
            return False
        ahead = spread(
            road, ego.lane, ego.s, 0.0, BLOCKED_GAP + float(agents.length.max(initial=0.0))
        )
        for k in np.flatnonzero((agents.v < BLOCKED_SPEED) & ~agents.person):
            front = ahead.get(int(agents.lane[k]), -inf) + float(agents.s[k])
            if k != i and front > 0 and front - agents.length[k] <= BLOCKED_GAP:
                return False
        return True

    # --- judgement ---

    def _note_surrogates(self, frame: Frame) -> None:
        self._ttc = self._ttc if isnan(frame.ttc) else min(self._ttc, frame.ttc)
        self._pet = self._pet if isnan(frame.pet) else min(self._pet, frame.pet)
        self._drac = self._drac if isnan(frame.drac) else max(self._drac, frame.drac)

    def _judge(self, frame: Frame, hit: bool) -> str | None:
        """The outcome in this step, precedence as measures.md lists them."""
        lane = frame.ego.lane
        arrived = self._done or (frame.arrived and self._reaches_goal())
        if not (frame.present or frame.arrived or frame.teleported or hit):
            self._error = "vanished"
            return ERROR
        if hit:
            return COLLISION
        if frame.teleported:
            return TELEPORTED
        if (
            frame.arrived and not arrived
            # somebody else's goal: it was given another route, or one that leaves out the edge that
            # counts
        ):
            return OFF_ROUTE
        if (
            frame.present
            and lane >= 0
            and not arrived
            and not self._reaching[self._road.edge[lane]]
        ):
            return OFF_ROUTE
        if frame.time - self._departed > self._goal.time_limit + _EPS:
            return TIMEOUT
        return ARRIVED if arrived else None

    def _reaches_goal(self) -> bool:
        """Whether an ego that SUMO has taken out had come to the edge that counts, or came to it
        within its last step."""
        edges, last, road = self._goal.edges, self._last, self._road
        goal = self._success if self._goal.success_edge >= 0 else len(edges) - 1
        if goal <= self._at or last is None or last.ego.lane < 0:
            return 0 <= goal <= self._at
        between = sum(
            float(road.length[road.edge == edge].min()) for edge in edges[self._at + 1 : goal]
        )
        return (
            float(road.length[last.ego.lane]) - last.ego.s + between
            <= 1.5 * last.ego.v * self._step + REACH
        )


def _match(before: tuple[str, ...], now: tuple[str, ...]) -> Ints:
    """[len(now)] where each id stood before, -1 nowhere."""
    if before == now:
        return np.arange(len(now), dtype=np.int32)
    place = {name: i for i, name in enumerate(before)}
    return np.array([place.get(name, -1) for name in now], dtype=np.int32)


def _find(ids: tuple[str, ...], name: str) -> int:
    return ids.index(name) if name in ids else -1


def _shifts(road: RoadMap, before: Agents, j: int, now: Agents, i: int) -> bool:
    """Whether agent j of the frame before, i now, moved sideways on its road."""
    was, lane = int(before.lane[j]), int(now.lane[i])
    if was < 0 or lane < 0:
        return False
    return (
        bool(abs(now.d[i] - before.d[j]) > DRIFT)
        if was == lane
        else bool(road.edge[was] == road.edge[lane])
    )
