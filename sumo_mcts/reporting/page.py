"""One page that shows a whole report and needs nothing but itself: tables, figures, and replays of
the episodes worth a look."""

import re
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path

from sumo_mcts.records import TraceError, load_trace
from sumo_mcts.records.statistics import (
    LEAST,
    TWIN,
    Contrast,
    Estimate,
    Rate,
    Row,
    arrived,
    at_fault,
    collided,
    contrast,
    pairs,
    rate,
    some,
    time_ratio,
)
from sumo_mcts.reporting.plots import (
    Measure,
    colours,
    planner_style,
    spread_figure,
    sweep_figure,
    sweeps,
    twin_figure,
)
from sumo_mcts.reporting.replay import packed
from sumo_mcts.reporting.results import Results, planner_rank
from sumo_mcts.reporting.tables import (
    EACH,
    NOT_WORSE,
    Cell,
    Column,
    Look,
    Table,
    labelled,
    number,
    signed,
    spread,
    text,
)

_MEASURES = (
    (
        Measure("min_ttc_s", "Closest calls: time to collision", "s", logarithmic=True),
        "The smallest of each episode; none where nobody was about to collide.",
    ),
    (
        Measure("rms_jerk_mps3", "Jerk", "m/s³"),
        "Root mean square of each episode, smoothed over half a second: how evenly the ego drives.",
    ),
    (
        Measure("plan_ms_p50", "Decision time, typical", "ms", logarithmic=True),
        "The median of each episode's decisions, from scene to decision.",
    ),
    (
        Measure("plan_ms_p99", "Decision time, slowest", "ms", logarithmic=True),
        "What one in a hundred of an episode's decisions exceeded.",
    ),
)
_WORSE = f"More than {NOT_WORSE:g} in a hundred more than SUMO&#39;s driver"
_QUANTILES = "Thin: nine tenths of the episodes; thick: half of them; dot and number: the median."
_FOOTER = (
    "Written by {}. Rates with the 95 % Wilson interval; medians and paired differences with a 95 "
    "% bootstrap interval over episodes. "
    f"None stands where fewer than {LEAST} are known or all are the same: there the number of "
    "pairs says what a result is worth."
)
_BARS = {"arrived": "", "collisions": " bad"}  # rates that are drawn, and how


def page(
    results: Results,
    found: Sequence[Table],
    looks: Sequence[Look],
    of: int,
    replayed: Mapping[str, str],
    command: str,
) -> str:
    """The whole page.

    `of`: how many episodes there were to choose `looks` from; `replayed`: packed replays by key;
    `command`: what wrote it.
    """
    rows, colour = results.rows, colours(results.rows)
    scenarios = {
        scenario: [row for row in rows if row["scenario"] == scenario]
        for scenario in dict.fromkeys(row["scenario"] for row in rows)
    }
    parts = {
        "title": escape(results.name),
        "style": _asset("page.css") + planner_style(),
        "script": _asset("page.js"),
        "description": escape(results.description),
        "meta": escape(_meta(results)),
        "focus": _select("focus", _variants(rows), _foremost(rows)),
        "over": escape(_over(rows)),
        "tiles": "".join(
            _tiles(variant, [row for row in rows if row["variant"] == variant], rows)
            for variant in _variants(rows)
        ),
        "summary": _table(found[0], rows, colour),
        "scenes": _select("scene", {scenario: scenario for scenario in scenarios}, told="Scenario"),
        "legend": _legend(rows, colour),
        "figures": "".join(
            _figures(scenario, those, colour) for scenario, those in scenarios.items()
        ),
        "looks_about": escape(_about(looks, of)),
        "looks": _looks(looks, replayed, colour),
        "tables": "".join(_table(table, rows, colour) for table in found[1:] if table.rows),
        "notes_link": '<a href="#notes">Notes</a>' if results.notes else "",
        "notes": _notes(results.notes),
        "footer": escape(_FOOTER.format(command)),
        "replays": "\n".join(_replay(key, text) for key, text in replayed.items()),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match.group(1)], _asset("page.html"))


