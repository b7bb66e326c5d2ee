"""What the commands do, as plain functions: no printing, no exit codes."""

import os
import secrets
import tempfile
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from sumo_mcts import assets, config, files, records, run_key
from sumo_mcts.config import MOST_SEED, ConfigError, ScenarioConfig
from sumo_mcts.driver import cost_params, make_planner, make_predictor
from sumo_mcts.episode import EpisodeResult, check_edges, open_episode
from sumo_mcts.errors import printable
from sumo_mcts.experiments import drive, workers
from sumo_mcts.experiments import folder as batch_folder
from sumo_mcts.experiments.batch import SHARDS, Progress, built_in, listed, run_batch, tried
from sumo_mcts.experiments.experiment import is_experiment
from sumo_mcts.experiments.statistics import REDRAWN, TRAFFIC_DIGEST
from sumo_mcts.experiments.workers import Crew
from sumo_mcts.forecast_error import compare
from sumo_mcts.model.announce import announced, watched
from sumo_mcts.model.kernel import kept_kernels
from sumo_mcts.planners.reference import LABELS, digest
from sumo_mcts.regret import FACTOR, FINER, Asked, Harvest, Row, check, convergence, harvest, ranking
from sumo_mcts.world import actors, crowd
from sumo_mcts.world.arguments import draws_seed, is_sumocfg, key_of_value, network_of, require_good, sumocfg_arguments
from sumo_mcts.world.candidates import Candidate, candidates
from sumo_mcts.world.roadmap import known_roadmap

LISTED = 25  # candidates shown
SEARCHED = 100_000  # vehicles looked at for `--ego any`
PATIENCE_S = 20.0  # for another run that writes into the same folder
REPLAYS = 50  # episodes that a report lists, and replays
TRIED_S = 7.0  # wall time that a check may take once SUMO runs
_SCENES = ("unprotected-left-turn", "highway-exit", "straight-line")
REGRET_SCENES = (*_SCENES, *(f"{name}-scripted" for name in _SCENES))

Note = Callable[[str], None]


class RegretPlan(NamedTuple):
    """What `regret` is to do."""

    asked: Asked
    seeds: int  # episodes a scenario, at most
    every: int  # cycles from one state to the next
    states: int  # at most, over all scenarios
    jobs: int | None = 1  # processes; None: one a core


@dataclass
class _Source:
    """Where states come from: a scenario with one ego, as far as it was driven."""

    origin: str
    config: ScenarioConfig
    missing: int  # states

    def named(self) -> AbstractContextManager[None]:
        return _named(self.origin, self.config.sumo.sumocfg)


def resolve(
    scenario: str, seed: int | None, egos: Sequence[str], until: str | None, overrides: tuple[str, ...], sumo_options: Sequence[str], *,
    allow_plugins: bool = False,
) -> ScenarioConfig:  # fmt: skip
    """The scenario behind a name, a YAML file or a .sumocfg. Raises ConfigError."""
    if not is_sumocfg(scenario):
        path, changes = assets.scenario_path(scenario), {}
        if egos or until:
            names = list(egos) or [ego.id for ego in config.load(path, overrides, allow_plugins=allow_plugins).egos]
            changes = {"egos": [_ego(name, until) for name in names]}
        return config.load(path, overrides, changes=changes, allow_plugins=allow_plugins)
    _check_sumocfg(scenario)
    names = [_first_suitable(scenario, until, seed, sumo_options) if name == "any" else name for name in egos]
    path = Path(scenario)
    data = {"name": config.name_from(path), "sumo": {"sumocfg": str(files.absolute(path))}, "egos": [_ego(name, until) for name in names]}
    return config.build(data, scenario, overrides, allow_plugins=allow_plugins)


def list_candidates(sumocfg: str, seed: int | None, sumo_options: Sequence[str]) -> list[Candidate]:
    """Vehicles that could be the ego, suitable ones first."""
    _check_sumocfg(sumocfg)
    with _named(sumocfg, sumocfg):
        found = candidates(sumocfg_arguments(sumocfg, seed, sumo_options), 4 * LISTED)
    return sorted(found, key=lambda c: not c.suitable)[:LISTED]


