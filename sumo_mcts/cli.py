"""The front door: commands, no logic.

Heavy imports wait until a command needs them, so that --help is quick.
"""

import datetime
import json
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from sumo_mcts.errors import ConfigError, printable
from sumo_mcts.process import ending
from sumo_mcts.process.ending import FAILED, INVALID, OK
from sumo_mcts.process.supervisor import results_are_out, supervised
from sumo_mcts.registry import ORACLES, PLANNERS, SENSED, searches

if TYPE_CHECKING:
    from sumo_mcts.commands import drive
    from sumo_mcts.episode.run import EpisodeResult
    from sumo_mcts.experiments.progress import Progress

app = typer.Typer(
    add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False,
    help="Monte-Carlo tree search drives an ego vehicle through SUMO traffic.",
)  # fmt: skip

Scenario = Annotated[
    str, typer.Argument(help="A built-in name, a scenario .yaml, or any .sumocfg with --ego.")
]
Until = Annotated[
    Optional[str],
    typer.Option(help="The goal: the end of this edge. Default: the end of the ego's route."),
]
PlannerName = Annotated[
    Optional[str],
    typer.Option(help=f"Who drives: {', '.join(PLANNERS)}, or a plugin."),
]
Assignments = Annotated[
    Optional[list[str]],
    typer.Option("--set", metavar="a.b=c", help="Set any key of the scenario (repeatable)."),
]
AllowPlugins = Annotated[
    bool, typer.Option("--allow-plugins", help="Run code that the scenario names as module:name.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON document and nothing else.")]


