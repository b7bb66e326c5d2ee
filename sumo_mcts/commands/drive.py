"""What the commands do, as plain functions: no printing, no exit codes."""

import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from sumo_mcts import config, records
from sumo_mcts.commands import run_key
from sumo_mcts.config import MOST_SEED, ScenarioConfig, builtin
from sumo_mcts.episode.launch import LaunchOptions
from sumo_mcts.episode.run import EpisodeResult, open_episode
from sumo_mcts.errors import ConfigError, printable
from sumo_mcts.experiments import folder as batch_folder
from sumo_mcts.records.statistics import REDRAWN, TRAFFIC_DIGEST
from sumo_mcts.scenarios import Note, naming_source
from sumo_mcts.studies.regret import Row
from sumo_mcts.world.arguments import draws_seed, is_sumocfg

PATIENCE_S = 20.0  # for another run that writes into the same folder


@contextmanager
def run(
    scenario: ScenarioConfig,
    origin: str,
    seed: int | None,
    gui: bool,
    sumo_options: Sequence[str],
    note: Note,
) -> Iterator[EpisodeResult]:
    """One episode, while SUMO is still there; the default seed is 0, but a .sumocfg keeps its own.

    `origin` stands in error messages. Raises ConfigError.
    """
    if seed is None and scenario.sumo.sumocfg is None:
        seed = 0
    own = _own(scenario, origin)
    with ExitStack() as stack:
        with naming_source(origin, scenario.sumo.sumocfg):
            if seed is None and draws_seed(scenario.sumo):
                seed = secrets.randbelow(MOST_SEED + 1)
                note(f"SUMO's option random is on: --seed {seed} drives this episode again")
            variant = run_key.variant_of(scenario, own, sumo_options)
            options = LaunchOptions(gui, sumo_options, progress=note)
            episode = open_episode(scenario, seed, options, variant=variant)
            result = stack.enter_context(episode)
            further = {
                REDRAWN: result.manifest["redrawn"],
                TRAFFIC_DIGEST: run_key.traffic(scenario, sumo_options),
            }
            manifest = {**result.manifest, **run_key.inputs(scenario, own, sumo_options)}
        result = result._replace(
            rows=tuple({**row, **further} for row in result.rows), manifest=manifest
        )
        yield run_key.keyed(result, scenario.name, named=run_key.is_named(scenario, own))


def _own(scenario: ScenarioConfig, origin: str) -> ScenarioConfig | None:
    """The scenario behind a name or file as it is without what else was asked for;

    None: it cannot stand alone.
    """
    try:
        if not is_sumocfg(origin):
            return config.load(builtin.scenario_path(origin), allow_plugins=True)
        data = {
            "name": scenario.name,
            "sumo": {"sumocfg": scenario.sumo.sumocfg},
            "egos": [{"id": scenario.egos[0].id}],
        }
        return config.build(data, origin)
    except ConfigError:
        return None


def failures(result: EpisodeResult) -> list[str]:
    """A line for each ego whose outcome is `error`."""
    return [
        f"{row['scenario']}: ego {row['ego']}: {row['error']}"
        for row in result.rows
        if row["outcome"] == "error"
    ]


class Kept(NamedTuple):
    """What was kept of a run."""

    result: EpisodeResult  # under the keys that it has in the folder
    remarks: tuple[str, ...]  # for a person: what was replaced, or renamed
    files: tuple[Path, ...]  # what a person wants to open


def keep(result: EpisodeResult, out: Path, command: Sequence[str]) -> Kept:
    """Map, traces, manifests and rows into a folder, and nothing of what is there lost.

    Raises OSError, ConfigError where another run does not finish.
    """
    manifest = {**result.manifest, "command": ["sumo-mcts", *command]}
    with batch_folder.only_here(out, PATIENCE_S):
        there = {row["key"]: row for row in records.read_rows(out)}
        result, remarks = _placed(result, out, there)
        if result.traces and result.road is not None:
            records.save_map(out, result.road)
        (out / records.TRACES).mkdir(exist_ok=True)
        for trace in result.traces:
            records.save_trace(out / records.TRACES / f"{trace.key}.npz", trace)
        batch_folder.drop_traces(
            out, {row["key"] for row in result.rows} - {trace.key for trace in result.traces}
        )
        for row in result.rows:
            records.write_manifest_of(out, row["key"], manifest)
            if records.put_row(out, row):
                remarks.append(f"{out}: {row['key']}: its earlier row is replaced")
                _drop_pictures(out, row, there[row["key"]])
        records.write_csv(out)
        records.write_manifest(out, manifest)
    return Kept(result, tuple(remarks), (out / records.TABLE, out / records.MANIFEST))