@contextmanager
def run(scenario: ScenarioConfig, origin: str, seed: int | None, gui: bool, sumo_options: Sequence[str], note: Note) -> Iterator[EpisodeResult]:
    """One episode, while SUMO is still there; the default seed is 0, but a .sumocfg keeps its own. `origin` stands in error messages. Raises ConfigError."""
    if seed is None and scenario.sumo.sumocfg is None:
        seed = 0
    own = _own(scenario, origin)
    with ExitStack() as stack:
        with _named(origin, scenario.sumo.sumocfg):
            if seed is None and draws_seed(scenario.sumo):
                seed = secrets.randbelow(MOST_SEED + 1)
                note(f"SUMO's option random is on: --seed {seed} drives this episode again")
            variant = run_key.variant_of(scenario, own, sumo_options)
            episode = open_episode(scenario, seed, gui=gui, sumo_options=sumo_options, progress=note, variant=variant)
            result = stack.enter_context(episode)
            further = {REDRAWN: result.manifest["redrawn"], TRAFFIC_DIGEST: run_key.traffic(scenario, sumo_options)}
            manifest = {**result.manifest, **run_key.inputs(scenario, own, sumo_options)}
        result = result._replace(rows=tuple({**row, **further} for row in result.rows), manifest=manifest)
        yield run_key.keyed(result, scenario.name, named=run_key.is_named(scenario, own))


def _own(scenario: ScenarioConfig, origin: str) -> ScenarioConfig | None:
    """The scenario behind a name or file as it is without what else was asked for; None: it cannot stand alone."""
    try:
        if not is_sumocfg(origin):
            return config.load(assets.scenario_path(origin), allow_plugins=True)
        data = {"name": scenario.name, "sumo": {"sumocfg": scenario.sumo.sumocfg}, "egos": [{"id": scenario.egos[0].id}]}
        return config.build(data, origin)
    except ConfigError:
        return None


def forecasts(
    scenario: str, egos: Sequence[str], until: str | None, overrides: tuple[str, ...], seeds: int | None, sumo_options: Sequence[str], note: Note, *,
    allow_plugins: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """The error of every forecast, over an episode for each ego (none given: the scenario's own, together) and seed: 0 .. `seeds` - 1; None: one,
    as in `run`. Raises ConfigError."""
    resolved = _episodes(scenario, egos, until, overrides, sumo_options, allow_plugins=allow_plugins)
    sumocfg = resolved[0].sumo.sumocfg
    with _named(scenario, sumocfg):
        one = None if sumocfg is not None else 0
        return compare(resolved, [one] if seeds is None else list(range(seeds)), sumo_options, note)


def forecast_table(document: dict[str, Any]) -> str:
    """The errors for a person, as Markdown: a row for each predictor, in each cell the horizons one after the other."""
    rows = document["forecasts"]
    names = list(dict.fromkeys(row["prediction"] for row in rows))
    after = ", ".join(f"{horizon:g}" for horizon in dict.fromkeys(row["horizon_s"] for row in rows))
    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in document["outcomes"].items())
    head = f"{document['scenario']}, driven by {document['variant']}: {outcomes}, {document['cycles']} cycles; after {after} s:"
    columns = "| scene | forecast | pairs | mean, m | 95 %, m | largest, m | right lane, % | taken for gone | one forecast (p50), ms |"
    lines = [_forecast_line(document["scenario"], [row for row in rows if row["prediction"] == name]) for name in names]
    return "\n".join([head, "", columns, "|---|---|---|---|---|---|---|---|---|", *lines])