@app.command(context_settings={"allow_extra_args": True, "ignore_unknown_options": False})
def run(
    context: typer.Context,
    scenario: Scenario,
    ego: Annotated[
        Optional[list[str]],
        typer.Option(help="Vehicle to drive (repeatable); `any`: the first suitable one."),
    ] = None,
    ego_until: Until = None,
    seed: Annotated[
        Optional[int], typer.Option(min=0, help="Default 0; a .sumocfg keeps its own.")
    ] = None,
    planner: PlannerName = None,
    prediction: Annotated[
        Optional[str],
        typer.Option(help=f"{', '.join(SENSED)}, an oracle ({', '.join(ORACLES)}), or a plugin."),
    ] = None,
    iterations: Annotated[
        Optional[int], typer.Option(min=1, help="Iteration budget of one decision.")
    ] = None,
    time_budget: Annotated[
        Optional[float],
        typer.Option(metavar="MS", help="Time budget of one decision instead; not reproducible."),
    ] = None,
    enforce_deadline: Annotated[
        bool,
        typer.Option(
            "--enforce-deadline", help="Drop decisions that come too late; not reproducible."
        ),
    ] = False,
    time_limit: Annotated[
        Optional[float],
        typer.Option(metavar="S", help="Seconds after departure until the episode is a timeout."),
    ] = None,
    assign: Assignments = None,
    out: Annotated[
        Optional[Path], typer.Option(help="Folder for rows, traces and pictures.")
    ] = None,
    no_pictures: Annotated[
        bool,
        typer.Option("--no-pictures", help="Draw nothing into --out; `render` can do so later."),
    ] = False,
    gui: Annotated[bool, typer.Option("--gui", help="Watch in SUMO's window.")] = False,
    allow_plugins: AllowPlugins = False,
    as_json: AsJson = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Drive one episode. Options after -- go to SUMO."""
    chosen = {"planner.name": planner, "prediction.name": prediction,
    "planner.iterations": iterations, "planner.time_budget_ms": time_budget,
              "planner.enforce_deadline": enforce_deadline or None,
              "episode.time_limit_s": time_limit, "episode.stop_time_s": time_limit}  # fmt: skip
    overrides = (
        *(assign or ()),
        *(f"{key}={value}" for key, value in chosen.items() if value is not None),
    )
    with ending.told(typer.Exit):
        from sumo_mcts import scenarios
        from sumo_mcts.commands import drive, folders
        from sumo_mcts.world.arguments import is_sumocfg

        say = _Voice(quiet=quiet or as_json)
        if out is not None:
            folders.check_run_folder(out)
        if not ego and is_sumocfg(scenario):
            _list_candidates(scenario, seed, _sumo_options(context), as_json, say)
            return
        with ExitStack() as stack:
            with say.progress("starting SUMO") as note:
                config = scenarios.resolve(
                    scenario,
                    seed,
                    tuple(ego or ()),
                    ego_until,
                    overrides,
                    _sumo_options(context),
                    allow_plugins=allow_plugins,
                )
                result = stack.enter_context(
                    drive.run(config, scenario, seed, gui, _sumo_options(context), note)
                )
            kept = _kept_and_told(result, out, as_json, quiet)
            if out is not None and kept is not None:
                with say.progress("drawing") as note:
                    drawn = [] if no_pictures else drive.draw(kept.result, out, note)
                if not (quiet or as_json):
                    typer.echo("\n".join(f"  {path}" for path in (*drawn, *kept.files)))
            failures = drive.failures(result)
            for failure in failures:
                ending.tell(f"error: {failure}")
            if gui:
                results_are_out(FAILED if failures else OK)
    if failures:
        raise typer.Exit(FAILED)


def _kept_and_told(
    result: "EpisodeResult", out: Path | None, as_json: bool, quiet: bool
) -> "drive.Kept | None":
    """What was kept of a run in a folder, if there is one; the result is told in any case."""
    from sumo_mcts.commands import drive, reports

    kept = None
    try:
        if out is not None:
            kept = drive.keep(result, out, sys.argv[1:])
    finally:
        told = result if kept is None else kept.result
        if as_json:
            typer.echo(json.dumps(reports.document(told), allow_nan=False))
        elif not quiet:
            typer.echo(reports.summary(told))
    for remark in kept.remarks if kept is not None and not quiet else ():
        ending.tell(remark)
    return kept


@app.command(context_settings={"allow_extra_args": True, "ignore_unknown_options": False})
def forecast(
    context: typer.Context,
    scenario: Scenario,
    ego: Annotated[
        Optional[list[str]],
        typer.Option(
            help="Vehicle to drive (repeatable, one episode each); `any`: the first suitable one."
        ),
    ] = None,
    ego_until: Until = None,
    seeds: Annotated[
        Optional[int],
        typer.Option(
            min=1,
            help="Episodes with seeds 0 to N-1. Default: one, as `run` drives it.",
            metavar="N",
        ),
    ] = None,
    planner: PlannerName = None,
    assign: Assignments = None,
    allow_plugins: AllowPlugins = False,
    as_json: AsJson = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Tell nothing of the progress.")] = False,
) -> None:
    """Measure every forecast, oracles too, against what then happened.

    Options after -- go to SUMO.
    """
    overrides = (*(assign or ()), *([f"planner.name={planner}"] if planner is not None else []))
    with ending.told(typer.Exit):
        from sumo_mcts.commands import forecasts

        with _Voice(quiet=quiet or as_json).progress("starting SUMO") as note:
            options = _sumo_options(context)
            result = forecasts.forecasts(
                scenario,
                tuple(ego or ()),
                ego_until,
                overrides,
                seeds,
                options,
                note,
                allow_plugins=allow_plugins,
            )
    typer.echo(json.dumps(result, allow_nan=False) if as_json else forecasts.forecast_table(result))
    for problem in result["problems"]:
        ending.tell(f"error: {problem}")
    if result["problems"]:
        raise typer.Exit(FAILED)


@app.command()
def regret(
    scenarios: Annotated[
        Optional[list[str]],
        typer.Argument(help="As for `run`; default: the built-in scenes, reactive and scripted."),
    ] = None,
    ego: Annotated[
        Optional[list[str]],
        typer.Option(
            help="Vehicle to drive (repeatable, one episode each); `any`: the first suitable one."
        ),
    ] = None,
    ego_until: Until = None,
    planners: Annotated[str, typer.Option(metavar="NAME,...", help="Who is asked.")] = ",".join(
        filter(searches, PLANNERS)
    ),
    iterations: Annotated[
        str, typer.Option(metavar="N,...", help="With so many iterations each, where they search.")
    ] = "50,100,300,1000,2000,3000",
    states: Annotated[
        int, typer.Option(min=1, metavar="N", help="At most, over all scenarios.")
    ] = 300,
    seeds: Annotated[
        int, typer.Option(min=1, metavar="N", help="Episodes a scenario, at most: seeds 0 to N-1.")
    ] = 10,
    every: Annotated[
        int, typer.Option(min=1, metavar="N", help="Decision periods from one state to the next.")
    ] = 5,
    converged: Annotated[
        bool,
        typer.Option(
            "--converged", help="Measure the reference itself, against 100 times its effort."
        ),
    ] = False,
    jobs: Annotated[
        Optional[int], typer.Option(min=1, metavar="N", help="Processes. Default: one a core.")
    ] = None,
    assign: Assignments = None,
    out: Annotated[
        Optional[Path],
        typer.Option(help="Folder for regret.jsonl and regret.csv, a row for each judgement."),
    ] = None,
    allow_plugins: AllowPlugins = False,
    as_json: AsJson = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Tell nothing of the progress.")] = False,
) -> None:
    """Measure how near planners come to the optimum of a reference problem, in states from episodes
    driven by planner mcts."""
    with ending.told(typer.Exit):
        from sumo_mcts.commands import folders
        from sumo_mcts.commands import regret as command
        from sumo_mcts.studies.regret import Asked

        if out is not None:
            folders.check_folder(out)
        asked = Asked(tuple(planners.split(",")), command.counts(iterations), converged)
        plan = command.RegretPlan(asked, seeds, every, states, jobs)
        with _Voice(quiet=quiet or as_json).progress("starting SUMO") as note:
            egos = tuple(ego or ())
            result = command.regret(
                tuple(scenarios or ()),
                egos,
                ego_until,
                tuple(assign or ()),
                plan,
                out,
                note,
                allow_plugins=allow_plugins,
            )
    typer.echo(json.dumps(result, allow_nan=False) if as_json else command.regret_table(result))
    for problem in result["problems"]:
        ending.tell(f"error: {problem}")
    if result["problems"]:
        raise typer.Exit(FAILED)


# --- recorded episodes ---

Folder = Annotated[
    Path, typer.Argument(metavar="DIR", help="What `run --out` or `batch --out` left.")
]
Episode = Annotated[
    Optional[str],
    typer.Option(metavar="KEY", help="Which one; default: the only one, or a list of them."),
]
Target = Annotated[Optional[Path], typer.Option(metavar="FILE", help="Where to; default: in DIR.")]
Silent = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]


@app.command()
def render(
    folder: Folder,
    episode: Episode = None,
    form: Annotated[
        Optional[str],
        typer.Option(
            "--format", help="png (storyboard; the default), gif, or mp4 (extra `video`)."
        ),
    ] = None,
    out: Target = None,
    quiet: Silent = False,
) -> None:
    """Draw a recorded episode from above."""
    with ending.told(typer.Exit):
        from sumo_mcts.commands import recorded

        _write_recorded(
            folder, episode, recorded.format_of(form, out, recorded.PICTURES), out, quiet
        )


@app.command()
def export(
    folder: Folder,
    episode: Episode = None,
    form: Annotated[
        Optional[str],
        typer.Option("--format", help="csv (the default), or fcd: SUMO's floating car data."),
    ] = None,
    out: Target = None,
    quiet: Silent = False,
) -> None:
    """Write a recorded episode for other programs: every vehicle in every decision period, as the
    planner saw them."""
    with ending.told(typer.Exit):
        from sumo_mcts.commands import recorded

        _write_recorded(folder, episode, recorded.format_of(form, out, recorded.TABLES), out, quiet)


@app.command()
def explain(
    folder: Folder,
    at: Annotated[
        Optional[float],
        typer.Option(
            metavar="SECONDS", help="When, in simulation time, as pictures and traces have it."
        ),
    ] = None,
    episode: Episode = None,
    again: Annotated[
        bool,
        typer.Option("--replan", help="Take that decision again from the record, without SUMO."),
    ] = False,
    assign: Annotated[
        Optional[list[str]],
        typer.Option(
            "--set",
            metavar="a.b=c",
            help="... with another setting (repeatable; implies --replan).",
        ),
    ] = None,
    allow_plugins: AllowPlugins = False,
    as_json: AsJson = False,
) -> None:
    """Tell why the ego did what it did at a moment of a recorded episode."""
    with ending.told(typer.Exit):
        from sumo_mcts.commands import recorded
        from sumo_mcts.records import json_text

        key = recorded.chosen(folder, episode)
        if key is None:
            _list_recorded(folder, as_json)
            return
        with _Voice(quiet=as_json).progress("reading the trace") as note:
            told = recorded.explain(
                folder,
                key,
                at,
                again or bool(assign),
                tuple(assign or ()),
                note,
                allow_plugins=allow_plugins,
            )
        typer.echo(json_text(told, indent=None) if as_json else recorded.explanation_text(told))


def _write_recorded(
    folder: Path, episode: str | None, form: str, out: Path | None, quiet: bool
) -> None:
    from sumo_mcts.commands import recorded

    key = recorded.chosen(folder, episode)
    if key is None:
        _list_recorded(folder, False)
        return
    with _Voice(quiet=quiet).progress("reading the trace") as note:
        path = recorded.write(folder, key, form, out, note)
    if not quiet:
        typer.echo(str(path))


def _list_recorded(folder: Path, as_json: bool) -> None:
    from sumo_mcts.commands import recorded

    found = recorded.choices(folder)
    if as_json:
        typer.echo(json.dumps([choice._asdict() for choice in found]))
        return
    typer.echo(f"Recorded episodes of {folder} (--episode KEY):")
    typer.echo(
        "\n".join(
            f"  {printable(choice.key):60s} {printable(choice.outcome)}".rstrip()
            for choice in found
        )
    )


# ---


@app.command()
def batch(
    experiment: Annotated[
        str,
        typer.Argument(
            help="An experiment file, or a built-in one: `sumo-mcts experiments` lists them."
        ),
    ],
    out: Annotated[
        Optional[Path],
        typer.Option(
            help="Folder for rows and traces; what is done there is not done again. --dry-run does "
            "without."
        ),
    ] = None,
    jobs: Annotated[
        Optional[int], typer.Option(min=1, metavar="N", help="Processes. Default: one a core.")
    ] = None,
    scheduler: Annotated[
        Optional[str],
        typer.Option(
            metavar="tcp://...", help="Drive on the workers of this dask.distributed scheduler."
        ),
    ] = None,
    shard: Annotated[
        str,
        typer.Option(
            metavar="I/N", help="Drive only this part of N; a folder of its own for each."
        ),
    ] = "1/1",
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="List what would be driven, and what is done already.")
    ] = False,
    episode_timeout: Annotated[
        float,
        typer.Option(
            metavar="S",
            help="An episode that takes longer (wall time) is ended, with outcome error.",
        ),
    ] = 3600.0,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Remove what an earlier batch left in the folder.")
    ] = False,
    allow_plugins: AllowPlugins = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Drive an experiment: scenarios x variants x seeds. Goes on where it was interrupted."""
    with ending.told(typer.Exit):
        from sumo_mcts.commands import batches, folders

        if dry_run:
            typer.echo(batches.batch_listing(experiment, out, shard, fresh, allow_plugins))
            return
        if out is None:
            raise ConfigError("batch: --out: a folder for rows and traces has to be given")
        folders.check_folder(out)
        with _BatchVoice(quiet) as voice:
            rows = batches.batch(
                experiment,
                out,
                jobs,
                scheduler,
                shard,
                fresh,
                allow_plugins,
                episode_timeout,
                sys.argv[1:],
                voice.tell,
            )
    failed = [row for row in rows if row["outcome"] == "error"]
    if not quiet:
        typer.echo(f"{batches.batch_summary(rows)}\n{out}: {len(rows)} rows")
    if failed:
        ending.tell(
            f"error: {len(failed)} of {len(rows)} rows have outcome error, the first: "
            f"{failed[0]['key']}: {failed[0]['error']}"
        )
        raise typer.Exit(FAILED)


class _BatchVoice:
    """Tells on standard error how far a batch is: a bar on a terminal, elsewhere a line every ten
    seconds."""

    EVERY_S = 10.0

    def __init__(self, quiet: bool) -> None:
        self._quiet, self._said, self._text = quiet, -math.inf, ""
        self._bar: Any = None

    def __enter__(self) -> "_BatchVoice":
        if sys.stderr.isatty() and not self._quiet:
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

            columns = (
                BarColumn(),
                MofNCompleteColumn(),
                TextColumn("{task.description}", markup=False),
            )
            self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
            self._bar.start()
            self._task = self._bar.add_task("", total=None)
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def tell(self, at: "Progress") -> None:
        """Say what has changed."""
        if self._bar is not None:
            self._bar.update(
                self._task,
                completed=at.done,
                total=at.total or None,
                description=at.doing or _how_far(at),
            )
            return
        now, text = (
            time.monotonic(),
            f"{at.doing.split('  ')[0]} ..."
            if at.doing
            else f"{at.done}/{at.total} episodes, {_how_far(at)}",
        )
        if (
            not self._quiet
            and text != self._text
            and (at.doing or at.done == at.total or now - self._said >= self.EVERY_S)
        ):
            self._said, self._text = now, text
            typer.echo(text, err=True)


def _how_far(at: "Progress") -> str:
    pace = (
        ""
        if at.rate_per_s is None or at.left_s is None
        else f", {at.rate_per_s:.2g}/s, {datetime.timedelta(seconds=round(at.left_s))} left"
    )
    return f"{at.collisions} collisions" + (f", {at.errors} errors" if at.errors else "") + pace


AsList = Annotated[bool, typer.Option("--json", help="A list of {name, description}.")]


@app.command()
def scenarios(as_json: AsList = False) -> None:
    """The built-in scenarios."""
    with ending.told(typer.Exit):
        from sumo_mcts.scenarios import listed_scenarios

        _tell_built_in(listed_scenarios(), as_json)


@app.command()
def experiments(as_json: AsList = False) -> None:
    """The built-in experiments, for `batch`."""
    with ending.told(typer.Exit):
        from sumo_mcts.scenarios import listed_experiments

        _tell_built_in(listed_experiments(), as_json)


def _tell_built_in(found: list[dict[str, str]], as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps(found))
        return
    for item in found:
        typer.echo(f"{item['name']:32s} {item['description']}")


@app.command()
def report(
    folders: Annotated[
        list[Path],
        typer.Argument(
            metavar="DIR...",
            help="Folders that `run` or `batch` wrote; episodes with the same key count once.",
        ),
    ],
    out: Annotated[
        Optional[Path],
        typer.Option(
            help="Where report.html, report.md and tables/ go. Default: the first folder."
        ),
    ] = None,
    as_json: AsJson = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")] = False,
) -> None:
    """Tables and one page with figures and replays, over the episodes of output folders."""
    with ending.told(typer.Exit):
        from sumo_mcts.commands import reports
        from sumo_mcts.commands.folders import check_folder

        if out is not None:
            check_folder(out)
        with _Voice(quiet=quiet or as_json).progress("reading") as note:
            made = reports.report(folders, out or folders[0], sys.argv[1:], note)
    if as_json:
        typer.echo(json.dumps(made.document, allow_nan=False))
    elif not quiet:
        typer.echo(made.text)
        typer.echo("\n".join(f"  {path}" for path in made.files))


@app.command()
def validate(
    files: Annotated[
        list[Path], typer.Argument(help="Scenario files, experiment files, .sumocfg files.")
    ],
    allow_plugins: AllowPlugins = False,
) -> None:
    """Check all that `run` and `batch` check before anybody decides, and tell every mistake."""
    from sumo_mcts.commands import checks

    bad = False
    for path in files:
        problems = checks.problems_of(path, allow_plugins=allow_plugins)
        typer.echo(
            "\n".join(f"error: {problem}" for problem in problems) or f"{path}: ok",
            err=bool(problems),
        )
        bad = bad or bool(problems)
    if bad:
        raise typer.Exit(INVALID)


@app.command()
def schema() -> None:
    """The JSON schema of a scenario file."""
    from sumo_mcts.config import json_schema

    typer.echo(json.dumps(json_schema(), indent=2))


@app.command()
def bench(
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document.")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="A tenth of the repetitions.")] = False,
) -> None:
    """Measure the budgets of docs/measures.md on this machine."""
    with ending.told(typer.Exit):
        from sumo_mcts.studies import bench

        with _Voice(quiet=as_json).progress("measuring") as note:
            rows = bench.run(0.1 if quick else 1.0, note)
    if as_json:
        typer.echo(json.dumps(rows))
        return
    typer.echo("\n".join(_bench_line(**row) for row in rows))


def _bench_line(
    quantity: str, value: float, unit: str, budget: float | None, ok: bool | None
) -> str:
    limit = (
        ""
        if budget is None
        else f"budget {budget:9,.0f}"
        if budget >= 100
        else f"budget {budget:9g}"
    )
    return (
        f"{quantity:86s} {value:12,.{0 if value >= 1000 else 2}f} {unit:4s} {limit:16s} "
        f"{'' if ok is None else 'ok' if ok else 'MISSED'}"
    ).rstrip()


def main() -> None:
    """Run the command line in this process."""
    sys.exit(status())


def status() -> int:
    """Run the command line in this process; its exit status."""
    return ending.ended(_command_line)


def _command_line() -> object:
    """Run the command line; typer's own errors become one line."""
    try:
        return app(standalone_mode=False)
    except Exception as error:
        message = getattr(
            error, "format_message", None
        )  # typer's exceptions are click's, or its own, by version
        if message is None:
            raise
        context = getattr(error, "ctx", None)
        command = context.command_path if context else "sumo-mcts"
        if not sys.argv[1:]:
            typer.echo(message(), err=True)  # the help
            return INVALID
        raise ConfigError(
            f"{' '.join(message().split()).rstrip('.')}; see {command} --help"
        ) from None


def _sumo_options(context: typer.Context) -> tuple[str, ...]:
    """What SUMO is to be told.

    Raises BadParameter where it begins with a word that is no option, which was meant for somebody
    else.
    """
    if context.args and not context.args[0].startswith("-"):
        raise typer.BadParameter(f"{context.args[0]}: unexpected; options for SUMO follow --")
    return tuple(context.args)


def _list_candidates(
    scenario: str, seed: int | None, sumo_options: tuple[str, ...], as_json: bool, say: "_Voice"
) -> None:
    from sumo_mcts import scenarios

    with say.progress("looking for vehicles"):
        found = scenarios.list_candidates(scenario, seed, sumo_options)
    if as_json:
        typer.echo(json.dumps([c._asdict() for c in found]))
        return
    typer.echo(
        f"Vehicles of {scenario} that could be the ego (--ego ID, or --ego any):"
        if found
        else f"{scenario}: no vehicle departs"
    )
    for c in found:
        typer.echo(
            f"  {printable(c.id):30s} {c.vclass:12s} departs {c.depart_s:9.1f} s  {c.edges:4d} "
            f"edges {c.length_m:8.0f} m  {c.why_not}"
        )
    if len(found) == scenarios.LISTED:
        typer.echo("  (the first that depart; --ego takes any other id too)")


class _Voice:
    """Tells on standard error what takes long."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet

    @contextmanager
    def progress(self, what: str) -> Iterator[Callable[[str], None]]:
        """A line that changes on a terminal; elsewhere, of what follows, the first words only."""
        if self._quiet:
            yield _nothing
        elif sys.stderr.isatty():
            from rich.console import Console
            from rich.text import Text

            with Console(stderr=True).status(what) as status:
                yield lambda text: status.update(Text(printable(text)))  # ids may look like markup
        else:
            said: set[str] = set()

            def tell(text: Any) -> None:
                words = str(text).split("  ")[0]
                if not words[:1].isdigit() and words not in said:
                    said.add(words)
                    typer.echo(f"{words} ...", err=True)

            yield tell


def _nothing(text: str) -> None:
    """Say nothing."""


if __name__ == "__main__":
    sys.exit(supervised(status))
