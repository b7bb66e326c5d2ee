"""A decision in words."""

from sumo_mcts.records import CycleRecord
from sumo_mcts.scene import Decision, Follow

BRAKING = -1.0  # m/s2: harder than this, brake lights are shown


def action_words(cycle: CycleRecord) -> str:
    """The decision of a cycle: verb, acceleration, lane change, what is asked, and reason."""
    accel, change = _action(cycle.decision, cycle.ego.v)
    if accel is None:
        return "SUMO drives"
    words = [verb_of(cycle)]
    if abs(accel) >= 0.05 and words != ["stand"]:
        sign = "+" if accel > 0 else "\u2212"
        words[0] += f" {sign}{abs(accel):.1f} m/s\u00b2"
    if change:
        does = "back" if 0 < cycle.ego.changing < 1 else "change"
        words.append(f"{does} to the " + ("left" if change > 0 else "right"))
    elif 0 < cycle.ego.changing < 1:
        words.append(
            "changing to the "
            + ("left" if cycle.ego.change_to > cycle.ego.change_from else "right")
        )
    command = cycle.decision.command
    if isinstance(command, Follow) and command.asks:
        words.append("asks for room on the " + ("left" if command.asks > 0 else "right"))
    if isinstance(command, Follow) and command.shift:
        side = "left" if command.shift > 0 else "right"
        words.append(f"{abs(command.shift):.1f} m to the {side} within its lane")
    reason = cycle.decision.reason.partition(":")[0]  # the fail-safe's has an explanation, too
    if reason not in ("", "search", words[0].split()[0]):
        words.append(reason)
    return ", ".join(words)


def verb_of(cycle: CycleRecord) -> str:
    """What the ego is to do, in a word or two."""
    accel, _ = _action(cycle.decision, cycle.ego.v)
    if accel is None:
        return "release"
    if cycle.ego.v < 0.1 and accel <= 0.1:
        return "stand"
    limits = ((-4.0, "brake hard"), (-0.05, "brake"), (0.05, "keep speed"))
    return next((word for limit, word in limits if accel < limit), "accelerate")


def _action(decision: Decision, v: float) -> tuple[float | None, int]:
    """Acceleration in m/s2 (None: SUMO drives) and lane change of a decision."""
    if not isinstance(decision.command, Follow):
        return None, 0
    if 0 <= decision.chosen < len(decision.children):
        child = decision.children[decision.chosen]
        return child.accel, child.lane_change
    speeds, side, plan = decision.command.speeds, decision.command.lane_change, decision.plan
    if plan is None or len(speeds) == 0:
        return 0.0, side
    until = plan.time[min(len(speeds), len(plan.time)) - 1]
    return (0.0 if until <= 0 else float((speeds[-1] - v) / until)), side