def regret(
    scenarios: Sequence[str], egos: Sequence[str], until: str | None, overrides: tuple[str, ...], plan: RegretPlan, out: Path | None, note: Note, *,
    allow_plugins: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """How near planners come to the optimum of the reference problem, in states of episodes that planner `mcts` drives: an episode for each scenario (none
    given: REGRET_SCENES), ego and seed. Every judgement goes into regret.jsonl and regret.csv in `out`, and what is returned into regret.json. Raises
    ConfigError."""
    for name in plan.asked.planners:
        config.require_permission("--planners", name, allow_plugins)
    driven = (*overrides, "planner.name=mcts")
    sources = _sources(scenarios or REGRET_SCENES, egos, until, driven, plan, allow_plugins)
    rows: list[Row] = []
    outcomes, problems, states = Counter[str](), list[str](), 0
    with _regret_file(out, rows) as keep:
        for source, seed, found in _harvests(sources, plan, note):
            if not source.missing:  # driven ahead, in vain
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
        "reference_digest": digest(),
        "scenarios": list(dict.fromkeys(source.config.name for source in sources)),
        "states": states,
        "outcomes": dict(outcomes),
        "problems": problems,
        **({"convergence": convergence(rows)} if plan.asked.converged else {"planners": ranking(rows)}),
    }
    if out is not None:
        records.write_whole(out / "regret.json", (records.json_text(result) + "\n").encode())
    return result


def counts(text: str) -> tuple[int, ...]:
    """The numbers of iterations in `50,100`. Raises ConfigError."""
    try:
        numbers = tuple(int(number) for number in text.split(","))
    except ValueError:
        numbers = ()
    if not numbers or min(numbers) < 1:
        raise ConfigError(f"--iterations {text}: whole numbers from 1 on, separated by commas, as in 100,1000")
    return numbers


def _sources(scenarios: Sequence[str], egos: Sequence[str], until: str | None, overrides: tuple[str, ...], plan: RegretPlan, allow: bool) -> list[_Source]:
    """Each scenario with each ego, and its share of the states. Raises ConfigError where somebody cannot be asked there."""
    found = [(name, one) for name in scenarios for one in _episodes(name, egos, until, overrides, allow_plugins=allow)]
    each, left = divmod(plan.states, len(found))
    sources = [_Source(name, one, each + (k < left)) for k, (name, one) in enumerate(found)]
    for source in sources:
        with source.named():
            check(source.config, plan.asked)
    return sources


def _harvests(sources: Sequence[_Source], plan: RegretPlan, note: Note) -> Iterator[tuple[_Source, int | None, "Future[Harvest]"]]:
    """The episodes of all sources, seed by seed, as far as states are missing; in this order whatever the number of processes."""

    def begun(crew: Crew) -> Iterator[tuple[_Source, int | None, "Future[Harvest]"]]:
        for number in range(plan.seeds):
            for source in sources:
                if source.missing:
                    note(f"{sum(one.missing for one in sources)} of {plan.states} states to go  {source.config.name}, episode {number}")
                    seed = None if source.config.sumo.sumocfg is not None and plan.seeds == 1 else number
                    yield source, seed, crew.executor.submit(harvest, source.config, seed, plan.asked, plan.every, number, source.missing)

    with announced(note), workers.here() if plan.jobs == 1 else workers.local(plan.jobs or workers.cores()) as crew:
        ahead = deque[tuple[_Source, int | None, "Future[Harvest]"]]()
        for one in begun(crew):
            ahead.append(one)
            if len(ahead) >= crew.most():
                yield ahead.popleft()
        yield from ahead


def _harvested(found: "Future[Harvest]", scenario: str, seed: int | None, note: Note) -> Harvest:
    """What an episode gave; one whose worker died is an outcome too."""
    try:
        return watched(found, kept_kernels, note)
    except workers.DeadWorkerError as error:
        return Harvest((), Counter(error=1), (f"{scenario}: seed {seed}: {error}",))


def _episodes(
    scenario: str, egos: Sequence[str], until: str | None, overrides: tuple[str, ...], sumo_options: Sequence[str] = (), *, allow_plugins: bool
) -> list[ScenarioConfig]:
    """The scenario with each ego (none given: its own, together)."""
    require_egos(scenario, egos)
    each = [[ego] for ego in egos] or [[]]
    return [resolve(scenario, None, names, until, overrides, sumo_options, allow_plugins=allow_plugins) for names in each]


