"""The page's tables, and the tiles above them: the numbers that one asks for first."""

from collections.abc import Mapping, Sequence
from html import escape

from sumo_mcts.records import Row
from sumo_mcts.records.statistics import (
    LEAST,
    SLOW,
    TWIN,
    Contrast,
    Estimate,
    Pair,
    Rate,
    arrived,
    at_fault,
    collided,
    contrast,
    pairs,
    rate,
    slow_ratios,
    some,
    time_ratio,
)
from sumo_mcts.reporting.cells import Cell, counted, is_numeric, number, signed, spread, text
from sumo_mcts.reporting.columns import Column, cell_of
from sumo_mcts.reporting.elements import bar, interval, number_cell, select, swatch
from sumo_mcts.reporting.tables import NOT_WORSE, Table
from sumo_mcts.reporting.variants import foremost, labelled, twins_of

_WORSE = f"More than {NOT_WORSE:g} in a hundred more than SUMO&#39;s driver"
_BARS = {"arrived": "", "collisions": " bad"}  # rates that are drawn, and how


# --- tiles ---


def tiles(variant: str, those: Sequence[Row], rows: Sequence[Row]) -> str:
    """The five numbers of a variant that one asks for first, from its rows among all `rows`."""
    planned = those[0]["planner"] != TWIN
    both = pairs(those, twins_of(rows)) if planned else []
    found = [
        *_outcome_tiles(those),
        *_twin_tiles(both),
        *(_planning_tiles(those) if planned else []),
    ]
    return f'<div class="tiles" data-variant="{escape(variant)}" hidden>{"".join(found)}</div>'


def _outcome_tiles(rows: Sequence[Row]) -> list[str]:
    ended, crashed = rate(map(arrived, rows)), rate(map(collided, rows))
    faults = rate(map(at_fault, rows)).k
    return [
        _tile(
            "Arrived",
            f"{ended.k}<small>of {ended.n}</small>",
            interval(ended),
            bar(ended, _BARS["arrived"]),
        ),
        _tile(
            "Collisions",
            f"{crashed.k}<small>of {crashed.n}</small>",
            f"{interval(crashed)}, {faults} at fault",
            bar(crashed, _BARS["collisions"]),
        ),
    ]


def _twin_tiles(both: Sequence[Pair]) -> list[str]:
    ratio, imposed = time_ratio(both), contrast(both, some("imposed_brakes_3"))
    found = []
    if ratio is not None:
        shown = f"{number(ratio.value)}<small>× SUMO's driver</small>"
        slow = [
            f"{percent} % up to {number(value)}"
            for percent, value in zip(SLOW, slow_ratios(both), strict=True)
            if value is not None
        ]
        text = ", ".join([interval(ratio), f"median of {counted(ratio.n, 'pair')}", *slow])
        found.append(_tile("Travel time", shown, text))
    if imposed is not None:
        text = (
            f"beyond 3 m/s²; SUMO's driver {imposed.other}: {signed(imposed.per_hundred)} per "
            f"hundred{spread(imposed)}"
        )
        found.append(_tile("Imposed braking", f"{imposed.k}<small>of {imposed.n}</small>", text))
    return found


def _planning_tiles(rows: Sequence[Row]) -> list[str]:
    cycles, late = (sum(row[key] or 0 for row in rows) for key in ("cycles", "deadline_misses"))
    typical = cell_of("plan_ms_p50", rows)
    if not cycles or not isinstance(typical, float):
        return []
    text = f"median; {late:g} of {counted(int(cycles), 'decision')} late"
    return [_tile("Decision time", f"{number(typical, 1)}<small>ms</small>", text)]


def _tile(label: str, big: str, text: str, bar: str = "") -> str:
    return (
        f'<div class="tile"><h3>{escape(label)}</h3><div '
        f'class="big">{big}</div>{bar}<p>{escape(text)}</p></div>'
    )


# --- tables ---


def html_table(table: Table, rows: Sequence[Row], colour: Mapping[str, str]) -> str:
    """A table whose columns sort it; where two variants are compared, one can be picked out."""
    variants = {labelled(row): str(row["variant"]) for row in rows}
    swatches = {label: swatch(colour[variant]) for label, variant in variants.items()}
    names = [i for i, column in enumerate(table.columns) if column.key in ("variant", "against")]
    head = "".join(_header(table, i) for i in range(len(table.columns)))
    body = []
    for row in table.rows:
        marks = "".join(
            f' data-{table.columns[i].key}="{escape(variants[str(row[i])])}"' for i in names
        )
        cells = "".join(
            _cell(cell, column, table.name, swatches)
            for cell, column in zip(row, table.columns, strict=True)
        )
        body.append(f"<tr{marks}>{cells}</tr>")
    picker = ""
    if len(names) > 1:
        involved = {variants[str(row[i])]: str(row[i]) for row in table.rows for i in names}
        picker = (
            '<div class="chooser"><label for="with">Those with</label> '
            f"{select('with', {'': 'any variant', **involved}, foremost(rows))}</div>"
        )
    return (
        f'<section aria-label="{escape(table.title)}"><h2>{escape(table.title)}</h2><p '
        f'class="about">{escape(table.about)}</p>{picker}'
        f'<div class="scroll"><table class="sortable grouped" id="table-{table.name}">'
        f"<thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table></div></section>"
    )


def _header(table: Table, i: int) -> str:
    column = table.columns[i]
    hint = f' data-tip="{escape(column.about)}"' if column.about else ""
    kind = "n" if any(is_numeric(row[i]) for row in table.rows) else ""
    share = " share" if isinstance(table.rows[0][i], Rate) else ""
    return (
        f'<th scope="col" class="{kind}{share}"><button '
        f'type="button"{hint}>{escape(column.heading)}</button></th>'
    )


def _cell(cell: Cell, column: Column, table: str, swatches: Mapping[str, str]) -> str:
    if isinstance(cell, str):
        patch = swatches[cell] if column.key in ("variant", "against") else ""
        return f"<td>{patch}{escape(cell)}</td>"
    if cell is None:
        return number_cell("", "-")
    if isinstance(cell, Rate):
        value = f"{cell.k / cell.n:.6f}" if cell.n else ""
        return number_cell(
            value,
            f"{cell.k}/{cell.n}",
            interval(cell),
            bar(cell, _BARS[column.key]) if column.key in _BARS else "",
        )
    if isinstance(cell, Contrast):
        worse = table == "twin" and cell.per_hundred > NOT_WORSE and cell.n >= LEAST
        mark = (
            f'<span class="worse" role="img" aria-label="worse" data-tip="{_WORSE}">▲ </span>'
            if worse
            else ""
        )
        return number_cell(
            f"{cell.per_hundred:.4f}",
            f"{mark}{cell.k} : {cell.other}",
            f"{signed(cell.per_hundred)}{spread(cell)}",
        )
    if isinstance(cell, Estimate):
        return number_cell(_sortable(cell.value), number(cell.value, column.digits), interval(cell))
    return number_cell(_sortable(cell), text(cell, column.digits))


def _sortable(value: float) -> str:
    return str(value).replace("inf", "Infinity")
