"""The command value: how true the cost-to-go is along trips of SUMO's driver."""

from collections import Counter, deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from sumo_mcts import records, situations
from sumo_mcts.config import ScenarioConfig
from sumo_mcts.experiments import workers
from sumo_mcts.numerics.announce import announced, watched
from sumo_mcts.numerics.kernel import kept_kernels
from sumo_mcts.scenarios import Note, naming_source, resolve_each
from sumo_mcts.studies.value import Harvest, harvest
from sumo_mcts.studies.value_statistics import summary

VALUE_SCENES = tuple(f"dense-{kind}" for kind in situations.DENSE)
Row = dict[str, Any]


class ValuePlan(NamedTuple):
    """What `value` is to do."""

    seeds: int | None  # episodes with seeds 0 to so many - 1; None: one, as in `run`
    every: int  # cycles from one state to the next
    jobs: int | None = 1  # processes; None: one a core


class _Source(NamedTuple):
    """A scenario with one ego, as it was named."""

    origin: str
    config: ScenarioConfig


def value(
    scenarios: Sequence[str], egos: Sequence[str], until: str | None, overrides: tuple[str, ...],
    plan: ValuePlan, out: Path | None, note: Note, *,
    allow_plugins: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """How true the cost-to-go is, in states of episodes that SUMO's driver drives: one for each
    scenario (none given: VALUE_SCENES), ego and seed.

    Folder `out` gets the rows in states.csv, trips.csv and stands.csv, and the result in
    value.json. Raises ConfigError.
    """
    sources = [
        _Source(name, one)
        for name in scenarios or VALUE_SCENES
        for one in resolve_each(name, egos, until, overrides, allow_plugins=allow_plugins)
    ]
    all_rows: dict[str, list[Row]] = {"states": [], "trips": [], "stands": []}
    outcomes, problems = Counter[str](), list[str]()
    for found in _harvests(sources, plan, note):
        for key, rows in all_rows.items():
            rows.extend(getattr(found, key))
        outcomes += found.outcomes
        problems += found.problems
    result = {
        "schema_version": records.SCHEMA_VERSION,
        "scenarios": list(dict.fromkeys(source.config.name for source in sources)),
        "outcomes": dict(outcomes),
        "problems": problems,
        **summary(**all_rows),
    }
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        for key, rows in all_rows.items():
            records.write_table(out / f"{key}.csv", tuple(rows[0]) if rows else (), rows)
        records.write_whole(out / "value.json", (records.json_text(result) + "\n").encode())
    return result


def _harvests(sources: Sequence[_Source], plan: ValuePlan, note: Note) -> Iterator[Harvest]:
    """What each episode tells, seed by seed; the order does not depend on the number of
    processes."""
    crew = workers.here() if plan.jobs == 1 else workers.local(plan.jobs or workers.cores())
    episodes = list(product(range(plan.seeds or 1), sources))
    with announced(note), crew as found:
        ahead = deque[tuple[_Source, int | None, Future[Harvest]]]()
        for k, (number, source) in enumerate(episodes):
            note(f"episode {k + 1} of {len(episodes)}  {source.config.name}")
            own = source.config.sumo.sumocfg is not None and plan.seeds is None
            seed = None if own else number
            ahead.append(
                (source, seed, found.executor.submit(harvest, source.config, seed, plan.every))
            )
            if len(ahead) >= found.most():
                yield _harvested(*ahead.popleft(), note)
        while ahead:
            yield _harvested(*ahead.popleft(), note)


def _harvested(source: _Source, seed: int | None, found: Future[Harvest], note: Note) -> Harvest:
    """The result of an episode; one whose worker crashed counts as error."""
    with naming_source(source.origin, source.config.sumo.sumocfg):
        try:
            return watched(found, kept_kernels, note)
        except workers.DeadWorkerError as error:
            problem = f"{source.config.name}: seed {seed}: {error}"
            return Harvest([], [], [], Counter(error=1), [problem])


# --- for a person ---


def table(document: dict[str, Any]) -> str:
    """The result as Markdown: a row for each scenario and for each gate."""
    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in document["outcomes"].items())
    trips, stands = document["trips"], document["stands"]
    rise = "-" if trips["rise_s"] is None else f"{trips['rise_s']:.1f}"
    goes, soon = (_share(stands[key], stands["count"]) for key in ("goes", "goes_soon"))
    falls = (
        f"The expected time falls in the median cycle of {trips['falls']} of {trips['count']} "
        f"trips, in {trips['falling_cycles']} of {trips['cycles']} cycles; it rises by {rise} s a "
        "trip in all."
    )
    stood = (
        "Where the ego stood and SUMO's driver went, the planner would have gone by then in "
        f"{goes}, or within 3 s in {soon}."
    )
    scenarios = _lines("scenario", document["by_scenario"])
    gates = _lines("gate", document["by_gate"])
    head = f"driven by SUMO's driver: {outcomes}"
    return "\n".join([head, "", *scenarios, "", *gates, "", falls, stood])


def _lines(key: str, rows: Sequence[Row]) -> list[str]:
    part = "states | waits, s | bias, s | mean error, s | rank correlation"
    return [
        f"| {key} | now: {part} | at the horizon: {part} |",
        f"|---|{'---|' * 10}",
        *(
            f"| {row[key]} | {' | '.join(_cells(row['now']) + _cells(row['horizon']))} |"
            for row in rows
        ),
    ]


def _cells(part: Row) -> list[str]:
    def show(key: str, digits: int) -> str:
        return "-" if part[key] is None else f"{part[key]:.{digits}f}"

    error = f"{show('mae_s', 1)} ({show('none_s', 1)})"
    return [str(part["states"]), show("waited_s", 1), show("bias_s", 1), error, show("rank", 2)]


def _share(part: Row, count: int) -> str:
    if not count:
        return "0 of 0"
    low, high = part["wilson"]
    return f"{part['k']} of {count} ({100 * low:.0f}..{100 * high:.0f} %)"