def replays(
    looks: Sequence[Look], traces: Mapping[str, Path], note: Callable[[str], None]
) -> tuple[dict[str, str], list[str]]:
    """The packed replays of those episodes that have a trace, by key, and what is wrong with the
    others' traces."""
    found, problems = {}, []
    for i, look in enumerate(looks):
        path = traces.get(look.row["key"])
        note(f"packing replays  {i + 1} of {len(looks)}")
        try:
            if path is not None:
                found[look.row["key"]] = packed(load_trace(path))
        except (TraceError, OSError) as error:
            problems.append(f"no replay of {look.row['key']}: {error}")
        # whatever a trace may hold that no rule forbids: it costs its own replay, not the report
        except Exception as error:
            problems.append(
                f"no replay of {look.row['key']}: {path}: {type(error).__name__}: "
                f"{' '.join(str(error).split())}"
            )
    return found, problems


def _replay(key: str, text: str) -> str:
    return f'<script type="text/plain" class="replay" data-key="{escape(key)}">{text}</script>'


def _asset(name: str) -> str:
    return (
        resources.files("sumo_mcts.reporting")
        .joinpath("template", name)
        .read_text(encoding="utf-8")
    )


# --- what it is about ---


def _variants(rows: Iterable[Row]) -> dict[str, str]:
    """The variants and how they are labelled."""
    return {row["variant"]: labelled(row) for row in rows}


def _foremost(rows: Sequence[Row]) -> str:
    """The variant that is shown first: of the planner that is shown first, the one with the largest
    budget."""
    return str(
        min(
            rows,
            key=lambda row: (planner_rank(row["planner"]), -(row["iterations_per_decision"] or 0)),
        )["variant"]
    )


def _meta(results: Results) -> str:
    rows = results.rows
    counts = [
        _counted(len(rows), "episode"),
        *(_counted(len({row[key] for row in rows}), key) for key in ("scenario", "variant")),
    ]
    named = {"sumo_mcts": "sumo_mcts", "sumo": "SUMO", "python": "Python"}
    return " · ".join(
        [
            *counts,
            *(
                f"{name} {results.versions[key]}"
                for key, name in named.items()
                if key in results.versions
            ),
        ]
    )


def _over(rows: Sequence[Row]) -> str:
    count = len({row["scenario"] for row in rows})
    return "" if count == 1 else f"over all {count} scenarios together; the table keeps them apart"


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}{'' if count == 1 else 's'}".replace(",", "\u2009")


def _select(name: str, options: Mapping[str, str], chosen: str = "", told: str = "") -> str:
    """A choice among values, each with its label;

    `told`: what it is, where no label beside it says so.
    """
    entries = (
        f'<option value="{escape(value)}"{" selected" if value == chosen else ""}>'
        f"{escape(label)}</option>"
        for value, label in options.items()
    )
    label = f' aria-label="{told}"' if told else ""
    return f'<select id="{name}"{label}>{"".join(entries)}</select>'


# --- the summary ---


def _tiles(variant: str, those: Sequence[Row], rows: Sequence[Row]) -> str:
    """The five numbers of a variant that one asks for first."""
    both = (
        pairs(those, (row for row in rows if row["planner"] == TWIN))
        if those[0]["planner"] != TWIN
        else []
    )
    ended, crashed, faults = (
        rate(map(arrived, those)),
        rate(map(collided, those)),
        rate(map(at_fault, those)).k,
    )
    tiles = [
        _tile(
            "Arrived",
            f"{ended.k}<small>of {ended.n}</small>",
            _bare(ended),
            _bar(ended, _BARS["arrived"]),
        ),
        _tile(
            "Collisions",
            f"{crashed.k}<small>of {crashed.n}</small>",
            f"{_bare(crashed)}, {faults} at fault",
            _bar(crashed, _BARS["collisions"]),
        ),
    ]
    ratio, imposed = time_ratio(both), contrast(both, some("imposed_brakes_3"))
    if ratio is not None:
        tiles.append(
            _tile(
                "Travel time",
                f"{number(ratio.value)}<small>× SUMO's driver</small>",
                f"{_bare(ratio)}, median of {_counted(ratio.n, 'pair')}",
            )
        )
    if imposed is not None:
        sub = (
            f"beyond 3 m/s²; SUMO's driver {imposed.other}: {signed(imposed.per_hundred)} per "
            f"hundred{spread(imposed)}"
        )
        tiles.append(_tile("Imposed braking", f"{imposed.k}<small>of {imposed.n}</small>", sub))
    cycles, late = (sum(row[key] or 0 for row in those) for key in ("cycles", "deadline_misses"))
    times = [row["plan_ms_p50"] for row in those if row["plan_ms_p50"] is not None]
    if cycles and times and those[0]["planner"] != TWIN:
        sub = f"median; {late:g} of {_counted(int(cycles), 'decision')} late"
        tiles.append(
            _tile("Decision time", f"{number(statistics.median(times), 1)}<small>ms</small>", sub)
        )
    return f'<div class="tiles" data-variant="{escape(variant)}" hidden>{"".join(tiles)}</div>'


