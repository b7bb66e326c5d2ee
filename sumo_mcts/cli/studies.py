"""The commands forecast, drivers, regret, value and bench: what is measured apart from
experiments."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from sumo_mcts.cli.application import command, fail_with, print_json
from sumo_mcts.cli.options import (
    MOST,
    AllowPlugins,
    AsJson,
    Assignments,
    EgoEach,
    Jobs,
    NoProgress,
    PlannerName,
    Scenario,
    Until,
    behind_dashes,
)
from sumo_mcts.cli.progress import progress
from sumo_mcts.registry import PLANNERS, searches

Seeds = Annotated[
    Optional[int],
    typer.Option(
        min=1, max=MOST, metavar="N",
        help="Episodes with seeds 0 to N-1. Default: one, as `run` drives it.",
    ),
]  # fmt: skip
Scenarios = Annotated[
    Optional[list[str]],
    typer.Argument(
        help="As for `run`; default: the three scenes of Table 1, reactive and scripted."
    ),
]
Planners = Annotated[str, typer.Option(metavar="NAME,...", help="The planners that are asked.")]
IterationCounts = Annotated[
    str, typer.Option(metavar="N,...", help="So many iterations each, for those that search.")
]
States = Annotated[
    int, typer.Option(min=1, max=MOST, metavar="N", help="At most, over all scenarios.")
]
SeedsEach = Annotated[
    int,
    typer.Option(
        min=1, max=MOST, metavar="N", help="Episodes a scenario, at most: seeds 0 to N-1."
    ),
]
Every = Annotated[
    int,
    typer.Option(min=1, max=MOST, metavar="N", help="Decision periods from one state to the next."),
]
Reference = Annotated[
    str,
    typer.Option(metavar="NAME", help="The version of the reference problem: 1, 2 or 2-forecast."),
]
Converged = Annotated[
    bool,
    typer.Option("--converged", help="Measure the reference itself, against 100 times its budget."),
]
Judge = Annotated[
    str,
    typer.Option(
        metavar="NAME,NAME",
        help="reference, or reference,paper: planner paper is judged by the optimum of its own J "
        "too.",
    ),
]
DenseOrScenarios = Annotated[
    Optional[list[str]],
    typer.Argument(help="As for `run`; default: the built-in kinds of dense situations."),
]
ValueFolder = Annotated[
    Optional[Path],
    typer.Option(help="Folder for states.csv, trips.csv, stands.csv and value.json."),
]
RegretFolder = Annotated[
    Optional[Path],
    typer.Option(help="Folder for regret.jsonl and regret.csv, a row for each judgement."),
]

Situations = Annotated[
    list[str],
    typer.Argument(metavar="SCENARIO...", help="As for `run`."),
]
Families = Annotated[
    Optional[str],
    typer.Option(
        metavar="NAME,...", help="Families of drivers, one episode each (dense situations)."
    ),
]
FirstSeed = Annotated[int, typer.Option(min=0, max=MOST, metavar="N", help="The first seed.")]
SeedsOfEach = Annotated[
    int, typer.Option(min=1, max=MOST, metavar="N", help="Episodes of each, with seeds from there.")
]
Fit = Annotated[
    bool, typer.Option("--fit", help="Fit the model of lane changes, and show its weights.")
]


@command(for_sumo=True)
def forecast(
    context: typer.Context,
    scenario: Scenario,
    ego: EgoEach = None,
    ego_until: Until = None,
    seeds: Seeds = None,
    planner: PlannerName = None,
    assign: Assignments = None,
    allow_plugins: AllowPlugins = False,
    as_json: AsJson = False,
    quiet: NoProgress = False,
) -> None:
    """Measure every forecast, oracles too, against what then happened.

    Options after -- go to SUMO.
    """
    from sumo_mcts.commands import forecast as command

    named = () if planner is None else (f"planner.name={planner}",)
    with progress("starting SUMO", quiet=quiet or as_json) as note:
        result = command.forecast(
            scenario, ego or (), ego_until, (*(assign or ()), *named), seeds,
            behind_dashes(context), note, allow_plugins=allow_plugins,
        )  # fmt: skip
    print_json(result) if as_json else typer.echo(command.table(result))
    fail_with(result["problems"])


@command()
def drivers(
    scenarios: Situations,
    ego: EgoEach = None,
    ego_until: Until = None,
    families: Families = None,
    first: FirstSeed = 0,
    seeds: SeedsOfEach = 1,
    fit: Fit = False,
    assign: Assignments = None,
    allow_plugins: AllowPlugins = False,
    as_json: AsJson = False,
    quiet: NoProgress = False,
) -> None:
    """Measure how good the probabilities are that forecasts give to what drivers do next."""
    from sumo_mcts.commands import drivers as command

    plan = command.DriversPlan(command.families(families), first, seeds, fit)
    with progress("starting SUMO", quiet=quiet or as_json) as note:
        result = command.drivers(
            scenarios, ego or (), ego_until, tuple(assign or ()), plan, note,
            allow_plugins=allow_plugins,
        )  # fmt: skip
    print_json(result) if as_json else typer.echo(command.table(result))
    fail_with(result["problems"])


@command()
def regret(
    scenarios: Scenarios = None,
    ego: EgoEach = None,
    ego_until: Until = None,
    planners: Planners = ",".join(filter(searches, PLANNERS)),
    iterations: IterationCounts = "50,100,300,1000,2000,3000",
    states: States = 300,
    seeds: SeedsEach = 10,
    every: Every = 5,
    reference: Reference = "2",
    converged: Converged = False,
    judge: Judge = "reference",
    jobs: Jobs = None,
    assign: Assignments = None,
    out: RegretFolder = None,
    allow_plugins: AllowPlugins = False,
    as_json: AsJson = False,
    quiet: NoProgress = False,
) -> None:
    """Measure how near planners come to the optimum of a reference problem, in states from episodes
    driven by planner mcts."""
    from sumo_mcts.commands import folders
    from sumo_mcts.commands import regret as command
    from sumo_mcts.studies.regret import Asked

    if out is not None:
        folders.check_folder(out)
    names = tuple(planners.split(","))
    own = command.judges(judge, names)
    asked = Asked(names, command.counts(iterations), converged, reference, own)
    plan = command.RegretPlan(asked, seeds, every, states, jobs)
    with progress("starting SUMO", quiet=quiet or as_json) as note:
        result = command.regret(
            scenarios or (), ego or (), ego_until, tuple(assign or ()), plan, out, note,
            allow_plugins=allow_plugins,
        )  # fmt: skip
    print_json(result) if as_json else typer.echo(command.table(result))
    fail_with(result["problems"])


@command()
def value(
    scenarios: DenseOrScenarios = None,
    ego: EgoEach = None,
    ego_until: Until = None,
    seeds: Seeds = None,
    every: Every = 2,
    jobs: Jobs = None,
    assign: Assignments = None,
    out: ValueFolder = None,
    allow_plugins: AllowPlugins = False,
    as_json: AsJson = False,
    quiet: NoProgress = False,
) -> None:
    """Measure how true the cost-to-go is, along trips that SUMO's driver drives."""
    from sumo_mcts.commands import folders
    from sumo_mcts.commands import value as command

    if out is not None:
        folders.check_folder(out)
    plan = command.ValuePlan(seeds, every, jobs)
    with progress("starting SUMO", quiet=quiet or as_json) as note:
        result = command.value(
            scenarios or (), ego or (), ego_until, tuple(assign or ()), plan, out, note,
            allow_plugins=allow_plugins,
        )  # fmt: skip
    print_json(result) if as_json else typer.echo(command.table(result))
    fail_with(result["problems"])


@command()
def bench(
    as_json: Annotated[bool, typer.Option("--json", help="One JSON document.")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="A tenth of the repetitions.")] = False,
) -> None:
    """Measure the budgets of docs/measures.md on this machine."""
    from sumo_mcts.commands.bench import line
    from sumo_mcts.studies import bench

    with progress("measuring", quiet=as_json) as note:
        rows = bench.run(0.1 if quick else 1.0, note)
    print_json(rows) if as_json else typer.echo("\n".join(line(**row) for row in rows))