def require_egos(scenario: str, egos: Sequence[str]) -> None:
    """Raise ConfigError where nobody is named to drive in a .sumocfg."""
    if is_sumocfg(scenario) and not egos:
        raise ConfigError(f"{scenario}: --ego: not given; `sumo-mcts run {scenario}` lists the candidates")


@contextmanager
def _regret_file(out: Path | None, rows: list[Row]) -> Iterator[Callable[[Row], None]]:
    """Hands out what keeps a row: in the list and, at once, in regret.jsonl; at the end, whatever it is, regret.csv is written."""
    if out is None:
        yield rows.append
        return
    out.mkdir(parents=True, exist_ok=True)
    with files.naming(out / "regret.jsonl"), (out / "regret.jsonl").open("w", encoding="utf-8") as file:

        def keep(row: Row) -> None:
            rows.append(row)
            file.write(records.json_text(row, indent=None) + "\n")
            file.flush()

        try:
            yield keep
        finally:  # an interrupt too
            records.write_table(out / "regret.csv", tuple(rows[0]) if rows else (), rows)


def regret_table(document: dict[str, Any]) -> str:
    """Near-optimality for a person, as Markdown: a row for each planner and number of iterations. Or how far the reference has converged."""
    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in document["outcomes"].items())
    head = f"{', '.join(document['scenarios'])}, driven by mcts: {outcomes}, {document['states']} states; reference {document['reference_digest'][:16]}"
    if "convergence" in document:
        return f"{head}\n\n{_convergence_text(document['convergence'])}"
    part = "states | near-optimal (95 % Wilson) | mean regret | 95 % of regrets below"
    columns = f"| planner | iterations | {part} | contested {part} | collides though avoidable |"
    return "\n".join([head, "", columns, "|---|---|---|---|---|---|---|---|---|---|---|", *(_regret_line(row) for row in document["planners"])])


def _regret_line(row: Row) -> str:
    def show(part: Row) -> list[str]:
        k, n = part["near_optimal"], part["states"]
        if n == 0:
            return ["0", "-", "-", "-"]
        low, high = part["wilson"]
        return [str(n), f"{k}/{n} ({100 * low:.1f}..{100 * high:.1f} %)", f"{part['mean_regret']:.2f}", f"{part['p95_regret']:.2f}"]

    cells = [row["planner"], str(row["iterations"] or "-"), *show(row["all"]), *show(row["contested"]), f"{row['all']['collides']}/{row['all']['avoidable']}"]
    return f"| {' | '.join(cells)} |"


def _convergence_text(found: dict[str, Any]) -> str:
    def show(name: str, part: dict[str, Any]) -> str:
        if not part["count"]:
            return f"{name}: none"
        return f"{name}: {part['count']}, off by {part['mean']:.4f} on average, {part['p99']:.3f} (99 %), {part['max']:.3f} at most"

    lines = [
        f"{LABELS} labels against the better of {FACTOR * LABELS} and of {FINER * LABELS} in cells half as wide, in units of the scale:",
        show("costs of actions", found["actions"]),
        show("costs of the optimum", found["optimum"]),
    ]
    if found["optimum"]["count"]:
        lines.append(f"the action chosen, by the converged costs: regret {found['choice']['mean']:.4f} on average, {found['choice']['max']:.3f} at most")
    return "\n".join([*lines, f"actions of which only one of the two finds a way without a loss: {found['other_outcome']}"])


def batch(
    experiment: str,
    out: Path,
    jobs: int | None,
    scheduler: str | None,
    shard: str,
    fresh: bool,
    allow_plugins: bool,
    episode_timeout: float,
    command: Sequence[str],
    watch: Callable[[Progress], None],
) -> list[dict[str, Any]]:
    """The rows of an experiment, driven into a folder as far as they are not there yet. Raises ConfigError and BatchError."""
    return run_batch(
        experiment, out, jobs=jobs, scheduler=scheduler, shard=_shard(shard), fresh=fresh, allow_plugins=allow_plugins, episode_timeout_s=episode_timeout,
        command=command, watch=watch,
    )  # fmt: skip


