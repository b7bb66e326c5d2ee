"""The commands batch and report: experiments, and what is read from their folders."""

import sys
from pathlib import Path
from typing import Annotated, Optional

import typer

from sumo_mcts.cli.application import command, fail_with, print_json
from sumo_mcts.cli.options import AllowPlugins, AsJson, Jobs, Quiet
from sumo_mcts.cli.progress import BatchProgress, progress
from sumo_mcts.errors import ConfigError

Experiment = Annotated[
    str,
    typer.Argument(
        help="An experiment file, or a built-in one: `sumo-mcts experiments` lists them."
    ),
]
BatchFolder = Annotated[
    Optional[Path],
    typer.Option(
        help="Folder for rows and traces; what is done there is not done again. --dry-run does "
        "without."
    ),
]
Scheduler = Annotated[
    Optional[str],
    typer.Option(
        metavar="tcp://...", help="Drive on the workers of this dask.distributed scheduler."
    ),
]
Shard = Annotated[
    str,
    typer.Option(metavar="I/N", help="Drive only this part of N; a folder of its own for each."),
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="List what would be driven, and what is done already.")
]
Timeout = Annotated[
    float,
    typer.Option(
        metavar="S", help="An episode that takes longer (wall time) is ended, with outcome error."
    ),
]
Fresh = Annotated[
    bool, typer.Option("--fresh", help="Remove what an earlier batch left in the folder.")
]
Folders = Annotated[
    list[Path],
    typer.Argument(
        metavar="DIR...",
        help="Folders that `run` or `batch` wrote; episodes with the same key count once.",
    ),
]
ReportFolder = Annotated[
    Optional[Path],
    typer.Option(help="Where report.html, report.md and tables/ go. Default: the first folder."),
]

ResultsPage = Annotated[
    Optional[Path],
    typer.Option(
        metavar="PAGE.md",
        help="Instead of a report, make the tables between the marks of this Markdown page anew; "
        "without the page a new one with all tables.",
    ),
]


@command()
def batch(
    experiment: Experiment,
    out: BatchFolder = None,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    shard: Shard = "1/1",
    dry_run: DryRun = False,
    episode_timeout: Timeout = 3600.0,
    fresh: Fresh = False,
    allow_plugins: AllowPlugins = False,
    quiet: Quiet = False,
) -> None:
    """Drive an experiment: scenarios x variants x seeds. Goes on where it was interrupted."""
    from sumo_mcts.commands import batch as command
    from sumo_mcts.commands import folders
    from sumo_mcts.experiments.batch import run_batch

    part = command.shard_of(shard)
    if dry_run:
        typer.echo(command.listing(experiment, out, part, fresh=fresh, allow_plugins=allow_plugins))
        return
    if out is None:
        raise ConfigError("batch: --out: a folder for rows and traces has to be given")
    folders.check_folder(out)
    with BatchProgress(quiet=quiet) as shown:
        rows = run_batch(
            experiment, out, jobs=jobs, scheduler=scheduler, shard=part, fresh=fresh,
            allow_plugins=allow_plugins, episode_timeout_s=episode_timeout, command=sys.argv[1:],
            watch=shown.tell,
        )  # fmt: skip
    if not quiet:
        typer.echo(f"{command.summary(rows)}\n{out}: {len(rows)} rows")
    fail_with(command.failures(rows))


@command()
def report(
    folders: Folders,
    out: ReportFolder = None,
    results: ResultsPage = None,
    as_json: AsJson = False,
    quiet: Quiet = False,
) -> None:
    """Tables and one page with figures and replays, over the episodes of output folders."""
    from sumo_mcts.commands import report as command
    from sumo_mcts.commands.folders import check_folder

    if out is not None and results is not None:
        raise ConfigError(f"--out {out}: with --results only the page is written; leave one out")
    if out is not None:
        check_folder(out)
    with progress("reading", quiet=quiet or as_json) as note:
        if results is None:
            made = command.report(folders, out or folders[0], sys.argv[1:], note)
        else:
            made = command.write_results(folders, results, note)
    if as_json:
        print_json(made.document)
    elif not quiet:
        typer.echo(made.text)
        typer.echo("\n".join(f"  {path}" for path in made.files))
