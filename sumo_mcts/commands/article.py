"""The command article: the article's figures and its table, made anew and set beside it."""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from sumo_mcts.commands import run, run_folder
from sumo_mcts.commands.regret import RegretPlan, regret
from sumo_mcts.config import builtin, yaml_file
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments.batch import run_batch
from sumo_mcts.experiments.progress import Watch, part_of
from sumo_mcts.records import Row, versions, write_whole
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


def check_held(out: Path, seeds: int) -> None:
    """Raise ConfigError where the folder holds a table with another number of episodes."""
    for name in EXPERIMENTS.values():
        path = out / f"{name}.yaml"
        if not path.exists():
            continue
        try:
            held = yaml_file.read(path)
        except yaml_file.YamlError as error:
            raise ConfigError(f"{path}: {error}") from None
        found = held.get("seeds") if isinstance(held, dict) else None
        if found != _seeds(seeds):
            last = re.fullmatch(r"0\.\.(\d{1,9})", str(found))
            holds = f"--seeds {int(last[1]) + 1}" if last else f"another {path.name}"
            raise ConfigError(f"--out {out} holds {holds}; give the same --seeds, or another --out")


def drive_table(
    out: Path, seeds: int, jobs: int | None, command: Sequence[str], watch: Watch
) -> list[Row]:
    """Drive so many episodes of each cell of the table; all rows.

    Raises ConfigError, BatchError, OSError.
    """
    cells = {"scenarios": list(TABLE), "seeds": _seeds(seeds)}
    sweep = {"sweep": {"planner.iterations": sorted({n for each in TABLE.values() for n in each})}}
    rows = []
    for k, name in enumerate(EXPERIMENTS.values(), 1):
        experiment = {**yaml_file.read(builtin.experiment_path(name)), **cells, **sweep}
        path = out / f"{name}.yaml"
        write_whole(path, json.dumps(experiment, indent=2).encode())  # JSON is YAML too
        tell = part_of(watch, f"{name}, {k} of {len(EXPERIMENTS)}")
        rows += run_batch(path, out / name, jobs=jobs, command=command, watch=tell)
    return rows


def _seeds(count: int) -> str:
    """The seeds of so many episodes, as an experiment has them."""
    return f"0..{count - 1}"


def near_optimal(out: Path, states: int, jobs: int | None, note: Note) -> dict[Cell, Count]:
    """How many decisions are near-optimal, in so many states of each scene. Raises ConfigError."""
    found = {}
    for k, (scene, cells) in enumerate(TABLE.items(), 1):
        part = f"asking for decisions in {scene}, {k} of {len(TABLE)}"
        note(part)

        def tell(text: str, part: str = part) -> None:
            """With the part before a count, which stands alone else."""
            note(f"{part}  {text}" if text[:1].isdigit() else text)

        asked = Asked(tuple(EXPERIMENTS), tuple(sorted(cells)), False, REFERENCE)
        plan = RegretPlan(asked, seeds=states, every=EVERY, states=states, jobs=jobs)
        folder = out / "near-optimal" / scene
        result = regret((scene,), (), None, AS_THE_ARTICLE, plan, folder, tell)
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

FIGURES_SAY = f"""\
The figures show planner `mcts` with its defaults and seed {SEED}, among SUMO's drivers. Asked is
the decision nearest to the moment, up to 0.25 s away.
"""
TABLE_SAYS = """\
Planners `mcts` and `paper` (the article's own) drive scripted scenes that are fixed
(`traffic.vary=0`) and whose scripts they know; only the search's seed varies. By default the tree
of `mcts` does not depend on it, so the episodes of a cell are one and the same.

*The article*: its own numbers, in its scenes and its simulator: how often it found a near-optimal
solution, and collided. *Near-optimal*: single decisions whose regret against the optimum of a
reference problem is at most 5 % of the spread between best and worst action, without a loss. *In
time*: episodes in which the ego arrives within the time limit.
"""


def page(shown: Sequence[Shown], found: Measured) -> str:
    """The figures with their claims, and the table, as Markdown."""
    parts = [
        "# The article's figures and table, made anew",
        "",
        f"sumo_mcts {versions()['sumo_mcts']}.",
        FIGURES_SAY,
    ]
    for each in shown:
        parts += [
            f"## {each.figure.caption}",
            "",
            f"![{each.figure.caption}]({each.picture.name})",
            "",
            claims_table(each.claims),
            "",
        ]
    parts += [
        "## Performance with different numbers of iterations",
        "",
        TABLE_SAYS,
        table(found),
        "",
    ]
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
