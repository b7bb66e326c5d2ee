"""The command line: a file for each group of commands, registered where it is imported here.

application.py  the decorator `@command()`
run.py, experiments.py, article.py, recorded.py, studies.py, inputs.py  the commands
options.py      arguments and options that several commands have
progress.py     what a command tells while it works
"""

import sys

import typer

from sumo_mcts.cli.application import app
from sumo_mcts.errors import ConfigError
from sumo_mcts.process import ending
from sumo_mcts.process.ending import INVALID

from sumo_mcts.cli import run, experiments, article, recorded, studies, inputs  # isort: skip  # as --help lists them

__all__ = [
    "app",
    "article",
    "experiments",
    "inputs",
    "main",
    "recorded",
    "run",
    "status",
    "studies",
]


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
        # typer's exceptions are click's, or its own, by version
        message = getattr(error, "format_message", None)
        if message is None:
            raise
        if not sys.argv[1:]:
            typer.echo(message(), err=True)  # the help
            return INVALID
        context = getattr(error, "ctx", None)
        command = context.command_path if context else "sumo-mcts"
        words = " ".join(message().split()).rstrip(".")
        raise ConfigError(f"{words}; see {command} --help") from None
