"""Arguments and options that several commands have, with their bounds."""

from typing import Annotated, Optional

import typer

from sumo_mcts.registry import PLANNERS

MOST = 1_000_000  # of what is counted: more is a mistake, and would not fit into memory
MOST_JOBS = 1024  # processes

Scenario = Annotated[
    str, typer.Argument(help="A built-in name, a scenario .yaml, or any .sumocfg with --ego.")
]
Ego = Annotated[
    Optional[list[str]],
    typer.Option(help="Vehicle to drive (repeatable); `any`: the first suitable one."),
]
EgoEach = Annotated[
    Optional[list[str]],
    typer.Option(
        help="Vehicle to drive (repeatable, one episode each); `any`: the first suitable one."
    ),
]
Until = Annotated[
    Optional[str],
    typer.Option(help="The goal: the end of this edge. Default: the end of the ego's route."),
]
PlannerName = Annotated[
    Optional[str],
    typer.Option(help=f"The planner: {', '.join(PLANNERS)}, or a plugin."),
]
Assignments = Annotated[
    Optional[list[str]],
    typer.Option("--set", metavar="a.b=c", help="Set any key of the scenario (repeatable)."),
]
AllowPlugins = Annotated[
    bool, typer.Option("--allow-plugins", help="Run code that the scenario names as module:name.")
]
Jobs = Annotated[
    Optional[int],
    typer.Option(min=1, max=MOST_JOBS, metavar="N", help="Processes. Default: one a core."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON document and nothing else.")]
NoProgress = Annotated[bool, typer.Option("--quiet", help="Print no progress.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but errors.")]


def behind_dashes(context: typer.Context) -> tuple[str, ...]:
    """The options for SUMO, behind --.

    Raises BadParameter where they begin with a word that is no option: it stands behind no --.
    """
    if context.args and not context.args[0].startswith("-"):
        raise typer.BadParameter(f"{context.args[0]}: unexpected; options for SUMO follow --")
    return tuple(context.args)
