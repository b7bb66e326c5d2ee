"""The commands scenarios, experiments, validate and schema: what can be driven, and what is wrong
with it."""

import json
from collections.abc import Mapping
from itertools import groupby
from pathlib import Path
from typing import Annotated

import typer

from sumo_mcts.cli.application import command, print_json
from sumo_mcts.cli.options import AllowPlugins
from sumo_mcts.process.ending import INVALID

AsList = Annotated[bool, typer.Option("--json", help="A list of {name, description}.")]
AsGroupedList = Annotated[
    bool, typer.Option("--json", help="A list of {name, group, description}.")
]


@command()
def scenarios(as_json: AsGroupedList = False) -> None:
    """The built-in scenarios, in groups."""
    from sumo_mcts.scenarios import GROUPS, listed_scenarios

    _print_built_in(listed_scenarios(), GROUPS, as_json=as_json)


@command()
def experiments(as_json: AsList = False) -> None:
    """The built-in experiments, for `batch`."""
    from sumo_mcts.scenarios import listed_experiments

    _print_built_in(listed_experiments(), {}, as_json=as_json)


@command()
def validate(
    files: Annotated[
        list[Path], typer.Argument(help="Scenario files, experiment files, .sumocfg files.")
    ],
    allow_plugins: AllowPlugins = False,
) -> None:
    """Check all that `run` and `batch` check before a planner decides, and list every mistake."""
    from sumo_mcts.commands.validate import problems_of

    bad = False
    for path in files:
        problems = problems_of(path, allow_plugins=allow_plugins)
        bad = bad or bool(problems)
        lines = "\n".join(f"error: {problem}" for problem in problems) or f"{path}: ok"
        typer.echo(lines, err=bool(problems))
    if bad:
        raise typer.Exit(INVALID)


@command()
def schema() -> None:
    """The JSON schema of a scenario file."""
    from sumo_mcts.config import json_schema

    typer.echo(json.dumps(json_schema(), indent=2))


def _print_built_in(
    found: list[dict[str, str]], headings: Mapping[str, str], *, as_json: bool
) -> None:
    """Print what there is, a heading above each group."""
    if as_json:
        print_json(found)
        return
    blocks = [
        "\n".join(
            [
                *([headings[group]] if group else []),
                *(f"{item['name']:32s} {item['description']}" for item in items),
            ]
        )
        for group, items in groupby(found, lambda item: item.get("group", ""))
    ]
    typer.echo("\n\n".join(blocks))