def _bare(cell: Rate | Estimate) -> str:
    """The interval without its brackets."""
    return spread(cell).strip(" ()")


def _tile(label: str, big: str, sub: str, bar: str = "") -> str:
    return (
        f'<div class="tile"><h3>{escape(label)}</h3><div '
        f'class="big">{big}</div>{bar}<p>{escape(sub)}</p></div>'
    )


# --- tables ---


def _table(table: Table, rows: Sequence[Row], colour: Mapping[str, str]) -> str:
    """A table whose columns sort it; where two variants are compared, one can be picked out."""
    variants = {labelled(row): str(row["variant"]) for row in rows}
    swatches = {label: _swatch(colour[variant]) for label, variant in variants.items()}
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
            f"{_select('with', {'': 'any variant', **involved}, _foremost(rows))}</div>"
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
    label = f"{column.label}, {column.unit}" if column.unit else column.label
    kind = (
        "n" if any(row[i] is not None and not isinstance(row[i], str) for row in table.rows) else ""
    )
    return (
        '<th scope="col" '
        f'class="{kind}{" share" if isinstance(table.rows[0][i], Rate) else ""}"><button '
        f'type="button"{hint}>{escape(label)}</button></th>'
    )


def _cell(cell: Cell, column: Column, table: str, swatches: Mapping[str, str]) -> str:
    if isinstance(cell, str):
        swatch = swatches[cell] if column.key in ("variant", "against") else ""
        return f"<td>{swatch}{escape(cell)}</td>"
    if cell is None:
        return _number("", "-")
    if isinstance(cell, Rate):
        value = f"{cell.k / cell.n:.6f}" if cell.n else ""
        return _number(
            value,
            f"{cell.k}/{cell.n}",
            _bare(cell),
            _bar(cell, _BARS[column.key]) if column.key in _BARS else "",
        )
    if isinstance(cell, Contrast):
        worse = table == "twin" and cell.per_hundred > NOT_WORSE and cell.n >= LEAST
        mark = (
            f'<span class="worse" role="img" aria-label="worse" data-tip="{_WORSE}">▲ </span>'
            if worse
            else ""
        )
        return _number(
            f"{cell.per_hundred:.4f}",
            f"{mark}{cell.k} : {cell.other}",
            f"{signed(cell.per_hundred)}{spread(cell)}",
        )
    if isinstance(cell, Estimate):
        return _number(_sortable(cell.value), number(cell.value, column.digits), _bare(cell))
    return _number(_sortable(cell), text(cell, column))


def _number(value: str, shown: str, interval: str = "", bar: str = "") -> str:
    """A cell that sorts by `value`; unknown is ""."""
    drawn = f'<span class="kn">{shown}</span>{bar}' if interval else shown
    told = f' <span class="iv">{interval}</span>' if interval else ""
    return f'<td class="n{" share" if interval else ""}" data-v="{value}">{drawn}{told}</td>'


def _sortable(value: float) -> str:
    return str(value).replace("inf", "Infinity")


def _bar(cell: Rate, kind: str) -> str:
    """The share and its interval, drawn."""
    if cell.interval is None:
        return ""
    low, high = (f"{100 * share:.1f}%" for share in cell.interval)
    return (
        f'<i class="bar{kind}" '
        f'style="--low:{low};--high:{high};--at:{100 * cell.k / cell.n:.1f}%"></i>'
    )


# --- figures ---


def _legend(rows: Sequence[Row], colour: Mapping[str, str]) -> str:
    named = (
        f"<span>{_swatch(colour[variant])}{escape(label)}</span>"
        for variant, label in _variants(rows).items()
    )
    return f'<p class="legend">{"".join(named)}</p>'


