"""The command regret: how far planners are from the best decision of the reference problem."""

from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from sumo_mcts import config, files, records
from sumo_mcts.config import ScenarioConfig
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments import workers
from sumo_mcts.experiments.workers import Crew
from sumo_mcts.numerics.announce import announced, watched
from sumo_mcts.numerics.kernel import kept_kernels
from sumo_mcts.planners.reference import LABELS, digest
from sumo_mcts.scenarios import Note, naming_source, resolve_each
from sumo_mcts.studies.regret import (
    FACTOR,
    FINER,
    OWN,
    Asked,
    Harvest,
    Row,
    check,
    convergence,
    harvest,
    ranking,
)

MOST_ITERATIONS = 1_000_000  # of one decision, as planner.iterations allows
_SCENES = ("unprotected-left-turn", "highway-exit", "straight-line")
REGRET_SCENES = (*_SCENES, *(f"{name}-scripted" for name in _SCENES))


class RegretPlan(NamedTuple):
    """What `regret` is to do."""

    asked: Asked
    seeds: int  # episodes a scenario, at most
    every: int  # cycles from one state to the next
    states: int  # at most, over all scenarios
    jobs: int | None = 1  # processes; None: one a core


@dataclass
class _Source:
    """Where states come from: a scenario with one ego."""

    origin: str
    config: ScenarioConfig
    missing: int  # states that are still to come from it

    def named(self) -> AbstractContextManager[None]:
        return naming_source(self.origin, self.config.sumo.sumocfg)


class _Episode(NamedTuple):
    """An episode that was handed to a process."""

    source: _Source
    seed: int | None  # None: the .sumocfg's own
    found: Future[Harvest]


def regret(
    scenarios: Sequence[str], egos: Sequence[str], until: str | None, overrides: tuple[str, ...],
    plan: RegretPlan, out: Path | None, note: Note, *,
    allow_plugins: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """How near planners come to the optimum of the reference problem.

    The states are of episodes that planner `mcts` drives: one for each scenario (none given:
    REGRET_SCENES), ego and seed. Folder `out` gets a row for each judgement in regret.jsonl and
    regret.csv, and the result in regret.json. Raises ConfigError.
    """
    for name in plan.asked.planners:
        config.require_permission("--planners", name, allow_plugins)
    driven = (*overrides, "planner.name=mcts")
    sources = _sources(scenarios or REGRET_SCENES, egos, until, driven, plan, allow_plugins)
    rows: list[Row] = []
    outcomes, problems, states = Counter[str](), list[str](), 0
    with _regret_file(out, rows) as keep:
        for source, seed, found in _harvests(sources, plan, note):
            if not source.missing:  # another process drove it ahead, in vain
                continue
            with source.named():
                harvested = _harvested(found, source.config.name, seed, note)
            outcomes += harvested.outcomes
            problems += harvested.problems
            taken = harvested.states[: source.missing]
            source.missing -= len(taken)
            states += len(taken)
            for row in chain(*taken):
                keep(row)
    result = {
        "schema_version": records.SCHEMA_VERSION,
        "reference": plan.asked.reference,
        "reference_digest": digest(plan.asked.reference),
        "scenarios": list(dict.fromkeys(source.config.name for source in sources)),
        "states": states,
        "outcomes": dict(outcomes),
        "problems": problems,
        **(
            {"convergence": convergence(rows)}
            if plan.asked.converged
            else {"planners": ranking(rows)}
        ),
    }
    if out is not None:
        records.write_whole(out / "regret.json", (records.json_text(result) + "\n").encode())
    return result


def counts(text: str) -> tuple[int, ...]:
    """The numbers of iterations in `50,100`. Raises ConfigError."""
    try:
        numbers = tuple(int(number) for number in text.split(","))
    except ValueError:  # also for more digits than Python reads
        numbers = ()
    if not numbers or not 1 <= min(numbers) <= max(numbers) <= MOST_ITERATIONS:
        raise ConfigError(
            f"--iterations {text}: whole numbers from 1 on, separated by commas, as in 100,1000; "
            f"{MOST_ITERATIONS} at most"
        )
    return numbers


def judges(text: str, planners: Sequence[str]) -> bool:
    """Whether `paper` is judged by its own J beside the reference. Raises ConfigError."""
    if text == "reference":
        return False
    if text != f"reference,{OWN}":
        raise ConfigError(f"--judge {text}: allowed: reference; reference,{OWN}")
    if OWN not in planners:
        raise ConfigError(f"--judge {text}: {OWN} has to be among --planners")
    return True


def _sources(
    scenarios: Sequence[str],
    egos: Sequence[str],
    until: str | None,
    overrides: tuple[str, ...],
    plan: RegretPlan,
    allow: bool,
) -> list[_Source]:
    """Each scenario with each ego, and its share of the states.

    Raises ConfigError where a planner cannot be asked there.
    """
    found = [
        (name, one)
        for name in scenarios
        for one in resolve_each(name, egos, until, overrides, allow_plugins=allow)
    ]
    each, left = divmod(plan.states, len(found))
    sources = [_Source(name, one, each + (k < left)) for k, (name, one) in enumerate(found)]
    for source in sources:
        with source.named():
            check(source.config, plan.asked)
    return sources


def _harvests(sources: Sequence[_Source], plan: RegretPlan, note: Note) -> Iterator[_Episode]:
    """The episodes of all sources, seed by seed, while states are missing.

    The order does not depend on the number of processes.
    """
    crew = workers.here() if plan.jobs == 1 else workers.local(plan.jobs or workers.cores())
    with announced(note), crew as found:
        ahead = deque[_Episode]()
        for episode in _begun(sources, plan, found, note):
            ahead.append(episode)
            if len(ahead) >= found.most():
                yield ahead.popleft()
        yield from ahead


def _begun(
    sources: Sequence[_Source], plan: RegretPlan, crew: Crew, note: Note
) -> Iterator[_Episode]:
    """Hand the episodes to the crew one by one, each when it is asked for."""
    for number in range(plan.seeds):
        for source in sources:
            if not source.missing:
                continue
            left = sum(each.missing for each in sources)
            note(f"{left} of {plan.states} states to go  {source.config.name}, episode {number}")
            own = source.config.sumo.sumocfg is not None and plan.seeds == 1
            seed = None if own else number
            found = crew.executor.submit(
                harvest, source.config, seed, plan.asked, plan.every, number, source.missing
            )
            yield _Episode(source, seed, found)


def _harvested(found: Future[Harvest], scenario: str, seed: int | None, note: Note) -> Harvest:
    """The result of an episode; one whose worker crashed counts as error."""
    try:
        return watched(found, kept_kernels, note)
    except workers.DeadWorkerError as error:
        return Harvest((), Counter(error=1), (f"{scenario}: seed {seed}: {error}",))


@contextmanager
def _regret_file(out: Path | None, rows: list[Row]) -> Iterator[Callable[[Row], None]]:
    """Gives a function that keeps a row: in the list and, at once, in regret.jsonl.

    regret.csv is written at the end, after an error or an interrupt too.
    """
    if out is None:
        yield rows.append
        return
    out.mkdir(parents=True, exist_ok=True)
    with (
        files.naming(out / "regret.jsonl"),
        (out / "regret.jsonl").open("w", encoding="utf-8") as file,
    ):

        def keep(row: Row) -> None:
            rows.append(row)
            file.write(records.json_text(row, indent=None) + "\n")
            file.flush()

        try:
            yield keep
        finally:  # an interrupt too
            records.write_table(out / "regret.csv", tuple(rows[0]) if rows else (), rows)


def table(document: dict[str, Any]) -> str:
    """The result for a person, as Markdown: a row for each planner and number of iterations.

    With `converged`, how far the reference has converged.
    """
    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in document["outcomes"].items())
    head = (
        f"{', '.join(document['scenarios'])}, driven by mcts: {outcomes}, {document['states']} "
        f"states; reference {document['reference']} ({document['reference_digest'][:16]})"
    )
    if "convergence" in document:
        return f"{head}\n\n{_convergence_text(document['convergence'])}"
    part = "states | near-optimal (95 % Wilson) | mean regret | 95 % of regrets below"
    columns = f"| planner | iterations | {part} | contested {part} | collides though avoidable |"
    return "\n".join(
        [
            head,
            "",
            columns,
            "|---|---|---|---|---|---|---|---|---|---|---|",
            *(_regret_line(row) for row in document["planners"]),
            *_own_lines(document["planners"]),
        ]
    )


