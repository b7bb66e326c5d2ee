"""The command article: the article's figures and its table, made anew and set beside it."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from sumo_mcts.commands import run, run_folder
from sumo_mcts.commands.regret import RegretPlan, regret
from sumo_mcts.config import builtin, yaml_file
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments.batch import run_batch
from sumo_mcts.experiments.progress import Watch
from sumo_mcts.records import Row, write_whole
from sumo_mcts.records.statistics import collided
from sumo_mcts.scenarios import Note, load_scenario
from sumo_mcts.studies.article import FIGURES, TABLE, Claim, Figure
from sumo_mcts.studies.regret import Asked

SEED = 0  # of the episodes in the figures
EXPERIMENTS = {"mcts": "table1-mcts", "paper": "table1"}  # of the table, by planner
AS_THE_ARTICLE = ("prediction.name=script", "traffic.vary=0")  # one fixed scene, known ahead
EVERY = 3  # cycles from one state to the next
REFERENCE = "2"

Count = tuple[int, int]  # so many of so many
Cell = tuple[str, str, int]  # scene, planner, iterations


class Shown(NamedTuple):
    """A figure, drawn."""

    figure: Figure
    picture: Path
    claims: list[Claim]


class Measured(NamedTuple):
    """What the cells of the table are, those of planners that search. In parts: near_optimal of
    states, the others of episodes."""

    near_optimal: Mapping[Cell, Count]
    in_time: Mapping[Cell, Count]
    collisions: Mapping[Cell, Count]


def draw_figures(out: Path, command: Sequence[str], note: Note) -> list[Shown]:
    """Drive and draw the episodes of the figures. Raises ConfigError, OSError."""
    # Quick to load, but only pictures need it.
    from sumo_mcts.reporting.sheet import VIEWS, sheet

    shown = []
    for figure in FIGURES:
        note(f"driving {figure.scenario}")
        with run.run(
            load_scenario(figure.scenario), figure.scenario, SEED, False, (), note
        ) as result:
            kept = run_folder.keep(result, out / "drives", command).result
        if not kept.traces or kept.road is None:
            raise ConfigError(f"article: {figure.scenario}: {kept.rows[0]['error']}")
        trace, picture = kept.traces[0], out / f"{figure.name}.png"
        note(f"drawing {figure.name}")
        last = trace.cycles[-1].time
        sheet(trace, kept.road, [min(time, last) for time in figure.times], VIEWS, picture)
        shown.append(Shown(figure, picture, figure.claims(trace, kept.road, kept.rows[0])))
    return shown


def drive_table(
    out: Path, seeds: int, jobs: int | None, command: Sequence[str], watch: Watch
) -> list[Row]:
    """Drive so many episodes of each cell of the table; all rows.

    Raises ConfigError, BatchError, OSError.
    """
    cells = {"scenarios": list(TABLE), "seeds": f"0..{seeds - 1}"}
    sweep = {"sweep": {"planner.iterations": sorted({n for each in TABLE.values() for n in each})}}
    rows = []
    for name in EXPERIMENTS.values():
        experiment = {**yaml_file.read(builtin.experiment_path(name)), **cells, **sweep}
        path = out / f"{name}.yaml"
        write_whole(path, json.dumps(experiment, indent=2).encode())  # JSON is YAML too
        rows += run_batch(path, out / name, jobs=jobs, command=command, watch=watch)
    return rows


def near_optimal(out: Path, states: int, jobs: int | None, note: Note) -> dict[Cell, Count]:
    """How many decisions are near-optimal, in so many states of each scene. Raises ConfigError."""
    found = {}
    for scene, cells in TABLE.items():
        note(f"asking for decisions in {scene}")
        asked = Asked(tuple(EXPERIMENTS), tuple(sorted(cells)), False, REFERENCE)
        plan = RegretPlan(asked, seeds=states, every=EVERY, states=states, jobs=jobs)
        folder = out / "near-optimal" / scene
        result = regret((scene,), (), None, AS_THE_ARTICLE, plan, folder, note)
        for row in result["planners"]:
            cell = scene, row["planner"], row["iterations"]
            found[cell] = row["all"]["near_optimal"], row["all"]["states"]
    return found


def measured(rows: Sequence[Row], near: Mapping[Cell, Count]) -> Measured:
    """The cells of the table."""

    def counted(happened: Callable[[Row], bool | None]) -> dict[Cell, Count]:
        counts: dict[Cell, Count] = {}
        for row in rows:
            cell = row["scenario"], row["planner"], row["iterations_per_decision"]
            k, n = counts.get(cell, (0, 0))
            counts[cell] = k + bool(happened(row)), n + 1
        return counts

    return Measured(near, counted(lambda row: row["in_time"]), counted(collided))


# --- the page ---


def page(shown: Sequence[Shown], found: Measured) -> str:
    """The figures with their claims, and the table, as Markdown."""
    parts = ["# The article's figures and table, made anew", ""]
    for each in shown:
        parts += [
            f"## {each.figure.caption}",
            "",
            f"![{each.figure.caption}]({each.picture.name})",
            "",
            claims_table(each.claims),
            "",
        ]
    parts += ["## Performance with different numbers of iterations", "", table(found), ""]
    return "\n".join(parts)


def claims_table(claims: Sequence[Claim]) -> str:
    """What the article says of a figure, and what our ego does, as Markdown."""
    lines = ["| at | the article: the ego ... | ours does | measured |", "|---|---|---|---|"]
    for claim in claims:
        at = "the end" if claim.at is None else f"{claim.at:g} s"
        does = "yes" if claim.holds else "no"
        lines.append(f"| {at} | {claim.said} | {does} | {claim.measured} |")
    return "\n".join(lines)


def table(found: Measured) -> str:
    """The article's Table 1 beside ours, as Markdown."""
    each = ("near-optimal", "in time", "collisions")
    heads = [f"{head}, `{planner}`" for planner in EXPERIMENTS for head in each]
    columns = ["scene", "iterations", "near-optimal, article", "collisions, article", *heads]
    lines = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    for scene, cells in TABLE.items():
        for iterations in sorted(cells):
            near, collisions = cells[iterations]
            words = [scene, str(iterations), f"{near:.2f} %", f"{collisions:.2f} %"]
            for planner in EXPERIMENTS:
                cell = scene, planner, iterations
                words += [_share(part.get(cell)) for part in found]
            lines.append(f"| {' | '.join(words)} |")
    return "\n".join(lines)


def _share(count: Count | None) -> str:
    return (
        "-"
        if count is None or not count[1]
        else (f"{100 * count[0] / count[1]:.1f} % ({count[0]}/{count[1]})")
    )