def _swatch(colour: str) -> str:
    return f'<span class="swatch {colour}"></span>'


def _figures(scenario: str, rows: Sequence[Row], colour: Mapping[str, str]) -> str:
    """The figures of a scenario."""
    parts = []
    for title, swept in sweeps(rows).items():
        about = (
            "Arrived (solid, dots) and collided (dashed, squares), with 95 % intervals: "
            f"{', '.join(family.label for family in swept)}."
        )
        parts.append(_figure("Effort", about, sweep_figure(title, swept, colour)))
    about = "A dot for each pair of the same seed; below the line the ego was faster."
    beside = twin_figure(scenario, rows, [row for row in rows if row["planner"] == TWIN], colour)
    parts.append(_figure("Travel time beside SUMO's driver", about, beside))
    driven = [row for row in rows if row["planner"] != TWIN]
    for measure, about in _MEASURES:
        drawn = spread_figure(
            driven if measure.key.startswith("plan_ms") else rows, measure, colour
        )
        parts.append(_figure(measure.label, f"{about} {_QUANTILES}", drawn))
    return f'<div class="figures" data-scene="{escape(scenario)}" hidden>{"".join(parts)}</div>'


def _figure(title: str, about: str, drawn: str) -> str:
    return (
        f"<figure><h3>{escape(title)}</h3><figcaption>{escape(about)}</figcaption>{drawn}</figure>"
        if drawn
        else ""
    )


# --- episodes ---


def _about(looks: Sequence[Look], of: int) -> str:
    if not looks:
        return "None: SUMO's own driver is left out."
    shown = f"{len(looks)} of {of} episodes" if of > len(looks) else _counted(of, "episode")
    return (
        f"{shown}: collisions, other outcomes than arrived, fail-safe interventions; and of each "
        f"scenario and variant the {EACH} smallest TTC, "
        f"the {EACH} smallest PET and the {EACH} hardest decelerations imposed on others, or else "
        "its first episode. SUMO's own driver is left out."
    )


_LOOK_NUMBERS = (
    ("seed", "Seed", 0),
    ("min_ttc_s", "TTC, s", 2),
    ("min_pet_s", "PET, s", 2),
    ("imposed_max_decel_mps2", "Imposed, m/s²", 1),
)


def _looks(looks: Sequence[Look], replayed: Mapping[str, str], colour: Mapping[str, str]) -> str:
    """The list; egos are named where there are several."""
    if not looks:
        return ""
    several = len({look.row["ego"] for look in looks}) > 1
    named = [
        "Replay",
        "Scenario",
        "Variant",
        *(["Ego"] if several else []),
        "Why",
        *(label for _, label, _ in _LOOK_NUMBERS),
    ]
    numbers = {label for _, label, _ in _LOOK_NUMBERS}
    head = "".join(
        f'<th scope="col"{" class=n" if name in numbers else ""}><button '
        f'type="button">{name}</button></th>'
        for name in named
    )
    body = "".join(_look(look, look.row["key"] in replayed, several, colour) for look in looks)
    return (
        '<div class="scroll"><table class="sortable '
        f'looks"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
    )


def _look(look: Look, replayed: bool, several: bool, colour: Mapping[str, str]) -> str:
    row, reasons = look
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
        f"<td>{opened}</td><td>{escape(row['scenario'])}</td><td>{_swatch(colour[row['variant']])}{escape(labelled(row))}</td>"
    ]
    cells += [f"<td>{escape(row['ego'] or '-')}</td>"] if several else []
    cells += [f"<td{error}>{chips}</td>"]
    known = [(row[key], digits) for key, _, digits in _LOOK_NUMBERS]
    cells += [
        _number("", "-") if value is None else _number(str(value), number(value, digits))
        for value, digits in known
    ]
    return (
        f'<tr data-key="{escape(row["key"])}" '
        f'data-why="{escape("; ".join(reasons))}">{"".join(cells)}</tr>'
    )


def _notes(notes: Sequence[str]) -> str:
    if not notes:
        return ""
    listed = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f'<section id="notes"><div class="notes"><h2>Notes</h2><ul>{listed}</ul></div></section>'