def batch_listing(experiment: str, out: Path | None, shard: str, fresh: bool, allow_plugins: bool) -> str:
    """A line for each row that `batch` would bring about. Raises ConfigError."""
    found = listed(experiment, out, shard=_shard(shard), fresh=fresh, allow_plugins=allow_plugins)
    lines = [f"{'done' if item.done else 'to do':6s} {item.key}" for item in found]
    done = sum(item.done for item in found)
    return "\n".join([*lines, f"{len(found)} rows, {done} done, {len(found) - done} to do"])


def batch_summary(rows: Sequence[dict[str, Any]]) -> str:
    """How the episodes ended, for a person: a line for each scenario and variant."""
    counts: dict[tuple[str, str], Counter[str]] = {}
    for row in rows:
        counts.setdefault((row["scenario"], row["variant"]), Counter())[row["outcome"]] += 1
    width = max((len(name) for names in counts for name in names), default=0)
    return "\n".join(
        f"{scenario:{width}s}  {variant:{width}s}  {', '.join(f'{n} {outcome}' for outcome, n in found.most_common())}"
        for (scenario, variant), found in counts.items()
    )


def _shard(text: str) -> tuple[int, int]:
    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal()):
        raise ConfigError(f"--shard {text}: {SHARDS}")
    return int(number), int(count)


def failures(result: EpisodeResult) -> list[str]:
    """A line for each ego whose outcome is `error`."""
    return [f"{row['scenario']}: ego {row['ego']}: {row['error']}" for row in result.rows if row["outcome"] == "error"]


class Kept(NamedTuple):
    """What was kept of a run."""

    result: EpisodeResult  # under the keys that it has in the folder
    remarks: tuple[str, ...]  # for a person: what was replaced, or renamed
    files: tuple[Path, ...]  # what a person wants to open


def keep(result: EpisodeResult, out: Path, command: Sequence[str]) -> Kept:
    """Map, traces, manifests and rows into a folder, and nothing of what is there lost. Raises OSError, ConfigError where another run does not finish."""
    manifest = {**result.manifest, "command": ["sumo-mcts", *command]}
    with batch_folder.only_here(out, PATIENCE_S):
        there = {row["key"]: row for row in records.read_rows(out)}
        result, remarks = _placed(result, out, there)
        if result.traces and result.road is not None:
            records.save_map(out, result.road)
        (out / records.TRACES).mkdir(exist_ok=True)
        for trace in result.traces:
            records.save_trace(out / records.TRACES / f"{trace.key}.npz", trace)
        batch_folder.drop_traces(out, {row["key"] for row in result.rows} - {trace.key for trace in result.traces})
        for row in result.rows:
            records.write_manifest_of(out, row["key"], manifest)
            if records.put_row(out, row):
                remarks.append(f"{out}: {row['key']}: its earlier row is replaced")
                _drop_pictures(out, row, there[row["key"]])
        records.write_csv(out)
        records.write_manifest(out, manifest)
    return Kept(result, tuple(remarks), (out / records.TABLE, out / records.MANIFEST))


def _placed(result: EpisodeResult, out: Path, there: Mapping[str, Row]) -> tuple[EpisodeResult, list[str]]:
    """The result under keys under which the folder holds nothing else, `there` being its rows by key, and what to say of that: another scenario of the same
    name, which has other settings or files of its own, keeps its rows."""
    identity, first = result.manifest["identity"], result.rows[0]
    of_name = (records.read_manifest_of(out, key).get("identity") for key, row in there.items() if row["scenario"] == first["scenario"])
    known = next((each for each in of_name if each), identity)
    untold = [row for row in result.rows if row["key"] in there and not records.read_manifest_of(out, row["key"])]
    if known == identity and all(there[row["key"]].get("config_digest") == row["config_digest"] for row in untold):
        return result, []
    name = f"{first['scenario']}.{identity[:8]}"
    said = f"{out}: holds another scenario {first['scenario']}, of other settings or files; this one is kept as {name}"
    return run_key.keyed(result, name, named=run_key.tells_ego(first)), [said]


