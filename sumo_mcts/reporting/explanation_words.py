"""An explanation in words, for a terminal."""

from typing import Any

from sumo_mcts.registry import ORACLE_MARK, PLANNERS, is_oracle
from sumo_mcts.scene import TERMS

SHOWN = 6  # agents in the text
MATTERS = 30.0  # m: an agent that comes no nearer is left out of the text
REASONS = {
    "search": "the lowest cost that was found",
    "carried on": "the last plan, carried on, costs no more than what was found",
    "release": "SUMO's own driver drives",
    **{row.name: row.label for row in PLANNERS.values() if row.label},
}
_STOOD = {
    "stopped_s": "in all",
    "longest_stop_s": "at a stretch",
    "stopped_at_green_s": "at green",
}
LOST = "every sequence ends in a contact: the one that loses least"


def text(explained: dict[str, Any]) -> str:
    """The explanation as text; `explained` is the result of explanation.explain."""
    oracle = " (an oracle)" if is_oracle(explained["prediction"]) else ""
    forecast = (
        ""
        if explained["prediction"] is None
        else f", forecast {explained['prediction'].removesuffix(ORACLE_MARK)}{oracle}"
    )
    head = (
        f"{explained['key']}: decision {explained['cycle']} of {explained['cycles']}, at "
        f"{explained['time_s']:.1f} s; planner {explained['planner'] or 'unknown'}{forecast}"
        f"{_stood(explained['stood'])}"
    )
    parts = [
        [head],
        _ego_lines(explained["ego"]),
        _agent_lines(explained),
        _hypothesis_lines(explained),
        _action_lines(explained),
        _decision_lines(explained),
        _executed_lines(explained),
    ]
    if "replan" in explained:
        parts.append(_again_lines(explained, explained["replan"]))
    return "\n\n".join("\n".join(part) for part in parts if part)


def _stood(stood: dict[str, Any]) -> str:
    """How long the ego stood in the whole episode; "" where the row does not tell."""
    if stood["stopped_s"] == 0.0:
        return "; the ego never stood"
    known = [f"{stood[key]:.1f} s {how}" for key, how in _STOOD.items() if stood[key] is not None]
    return f"; the ego stood {', '.join(known)}" if known else ""


def _ego_lines(ego: dict[str, Any]) -> list[str]:
    changing = "" if ego["changing_to"] is None else f", changing to {ego['changing_to']}"
    line = (
        f"ego {ego['id']}: {ego['v_mps']:.1f} m/s, {ego['a_mps2']:+.1f} m/s2, on "
        f"{ego['lane'] or 'no lane'} at {ego['s_m']:.1f} m{changing}"
    )
    lines, ahead = [line], ego["stop_line"]
    if ego["detour"] is not None:
        lines.append(f"  {ego['detour']}")
    if ahead is not None:
        lasts = "" if ahead["for_s"] is None else f", for {ahead['for_s']:.1f} s more"
        lines.append(f"  {ahead['kind']} in {ahead['distance_m']:.0f} m: {ahead['shows']}{lasts}")
    return lines


def _agent_lines(explained: dict[str, Any]) -> list[str]:
    agents = explained["agents"]
    if not agents:
        return ["others: none in sight"]
    shown = [
        agent
        for agent in agents
        if min(agent["closest_m"], agent["worst_m"], agent["away_m"]) <= MATTERS
    ][:SHOWN]
    rest = f" ({len(agents) - len(shown)} more)" if len(agents) > len(shown) else ""
    rows = [["", "comes", "away, m", "m/s", "nearest, m", "after, s", ""]]
    rows += [
        [
            a["id"],
            a["comes"],
            f"{a['away_m']:.0f}",
            f"{a['v_mps']:.1f}",
            f"{a['closest_m']:.1f}",
            f"{a['closest_s']:.1f}",
            _marks(a),
        ]
        for a in shown
    ]
    return [f"others, by how near they may come to the plan{rest}:", *_table(rows)]


def _marks(agent: dict[str, Any]) -> str:
    words = ["has to let the ego pass"] if agent["yields"] else []
    if agent["comes"] == "behind" and agent["reacts"]:
        words.append("brakes for the ego")
    if agent["worst_m"] < agent["closest_m"] - 0.5:
        words.append(f"{agent['worst_m']:.1f} m in hypothesis {agent['worst_hypothesis']}")
    return ", ".join(words)


def _hypothesis_lines(explained: dict[str, Any]) -> list[str]:
    hypotheses = explained["hypotheses"]
    if len(hypotheses) < 2:
        return []
    rows = [["", "weight", ""]]
    for h, each in enumerate(hypotheses, 1):
        rows.append(
            [
                str(h),
                f"{each['weight']:.3f}",
                each["words"]
                + ("" if each["searched"] else " (too unlikely for the iterations: not searched)"),
            ]
        )
    return ["hypotheses about the others:", *_table(rows)]


