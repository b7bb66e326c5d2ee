"""Where commands are registered: a function in one of the files beside this one, with `@command()`.

What a command does lies in commands/; its function here reads options, calls that and prints. The
signature of such a function lists the options of its command: typer reads them from there, so it
may be wide. Heavy imports stand inside the functions, so that --help is quick.
"""

import json
from collections.abc import Callable
from typing import Any, TypeVar

import typer

from sumo_mcts import __version__
from sumo_mcts.process import ending

app = typer.Typer(
    add_completion=False, no_args_is_help=True, pretty_exceptions_enable=False,
    help="Monte-Carlo tree search drives an ego vehicle through SUMO traffic.",
)  # fmt: skip
_Function = TypeVar("_Function", bound=Callable[..., None])


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"sumo-mcts {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: bool = typer.Option(
        False, "--version", callback=_print_version, is_eager=True, help="Print the version."
    ),
) -> None:
    """Options of the command line as a whole; each does its work when it is read."""


def command(*, for_sumo: bool = False) -> Callable[[_Function], _Function]:
    """Register a function as a command; an error becomes one line and an exit status.

    `for_sumo`: what stands behind -- is left in its context.
    """
    settings = {"allow_extra_args": True, "ignore_unknown_options": False} if for_sumo else None

    def registered(function: _Function) -> _Function:
        app.command(context_settings=settings)(ending.exiting(typer.Exit)(function))
        return function

    return registered


def print_json(document: Any) -> None:
    """Print one JSON document in one line."""
    typer.echo(json.dumps(document, allow_nan=False))


def tell_errors(lines: list[str]) -> None:
    """Print what went wrong while a command worked."""
    for line in lines:
        ending.tell(f"error: {line}")


def fail_with(lines: list[str]) -> None:
    """Print what went wrong, and end with exit status 1 if anything did."""
    tell_errors(lines)
    if lines:
        raise typer.Exit(ending.FAILED)
