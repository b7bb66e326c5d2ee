"""The page's list of highlights."""

from collections.abc import Mapping, Sequence
from html import escape

from sumo_mcts.records.highlights import STUCK_S
from sumo_mcts.records.statistics import arrived
from sumo_mcts.reporting.cells import counted, number
from sumo_mcts.reporting.columns import value_column
from sumo_mcts.reporting.elements import number_cell, swatch
from sumo_mcts.reporting.highlights import EACH, Highlight
from sumo_mcts.reporting.variants import labelled

_SHOWN = [
    value_column(key)
    for key in ("seed", "longest_stop_s", "min_ttc_s", "min_pet_s", "imposed_max_decel_mps2")
]


def highlights_about(shown: Sequence[Highlight], of: int) -> str:
    """What the list holds; `of`: how many highlights there are."""
    if not shown:
        return "None: SUMO's own driver is left out."
    count = f"{len(shown)} of {of} episodes" if of > len(shown) else counted(of, "episode")
    return (
        f"{count}: collisions at fault, egos that were stuck (until time was up, or standing "
        f"{STUCK_S:g} s longer than their twin), other collisions and outcomes than arrived, "
        f"fail-safe interventions; and of each scenario and variant the {EACH} smallest TTC, the "
        f"{EACH} smallest PET, the {EACH} hardest decelerations imposed on others and the {EACH} "
        f"longest stops of {STUCK_S:g} s or more, or else its first episode. SUMO's own driver is "
        "left out."
    )


def highlights_list(
    shown: Sequence[Highlight], replayed: Mapping[str, str], colour: Mapping[str, str]
) -> str:
    """The list; egos are named where there are several."""
    if not shown:
        return ""
    several = len({each.row["ego"] for each in shown}) > 1
    texts = ["Replay", "Scenario", "Variant", *(["Ego"] if several else []), "Why"]
    head = "".join(
        f'<th scope="col"{kind}><button type="button">{name}</button></th>'
        for kind, name in (
            *(("", name) for name in texts),
            *((" class=n", column.heading) for column in _SHOWN),
        )
    )
    body = "".join(_line(each, each.row["key"] in replayed, several, colour) for each in shown)
    return (
        '<div class="scroll"><table class="sortable '
        f'looks"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
    )


def _line(shown: Highlight, replayed: bool, several: bool, colour: Mapping[str, str]) -> str:
    row, reasons = shown
    opened = (
        '<button type="button" class="open">▶ Replay</button>'
        if replayed
        else '<span class="muted">no trace</span>'
    )
    chips = "".join(
        f'<span class="chip{" grave" if i == 0 and not arrived(row) else ""}">'
        f"{escape(reason)}</span>"
        for i, reason in enumerate(reasons)
    )
    error = f' data-tip="{escape(row["error"])}" tabindex="0"' if row["error"] else ""
    cells = [
        f"<td>{opened}</td>",
        f"<td>{escape(row['scenario'])}</td>",
        f"<td>{swatch(colour[row['variant']])}{escape(labelled(row))}</td>",
        *([f"<td>{escape(row['ego'] or '-')}</td>"] if several else []),
        f"<td{error}>{chips}</td>",
        *(_value_cell(row[column.key], column.digits) for column in _SHOWN),
    ]
    return (
        f'<tr data-key="{escape(row["key"])}" '
        f'data-why="{escape("; ".join(reasons))}">{"".join(cells)}</tr>'
    )


def _value_cell(value: float | None, digits: int) -> str:
    return number_cell("", "-") if value is None else number_cell(str(value), number(value, digits))