def _action_lines(explained: dict[str, Any]) -> list[str]:
    actions = explained["actions"]
    if not actions:
        return []
    several = max(len(action["hypotheses"]) for action in actions)
    beyond = [f"J in {h}" for h in range(1, several + 1)]
    rows = [["", "action", "m/s2", "lane", "visits", "mean J", "best J", *TERMS, *beyond]]
    for action in actions:
        totals = [_number(_total(terms)) for terms in action["hypotheses"]]
        costs = [
            _number(action["mean"]),
            _number(action["best"]),
            *(_number(action["terms"][name]) for name in TERMS),
        ]
        rows.append(
            [
                ">" if action["chosen"] else "",
                *_label(action),
                str(action["visits"]),
                *costs,
                *totals,
            ]
        )
    of = ", terms in hypothesis 1" if several else ""
    return [f"actions, the cheapest first{of}:", *_table(rows)]


def _label(action: dict[str, Any]) -> list[str]:
    return [
        action["action"],
        f"{action['accel_mps2']:+.1f}",
        {1: "left", -1: "right"}.get(action["lane_change"], ""),
    ]


def _total(terms: dict[str, float | None]) -> float | None:
    values = list(terms.values())
    return None if None in values else sum(value for value in values if value is not None)


def _decision_lines(explained: dict[str, Any]) -> list[str]:
    decision = explained["decision"]
    reason = decision["reason"]
    if decision["fail_safe"]:
        return [
            f"decision: {decision['words']}",
            f"  in place of what the planner decided; {reason}",
        ]
    why = REASONS.get(reason, LOST if reason == "brake" else reason)
    passes = f", after {decision['iterations']} iterations" if decision["iterations"] else ""
    return [f"decision: {decision['words']}", f"  {why}{passes}"]


def _executed_lines(explained: dict[str, Any]) -> list[str]:
    executed = explained["executed"]
    if executed["until_s"] is None:
        return [f"in SUMO: {executed['outcome'].replace('_', ' ')} before the next decision"]
    commanded = (
        "nothing commanded"
        if executed["commanded_mps"] is None
        else f"commanded {executed['commanded_mps']:.2f} m/s on {executed['commanded_lane']}"
    )
    came = f"{executed['executed_mps']:.2f} m/s on {executed['executed_lane'] or 'no lane'}"
    deviation = f" ({executed['deviation']})" if executed["deviation"] else ""
    return [f"in SUMO at {executed['until_s']:.1f} s: {commanded}, was {came}{deviation}"]


def _again_lines(explained: dict[str, Any], again: dict[str, Any]) -> list[str]:
    """The decision taken again, beside the recorded one where it is another."""
    settings = f"with {', '.join(again['set'])}" if again["set"] else "with the same settings"
    if again["identical"]:
        return [f"taken again {settings}: the identical decision"]
    doubt = (
        ""
        if again["set"] or again["reproducible"]
        else "; a decision that a clock has a say in is not reproducible"
    )
    rows = [["", "recorded", "again"]]
    for name, of in (
        ("decision", "words"),
        ("reason", "reason"),
        ("iterations", "iterations"),
        ("best J", "cost"),
    ):
        rows.append([name, *(_shown(each["decision"][of]) for each in (explained, again))])
    verdict = "the same command" if again["same_command"] else "another command"
    return [
        f"taken again {settings}: {verdict}{doubt}",
        *_table(rows),
        *_beside(explained["actions"], again["actions"]),
    ]


def _beside(recorded: list[dict[str, Any]], again: list[dict[str, Any]]) -> list[str]:
    """The actions of both, joined by what they are."""
    kinds = {_kind(action): _label(action) for action in (*again, *recorded)}
    if not kinds:
        return []
    rows = [
        [
            "action",
            "m/s2",
            "lane",
            "",
            "visits",
            "mean J",
            "best J",
            "",
            "again: visits",
            "mean J",
            "best J",
        ]
    ]
    for kind in dict.fromkeys(_kind(action) for action in (*recorded, *again)):
        cells = kinds[kind]
        for actions in (recorded, again):
            found = next((action for action in actions if _kind(action) == kind), None)
            if found is None:
                cells += ["", "", "", ""]
            else:
                cells += [
                    ">" if found["chosen"] else "",
                    str(found["visits"]),
                    _number(found["mean"]),
                    _number(found["best"]),
                ]
        rows.append(cells)
    return ["", *_table(rows)]


def _kind(action: dict[str, Any]) -> tuple[Any, ...]:
    """What makes it the same action in two searches: car following may come to another
    acceleration."""
    return (
        action["action"],
        action["accel_mps2"] if action["action"] == "acceleration" else None,
        action["lane_change"],
    )


def _shown(value: object) -> str:
    return "-" if value is None else f"{value:.3f}" if isinstance(value, float) else str(value)


def _number(value: float | None) -> str:
    return "lost" if value is None else f"{value:.2f}"


def _table(rows: list[list[str]]) -> list[str]:
    """Cells in columns, indented: words to the left, numbers to the right."""
    columns = list(zip(*rows, strict=True))
    widths = [max(map(len, column)) for column in columns]
    numeric = [all(_is_number(cell) for cell in column[1:]) for column in columns]
    lines = []
    for row in rows:
        cells = [
            cell.rjust(width) if right else cell.ljust(width)
            for cell, width, right in zip(row, widths, numeric, strict=True)
        ]
        lines.append(("  " + "  ".join(cells)).rstrip())
    return lines


def _is_number(cell: str) -> bool:
    return cell in ("", "lost") or cell.lstrip("+-").replace(".", "", 1).isdigit()
