"""The command forecast: the errors of every predictor, over episodes."""

from collections.abc import Sequence
from typing import Any

from sumo_mcts.scenarios import Note, naming_source, resolve_each
from sumo_mcts.studies.forecasts import compare


def forecast(
    scenario: str, egos: Sequence[str], until: str | None, overrides: tuple[str, ...],
    seeds: int | None, sumo_options: Sequence[str], note: Note, *,
    allow_plugins: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """The error of every forecast, over an episode for each ego and seed.

    `egos`: none given means the scenario's own, together. `seeds`: from 0 to this number - 1; None:
    one seed, as in `run`. Raises ConfigError.
    """
    resolved = resolve_each(
        scenario, egos, until, overrides, sumo_options, allow_plugins=allow_plugins
    )
    sumocfg = resolved[0].sumo.sumocfg
    with naming_source(scenario, sumocfg):
        one = None if sumocfg is not None else 0
        return compare(resolved, [one] if seeds is None else list(range(seeds)), sumo_options, note)


def table(document: dict[str, Any]) -> str:
    """The errors for a person, as Markdown: a row for each predictor.

    A cell holds a number for each horizon.
    """
    rows = document["forecasts"]
    names = list(dict.fromkeys(row["prediction"] for row in rows))
    after = ", ".join(f"{horizon:g}" for horizon in dict.fromkeys(row["horizon_s"] for row in rows))
    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in document["outcomes"].items())
    head = (
        f"{document['scenario']}, driven by {document['variant']}: {outcomes}, "
        f"{document['cycles']} cycles; after {after} s:"
    )
    columns = (
        "| scene | forecast | pairs | mean, m | 95 %, m | largest, m | right lane, % | taken "
        "for gone | one forecast (p50), ms |"
    )
    lines = [
        _forecast_line(document["scenario"], [row for row in rows if row["prediction"] == name])
        for name in names
    ]
    return "\n".join([head, "", columns, "|---|---|---|---|---|---|---|---|---|", *lines])


def _forecast_line(scenario: str, rows: Sequence[dict[str, Any]]) -> str:
    def show(key: str, digits: int, factor: float = 1.0) -> str:
        return " ".join(
            "-" if row[key] is None else f"{factor * row[key]:.{digits}f}" for row in rows
        )

    cells = [
        show("pairs", 0),
        show("mean_m", 2),
        show("p95_m", 2),
        show("max_m", 2),
        show("right_lane", 1, 100.0),
        show("gone", 0),
    ]
    cost = "-" if rows[0]["forecast_ms_p50"] is None else f"{rows[0]['forecast_ms_p50']:.1f}"
    return f"| {scenario} | {rows[0]['prediction']} | {' | '.join(cells)} | {cost} |"