def _own_lines(planners: Sequence[Row]) -> list[str]:
    """A table of those that are judged by their own costs too, if there are any."""
    own = [row for row in planners if "own" in row]
    if not own:
        return []
    part = "states | near-optimal (95 % Wilson) | mean regret | 95 % of regrets below"
    return [
        "",
        "By its own J, regret in units of what braking with 4 m/s2 for T_1 costs:",
        "",
        f"| planner | iterations | {part} |",
        "|---|---|---|---|---|---|",
        *(
            f"| {' | '.join([row['planner'], str(row['iterations']), *_part_cells(row['own'])])} |"
            for row in own
        ),
    ]


def _part_cells(part: Row) -> list[str]:
    """States, near-optimal ones, mean regret, and what 95 % of regrets do not exceed."""
    k, n = part["near_optimal"], part["states"]
    if n == 0:
        return ["0", "-", "-", "-"]
    low, high = part["wilson"]
    return [
        str(n),
        f"{k}/{n} ({100 * low:.1f}..{100 * high:.1f} %)",
        f"{part['mean_regret']:.2f}",
        f"{part['p95_regret']:.2f}",
    ]


def _regret_line(row: Row) -> str:
    cells = [
        row["planner"],
        str(row["iterations"] or "-"),
        *_part_cells(row["all"]),
        *_part_cells(row["contested"]),
        f"{row['all']['collides']}/{row['all']['avoidable']}",
    ]
    return f"| {' | '.join(cells)} |"


def _convergence_text(found: dict[str, Any]) -> str:
    def show(name: str, part: dict[str, Any]) -> str:
        if not part["count"]:
            return f"{name}: none"
        return (
            f"{name}: {part['count']}, off by {part['mean']:.4f} on average, {part['p99']:.3f} "
            f"(99 %), {part['max']:.3f} at most"
        )

    lines = [
        (
            f"{LABELS} labels against the better of {FACTOR * LABELS} and of {FINER * LABELS} in "
            "cells half as wide, in units of the scale:"
        ),
        show("costs of actions", found["actions"]),
        show("costs of the optimum", found["optimum"]),
    ]
    if found["optimum"]["count"]:
        lines.append(
            f"the action chosen, by the converged costs: regret {found['choice']['mean']:.4f} on "
            f"average, {found['choice']['max']:.3f} at most"
        )
    return "\n".join(
        [
            *lines,
            (
                "actions of which only one of the two finds a way without a loss: "
                f"{found['other_outcome']}"
            ),
        ]
    )
