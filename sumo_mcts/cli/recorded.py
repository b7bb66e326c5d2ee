"""The commands render, export and explain: recorded episodes, without SUMO."""

import json
from pathlib import Path
from typing import Annotated, Optional

import typer

from sumo_mcts.cli.application import command
from sumo_mcts.cli.options import AllowPlugins, AsJson, Quiet
from sumo_mcts.cli.progress import progress
from sumo_mcts.errors import printable

Folder = Annotated[
    Path, typer.Argument(metavar="DIR", help="What `run --out` or `batch --out` left.")
]
Episode = Annotated[
    Optional[str],
    typer.Option(metavar="KEY", help="Which one; default: the only one, or a list of them."),
]
Target = Annotated[Optional[Path], typer.Option(metavar="FILE", help="Where to; default: in DIR.")]
PictureFormat = Annotated[
    Optional[str],
    typer.Option("--format", help="png (storyboard; the default), gif, or mp4 (extra `video`)."),
]
Moments = Annotated[
    Optional[str],
    typer.Option(
        metavar="SECONDS,...",
        help="Draw these moments instead, side by side (png), in simulation time.",
    ),
]
Views = Annotated[
    Optional[str],
    typer.Option(
        metavar="VIEW,...",
        help="... each of them from `above`, north up, and from behind the ego (`chase`). Default: "
        "both.",
    ),
]
TableFormat = Annotated[
    Optional[str],
    typer.Option("--format", help="csv (the default), or fcd: SUMO's floating car data."),
]
Time = Annotated[
    Optional[float],
    typer.Option(
        metavar="SECONDS", help="When, in simulation time, as pictures and traces have it."
    ),
]
Replan = Annotated[
    bool,
    typer.Option("--replan", help="Take that decision again from the record, without SUMO."),
]
OtherSettings = Annotated[
    Optional[list[str]],
    typer.Option(
        "--set",
        metavar="a.b=c",
        help="... with another setting (repeatable; implies --replan).",
    ),
]


@command()
def render(
    folder: Folder,
    episode: Episode = None,
    form: PictureFormat = None,
    moments: Moments = None,
    views: Views = None,
    out: Target = None,
    quiet: Quiet = False,
) -> None:
    """Draw a recorded episode from above, or chosen moments of it from above and from behind the
    ego."""
    from sumo_mcts.commands import recorded

    times, seen = recorded.moments_of(moments), recorded.views_of(views, moments)
    form = recorded.format_of(form, out, recorded.PICTURES[:1] if times else recorded.PICTURES)
    _write(folder, episode, form, out, quiet=quiet, times=times, views=seen)


@command()
def export(
    folder: Folder,
    episode: Episode = None,
    form: TableFormat = None,
    out: Target = None,
    quiet: Quiet = False,
) -> None:
    """Write a recorded episode for other programs: every vehicle in every decision period, as the
    planner saw them."""
    from sumo_mcts.commands.recorded import TABLES, format_of

    _write(folder, episode, format_of(form, out, TABLES), out, quiet=quiet)


@command()
def explain(
    folder: Folder,
    at: Time = None,
    episode: Episode = None,
    again: Replan = False,
    assign: OtherSettings = None,
    allow_plugins: AllowPlugins = False,
    as_json: AsJson = False,
) -> None:
    """Explain what the ego did at a moment of a recorded episode."""
    from sumo_mcts.commands import recorded
    from sumo_mcts.records import json_text

    key = recorded.chosen(folder, episode)
    if key is None:
        _list_episodes(folder, as_json=as_json)
        return
    with progress("reading the trace", quiet=as_json) as note:
        found = recorded.explain(
            folder, key, at, again or bool(assign), assign or (), note, allow_plugins=allow_plugins
        )
    typer.echo(json_text(found, indent=None) if as_json else recorded.explanation_text(found))


def _write(
    folder: Path,
    episode: str | None,
    form: str,
    out: Path | None,
    *,
    quiet: bool,
    times: tuple[float, ...] = (),
    views: tuple[str, ...] = (),
) -> None:
    """Write an episode in a format, or moments of it, and print the name of the file."""
    from sumo_mcts.commands import recorded

    key = recorded.chosen(folder, episode)
    if key is None:
        _list_episodes(folder, as_json=False)
        return
    with progress("reading the trace", quiet=quiet) as note:
        if times:
            path = recorded.write_sheet(folder, key, times, views, out, note)
        else:
            path = recorded.write(folder, key, form, out, note)
    if not quiet:
        typer.echo(str(path))


def _list_episodes(folder: Path, *, as_json: bool) -> None:
    from sumo_mcts.commands import recorded

    found = recorded.choices(folder)
    if as_json:
        typer.echo(json.dumps([choice._asdict() for choice in found]))
        return
    typer.echo(f"Recorded episodes of {folder} (--episode KEY):")
    for choice in found:
        typer.echo(f"  {printable(choice.key):60s} {printable(choice.outcome)}".rstrip())
