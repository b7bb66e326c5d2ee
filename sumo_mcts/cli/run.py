"""The command run."""

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from sumo_mcts.cli.application import command, print_json, tell_errors
from sumo_mcts.cli.options import (
    MOST,
    AllowPlugins,
    AsJson,
    Assignments,
    Ego,
    PlannerName,
    Quiet,
    Scenario,
    Until,
    behind_dashes,
)
from sumo_mcts.cli.progress import progress
from sumo_mcts.errors import printable
from sumo_mcts.process import ending
from sumo_mcts.process.ending import FAILED, OK
from sumo_mcts.process.supervisor import results_are_out
from sumo_mcts.registry import ORACLES, SENSED

if TYPE_CHECKING:
    from sumo_mcts.commands.run_folder import Kept
    from sumo_mcts.episode.run import EpisodeResult

Seed = Annotated[Optional[int], typer.Option(min=0, help="Default 0; a .sumocfg keeps its own.")]
Prediction = Annotated[
    Optional[str],
    typer.Option(help=f"{', '.join(SENSED)}, an oracle ({', '.join(ORACLES)}), or a plugin."),
]
Iterations = Annotated[
    Optional[int], typer.Option(min=1, max=MOST, help="Iteration budget of one decision.")
]
TimeBudget = Annotated[
    Optional[float],
    typer.Option(metavar="MS", help="Time budget of one decision instead; not reproducible."),
]
Deadline = Annotated[
    bool,
    typer.Option("--enforce-deadline", help="Drop decisions that come too late; not reproducible."),
]
TimeLimit = Annotated[
    Optional[float],
    typer.Option(metavar="S", help="Seconds after departure until the episode is a timeout."),
]
Out = Annotated[Optional[Path], typer.Option(help="Folder for rows, traces and pictures.")]
NoPictures = Annotated[
    bool, typer.Option("--no-pictures", help="Draw nothing into --out; `render` can do so later.")
]
Gui = Annotated[bool, typer.Option("--gui", help="Watch in SUMO's window.")]
Connect = Annotated[
    Optional[str],
    typer.Option(
        metavar="HOST:PORT",
        help="Drive in a SUMO that runs already with the files of SCENARIO and --remote-port.",
    ),
]


@command(for_sumo=True)
def run(
    context: typer.Context,
    scenario: Scenario,
    ego: Ego = None,
    ego_until: Until = None,
    seed: Seed = None,
    planner: PlannerName = None,
    prediction: Prediction = None,
    iterations: Iterations = None,
    time_budget: TimeBudget = None,
    enforce_deadline: Deadline = False,
    time_limit: TimeLimit = None,
    assign: Assignments = None,
    out: Out = None,
    no_pictures: NoPictures = False,
    gui: Gui = False,
    connect: Connect = None,
    allow_plugins: AllowPlugins = False,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Drive one episode. Options after -- go to SUMO."""
    from sumo_mcts import scenarios
    from sumo_mcts.commands import folders
    from sumo_mcts.commands import run as command
    from sumo_mcts.world.arguments import is_sumocfg

    chosen = {
        "planner.name": planner, "prediction.name": prediction, "planner.iterations": iterations,
        "planner.time_budget_ms": time_budget, "planner.enforce_deadline": enforce_deadline or None,
        "episode.stop_time_s": time_limit,  # goes before episode.time_limit_s
    }  # fmt: skip
    named = (f"{key}={value}" for key, value in chosen.items() if value is not None)
    options, silent = behind_dashes(context), quiet or as_json
    if connect is not None and (gui or options):
        raise typer.BadParameter("--connect: SUMO runs already, with its own options and window")
    if out is not None:
        folders.check_run_folder(out)
    if not ego and is_sumocfg(scenario):
        _list_candidates(scenario, seed, options, as_json=as_json, silent=silent)
        return
    with ExitStack() as stack:
        with progress("connecting" if connect else "starting SUMO", quiet=silent) as note:
            config = scenarios.resolve(
                scenario, seed, ego or (), ego_until, (*(assign or ()), *named), options,
                allow_plugins=allow_plugins,
            )  # fmt: skip
            result = stack.enter_context(
                command.run(config, scenario, seed, gui, options, note, connect)
            )
        kept = _keep_and_print(result, out, as_json=as_json, quiet=quiet)
        if out is not None and kept is not None:
            _draw_and_print(kept, out, pictures=not no_pictures, silent=silent)
        failures = command.failures(result)
        tell_errors(failures)
        if gui:
            results_are_out(FAILED if failures else OK)
    if failures:
        raise typer.Exit(FAILED)


def _keep_and_print(
    result: "EpisodeResult", out: Path | None, *, as_json: bool, quiet: bool
) -> "Kept | None":
    """Keep a run in a folder, if there is one. The result is printed in any case."""
    from sumo_mcts.commands import run, run_folder, run_summary

    kept = None
    try:
        if out is not None:
            kept = run_folder.keep(result, out, sys.argv[1:])
    finally:
        printed = result if kept is None else kept.result
        if as_json:
            print_json(run.document(printed))
        elif not quiet:
            typer.echo(run_summary.summary(printed))
    for remark in kept.remarks if kept is not None and not quiet else ():
        ending.tell(remark)
    return kept


def _draw_and_print(kept: "Kept", out: Path, *, pictures: bool, silent: bool) -> None:
    """Draw what was kept; the names of all files are printed."""
    from sumo_mcts.commands import run_folder

    with progress("drawing", quiet=silent) as note:
        drawn = run_folder.draw(kept.result, out, note) if pictures else []
    if not silent:
        typer.echo("\n".join(f"  {path}" for path in (*drawn, *kept.files)))


def _list_candidates(
    sumocfg: str, seed: int | None, sumo_options: tuple[str, ...], *, as_json: bool, silent: bool
) -> None:
    """Print the vehicles of a .sumocfg that could be the ego."""
    from sumo_mcts import scenarios

    with progress("looking for vehicles", quiet=silent):
        found = scenarios.list_candidates(sumocfg, seed, sumo_options)
    if as_json:
        print_json([each._asdict() for each in found])
        return
    typer.echo(
        f"Vehicles of {sumocfg} that could be the ego (--ego ID, or --ego any):"
        if found
        else f"{sumocfg}: no vehicle departs"
    )
    for each in found:
        typer.echo(
            f"  {printable(each.id):30s} {each.vclass:12s} departs {each.depart_s:9.1f} s  "
            f"{each.edges:4d} edges {each.length_m:8.0f} m  {each.why_not}"
        )
    if len(found) == scenarios.LISTED:
        typer.echo("  (the first that depart; --ego takes any other id too)")