def _placed(
    result: EpisodeResult, out: Path, there: Mapping[str, Row]
) -> tuple[EpisodeResult, list[str]]:
    """The result under keys under which the folder holds nothing else, `there` being its rows by
    key, and what to say of that: another scenario of the same name, which has other settings or
    files of its own, keeps its rows."""
    identity, first = result.manifest["identity"], result.rows[0]
    of_name = (
        records.read_manifest_of(out, key).get("identity")
        for key, row in there.items()
        if row["scenario"] == first["scenario"]
    )
    known = next((each for each in of_name if each), identity)
    untold = [
        row
        for row in result.rows
        if row["key"] in there and not records.read_manifest_of(out, row["key"])
    ]
    if known == identity and all(
        there[row["key"]].get("config_digest") == row["config_digest"] for row in untold
    ):
        return result, []
    name = f"{first['scenario']}.{identity[:8]}"
    said = (
        f"{out}: holds another scenario {first['scenario']}, of other settings or files; this "
        f"one is kept as {name}"
    )
    return run_key.keyed(result, name, named=run_key.tells_ego(first)), [said]


def _drop_pictures(out: Path, row: Row, before: Row) -> None:
    """Remove the pictures of an earlier row, unless they show the same drive."""
    if row["trace_digest"] != before.get("trace_digest"):
        for form in ("png", "gif", "mp4"):
            (out / records.FIGURES / f"{row['key']}.{form}").unlink(missing_ok=True)


def draw(result: EpisodeResult, out: Path, note: Note) -> list[Path]:
    """A storyboard and an animation of each ego's drive into a folder; the files.

    Raises OSError.
    """
    from sumo_mcts.reporting import animation, storyboard

    (out / records.FIGURES).mkdir(exist_ok=True)
    shown = []
    for trace in result.traces:
        picture, film = (out / records.FIGURES / f"{trace.key}.{form}" for form in ("png", "gif"))
        note("drawing the storyboard")
        storyboard.storyboard(trace, picture)
        animation.animation(trace, film, note=note)
        shown += [picture, film]
    return shown


def summary_of(row: dict[str, Any]) -> str:
    def show(value: Any, unit: str = "", digits: int = 1) -> str:
        return (
            "-"
            if value is None
            else f"{value:.{digits}f}{unit}"
            if isinstance(value, float)
            else f"{value}{unit}"
        )

    fault = "" if row["at_fault"] is None else ", at fault" if row["at_fault"] else ", not at fault"
    head = [
        (
            f"{row['scenario']}  ego {printable(row['ego'])}  planner {row['variant']}  seed "
            f"{show(row['seed'])}"
        ),
        f"  outcome      {row['outcome']}{fault}" + (f": {row['error']}" if row["error"] else ""),
    ]
    if row["free_flow_s"] is None:  # it was never on its way
        return "\n".join(head)
    ratio = (
        ""
        if row["travel_time_s"] is None or not row["free_flow_s"]
        else f" ({row['travel_time_s'] / row['free_flow_s']:.2f} x free flow)"
    )
    comfortable = None if row["comfortable_share"] is None else 100.0 * row["comfortable_share"]
    comfort = (
        f"strongest braking {show(row['max_decel_mps2'], ' m/s2')}, rms jerk "
        f"{show(row['rms_jerk_mps3'], ' m/s3')}"
    )
    imposed = f"braking imposed {show(row['imposed_max_decel_mps2'], ' m/s2')}"
    planning = (
        f"{show(row['cycles'])} decisions, {show(row['plan_ms_p50'], ' ms')} (p50) "
        f"{show(row['plan_ms_p99'], ' ms')} (p99)"
    )
    return "\n".join(
        [
            *head,
            (
                f"  travel time  {show(row['travel_time_s'], ' s')}{ratio}, "
                f"{show(row['distance_m'], ' m')} driven"
            ),
            f"  comfort      {comfort}, {show(comfortable, ' %', 0)} of the time comfortable",
            (
                f"  others       {imposed}, smallest TTC {show(row['min_ttc_s'], ' s')}, PET "
                f"{show(row['min_pet_s'], ' s')}"
            ),
            (
                f"  rules        red lights run {show(row['red_lights_run'])}, speeding "
                f"{show(row['speeding_share'], '', 3)}"
            ),
            f"  planning     {planning}, {show(row['realtime_factor'], ' x real time')}",
            f"  digest       {str(row['trace_digest'])[:16]}",
        ]
    )