def _drop_pictures(out: Path, row: Row, before: Row) -> None:
    """Remove the pictures of an earlier row, unless they show the same drive."""
    if row["trace_digest"] != before.get("trace_digest"):
        for form in ("png", "gif", "mp4"):
            (out / records.FIGURES / f"{row['key']}.{form}").unlink(missing_ok=True)


def draw(result: EpisodeResult, out: Path, note: Note) -> list[Path]:
    """A storyboard and an animation of each ego's drive into a folder; the files. Raises OSError."""
    from sumo_mcts.reporting import birdseye  # loads matplotlib, which takes a while

    (out / records.FIGURES).mkdir(exist_ok=True)
    shown = []
    for trace in result.traces:
        picture, film = (out / records.FIGURES / f"{trace.key}.{form}" for form in ("png", "gif"))
        note("drawing the storyboard")
        birdseye.storyboard(trace, picture)
        birdseye.animation(trace, film, note=note)
        shown += [picture, film]
    return shown


# --- report ---


class Report(NamedTuple):
    """What `report` made."""

    document: dict[str, Any]  # what --json prints
    text: str  # the first tables, as Markdown; report.md has them all
    files: tuple[Path, ...]  # what a person wants to open


def report(folders: Sequence[Path], out: Path, command: Sequence[str], note: Note) -> Report:
    """Tables and a page over all episodes of the folders, into `out`. Raises ConfigError where there is none, OSError."""
    from sumo_mcts.reporting import page, results, tables  # quick, but no other command needs them

    found = results.gather(folders)
    note("counting")
    made = tables.tables(found.rows)
    looks, of = tables.worth_a_look(found.rows, REPLAYS)
    replays, problems = page.replays(looks, found.traces, note)
    found = found._replace(notes=(*found.notes, *problems))
    note("writing the page")
    records.write_whole(out / "report.md", tables.report_markdown(found, made, looks).encode(errors="replace"))
    for table in made:
        records.write_table(out / "tables" / f"{table.name}.csv", *tables.flat(table))
    written = page.page(found, made, looks, of, replays, " ".join(["sumo-mcts", *command]))
    records.write_whole(out / "report.html", written.encode(errors="replace"))
    text = "\n".join([*(tables.markdown(table) for table in made[:2] if table.rows), *(f"note: {line}" for line in found.notes)])
    return Report(tables.report_document(found, made, looks, of), text, (out / "report.html", out / "report.md", out / "tables"))


def document(result: EpisodeResult) -> dict[str, Any]:
    """What `run --json` prints."""
    return {"schema_version": records.SCHEMA_VERSION, "episodes": list(result.rows)}


def summary(result: EpisodeResult) -> str:
    """The rows, for a person."""
    return "\n\n".join(_summary(row) for row in result.rows)


def scenarios() -> list[dict[str, str]]:
    """Name and description of the built-in scenarios."""
    found = [config.load(assets.scenario_path(name)) for name in assets.scenario_names()]
    return [{"name": scenario.name, "description": scenario.description} for scenario in found]


def experiments() -> list[dict[str, str]]:
    """Name and description of the built-in experiments."""
    return built_in()


def problems_of(path: Path, *, allow_plugins: bool = False) -> list[str]:
    """What is wrong with a scenario file, a .sumocfg or an experiment: a line for each mistake, none where it can be driven. SUMO is started, nobody decides;
    plugins are made, so that they check their options."""
    try:
        if is_sumocfg(str(path)):
            _try_sumocfg(str(path))
            return []
        if is_experiment(config.parsed(path)):
            return tried(path, TRIED_S, allow_plugins=allow_plugins)
        scenario = config.load(path, allow_plugins=allow_plugins)
    except ConfigError as error:
        return list(error.every)
    return _mistakes(scenario, str(path))


