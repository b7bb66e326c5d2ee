"""The command article: the article's figures and table, made anew."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from sumo_mcts.cli.application import command, fail_with
from sumo_mcts.cli.options import MOST, Jobs, Quiet
from sumo_mcts.cli.progress import BatchProgress, progress

ArticleFolder = Annotated[
    Path,
    typer.Option("--out", metavar="DIR", help="Folder for article.md, pictures, rows and traces."),
]
EachCell = Annotated[
    int,
    typer.Option(
        min=1,
        max=MOST,
        metavar="N",
        help="Episodes of each cell of the table; the article has 300.",
    ),
]
EachScene = Annotated[
    int,
    typer.Option(
        min=1, max=MOST, metavar="N", help="States of each scene whose decisions are compared."
    ),
]


@command()
def article(
    out: ArticleFolder,
    seeds: EachCell = 300,
    states: EachScene = 100,
    jobs: Jobs = None,
    quiet: Quiet = False,
) -> None:
    """Draw the article's figures and fill its table, each beside what the article says. Goes on
    where it was interrupted."""
    from sumo_mcts.commands import article as made
    from sumo_mcts.commands import batch, folders
    from sumo_mcts.records import write_whole

    folders.check_folder(out)
    made.check_held(out, seeds)
    with progress("starting SUMO", quiet=quiet) as note:
        shown = made.draw_figures(out, sys.argv[1:], note)
    if not quiet:
        for each in shown:
            typer.echo(f"{each.picture}\n{made.claims_table(each.claims)}\n")
    with BatchProgress(quiet=quiet) as at:
        rows = made.drive_table(out, seeds, jobs, sys.argv[1:], at.tell)
    with progress("starting SUMO", quiet=quiet) as note:
        near = made.near_optimal(out, states, jobs, note)
    found = made.measured(rows, near)
    write_whole(out / "article.md", made.page(shown, found).encode())
    if not quiet:
        typer.echo(f"{made.table(found)}\n\n  {out / 'article.md'}")
    fail_with(batch.failures(rows))