def _mistakes(scenario: ScenarioConfig, origin: str) -> list[str]:
    """What is wrong with a scenario beyond the values of its keys; SUMO is asked where we find nothing."""
    sumocfg = scenario.sumo.sumocfg
    seed = 0 if sumocfg is None else None
    plugins: list[Callable[[], object]] = [lambda: make_planner(scenario), lambda: make_predictor(scenario), lambda: cost_params(scenario)]
    found = [line for part in plugins for line in _wrong(part, origin, sumocfg)]
    for part in (lambda: require_good(scenario.sumo), lambda: _require_fit(scenario), lambda: drive.require_starting(scenario, seed)):
        wrong = _wrong(part, origin, sumocfg)
        if wrong:  # the next one rests on it
            return [*found, *wrong]
    return found


def _require_fit(scenario: ScenarioConfig) -> None:
    """Raise ConfigError, with a line for each mistake, where the scenario does not fit its network."""
    road = known_roadmap(network_of(scenario.sumo.sumocfg, scenario.sumo.net))
    parts = [partial(check_edges, scenario.model_copy(update={"egos": (ego,)}), road) for ego in scenario.egos]
    parts += [partial(actors.check, actor, road) for actor in scenario.traffic.actors]
    parts += [partial(crowd.check_stream, k, stream, road) for k, stream in enumerate(scenario.traffic.crowd.streams)]
    lines = [str(error) for error in map(_error_of, parts) if error is not None]
    if lines:
        raise ConfigError(lines[0], lines)


def _wrong(part: Callable[[], object], origin: str, sumocfg: str | None) -> list[str]:
    """The lines of the mistake that a part of a check finds."""

    def named() -> None:
        with _named(origin, sumocfg):
            part()

    error = _error_of(named)
    return [] if error is None else list(error.every)


def _error_of(part: Callable[[], object]) -> ConfigError | None:
    try:
        part()
    except ConfigError as error:
        return error
    return None


def _try_sumocfg(path: str) -> None:
    """Start SUMO with a .sumocfg. Raises ConfigError."""
    _check_sumocfg(path)
    with _named(path, path):
        candidates(sumocfg_arguments(path, None, ()), 1, patience_s=TRIED_S)


def check_folder(folder: Path) -> None:
    """Raise ConfigError now where the results could not be written later."""
    existing = folder
    while not existing.exists():
        existing = existing.parent
    try:
        if not existing.is_dir():
            raise NotADirectoryError(20, "is a file, not a folder")
        with tempfile.TemporaryFile(dir=existing):
            pass
    except OSError as error:
        raise ConfigError(f"--out {folder}: {existing} {'cannot be written' if existing.is_dir() else error.strerror}") from None


def check_run_folder(folder: Path) -> None:
    """Raise ConfigError now where a run could not be kept later: also where a batch was begun, whose rows and manifest are of one experiment."""
    check_folder(folder)
    for name in (records.ROWS, records.TABLE, records.MANIFEST):
        if os.path.lexists(folder / name) and not (folder / name).is_file():
            raise ConfigError(f"--out {folder}: {name}: is not a file; take another --out")
    for name in (records.TRACES, records.MAPS, records.MANIFESTS, records.FIGURES):
        if os.path.lexists(folder / name) and not (folder / name).is_dir():
            raise ConfigError(f"--out {folder}: {name}: is not a folder; take another --out")
    if batch_folder.holds_batch(folder):
        raise ConfigError(f"--out {folder}: holds a batch; take another --out")


@contextmanager
def _named(origin: str, sumocfg: str | None = None) -> Iterator[None]:
    """Wrong input is named with the file, and in a .sumocfg with the key, that it is about."""
    here = (origin, str(files.absolute(Path(origin))), "--")

    def told(message: str) -> str:
        message += "" if sumocfg is None else key_of_value(sumocfg, message.rpartition(" ")[2])
        return message if message.startswith(here) else f"{origin}: {message}"

    try:
        yield
    except ConfigError as error:
        raise ConfigError(told(str(error)), [told(line) for line in error.every]) from None


def _ego(name: str, until: str | None) -> dict[str, str]:
    return {"id": name} if until is None else {"id": name, "until": until}


def _check_sumocfg(path: str) -> None:
    why = files.problem(path)
    if why:
        raise ConfigError(f"{path}: {why}")
    with _named(path):
        known_roadmap(network_of(path, None))  # SUMO itself does not survive every network


def _first_suitable(sumocfg: str, until: str | None, seed: int | None, sumo_options: Sequence[str]) -> str:
    with _named(sumocfg, sumocfg):
        found = candidates(sumocfg_arguments(sumocfg, seed, sumo_options), SEARCHED, lambda c: c.suitable, until=until)
    if not found or not found[-1].suitable:
        raise ConfigError(
            f"{sumocfg}: --ego any: no suitable vehicle departs{'' if until is None else f' and passes edge {until}'}; without --ego the candidates are listed"
        )
    return found[-1].id


def _forecast_line(scenario: str, rows: Sequence[dict[str, Any]]) -> str:
    def show(key: str, digits: int, factor: float = 1.0) -> str:
        return " ".join("-" if row[key] is None else f"{factor * row[key]:.{digits}f}" for row in rows)

    cells = [show("pairs", 0), show("mean_m", 2), show("p95_m", 2), show("max_m", 2), show("right_lane", 1, 100.0), show("gone", 0)]
    cost = "-" if rows[0]["forecast_ms_p50"] is None else f"{rows[0]['forecast_ms_p50']:.1f}"
    return f"| {scenario} | {rows[0]['prediction']} | {' | '.join(cells)} | {cost} |"


def _summary(row: dict[str, Any]) -> str:
    def show(value: Any, unit: str = "", digits: int = 1) -> str:
        return "-" if value is None else f"{value:.{digits}f}{unit}" if isinstance(value, float) else f"{value}{unit}"

    fault = "" if row["at_fault"] is None else ", at fault" if row["at_fault"] else ", not at fault"
    head = [
        f"{row['scenario']}  ego {printable(row['ego'])}  planner {row['variant']}  seed {show(row['seed'])}",
        f"  outcome      {row['outcome']}{fault}" + (f": {row['error']}" if row["error"] else ""),
    ]
    if row["free_flow_s"] is None:  # it was never on its way
        return "\n".join(head)
    ratio = "" if row["travel_time_s"] is None or not row["free_flow_s"] else f" ({row['travel_time_s'] / row['free_flow_s']:.2f} x free flow)"
    comfortable = None if row["comfortable_share"] is None else 100.0 * row["comfortable_share"]
    comfort = f"strongest braking {show(row['max_decel_mps2'], ' m/s2')}, rms jerk {show(row['rms_jerk_mps3'], ' m/s3')}"
    imposed = f"braking imposed {show(row['imposed_max_decel_mps2'], ' m/s2')}"
    planning = f"{show(row['cycles'])} decisions, {show(row['plan_ms_p50'], ' ms')} (p50) {show(row['plan_ms_p99'], ' ms')} (p99)"
    return "\n".join(
        [
            *head,
            f"  travel time  {show(row['travel_time_s'], ' s')}{ratio}, {show(row['distance_m'], ' m')} driven",
            f"  comfort      {comfort}, {show(comfortable, ' %', 0)} of the time comfortable",
            f"  others       {imposed}, smallest TTC {show(row['min_ttc_s'], ' s')}, PET {show(row['min_pet_s'], ' s')}",
            f"  rules        red lights run {show(row['red_lights_run'])}, speeding {show(row['speeding_share'], '', 3)}",
            f"  planning     {planning}, {show(row['realtime_factor'], ' x real time')}",
            f"  digest       {str(row['trace_digest'])[:16]}",
        ]
    )
