"""The command run: one episode, with what `run` adds to its rows and manifest."""

import secrets
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

from sumo_mcts import config, records
from sumo_mcts.commands import run_key
from sumo_mcts.config import MOST_SEED, ScenarioConfig, builtin
from sumo_mcts.episode.launch import LaunchOptions
from sumo_mcts.episode.run import EpisodeResult, open_episode
from sumo_mcts.errors import ConfigError
from sumo_mcts.records.measures import REDRAWN, TRAFFIC_DIGEST
from sumo_mcts.scenarios import Note, naming_source
from sumo_mcts.world.arguments import draws_seed, is_sumocfg


@contextmanager
def run(
    scenario: ScenarioConfig,
    origin: str,
    seed: int | None,
    gui: bool,
    sumo_options: Sequence[str],
    note: Note,
    connect: str | None = None,
) -> Iterator[EpisodeResult]:
    """One episode; SUMO is there until the context ends.

    `origin`: the name or file of the scenario, for error messages. `seed`: default 0, but a
    .sumocfg keeps its own. `connect`: host:port of the SUMO to drive in. Raises ConfigError.
    """
    own = _own(scenario, origin)
    with ExitStack() as stack:
        with naming_source(origin, scenario.sumo.sumocfg):
            seed = _seed(scenario, seed, note)
            variant = run_key.variant_of(scenario, own, sumo_options)
            options = LaunchOptions(gui, sumo_options, progress=note, connect=connect)
            episode = open_episode(scenario, seed, options, variant=variant)
            result = stack.enter_context(episode)
            result = _completed(result, scenario, own, sumo_options)
        yield run_key.keyed(result, scenario.name, named=run_key.is_named(scenario, own))


def failures(result: EpisodeResult) -> list[str]:
    """A line for each ego whose outcome is `error`."""
    return [
        f"{row['scenario']}: ego {row['ego']}: {row['error']}"
        for row in result.rows
        if row["outcome"] == "error"
    ]


def document(result: EpisodeResult) -> dict[str, Any]:
    """What `run --json` prints."""
    return {"schema_version": records.SCHEMA_VERSION, "episodes": list(result.rows)}


def _seed(scenario: ScenarioConfig, seed: int | None, note: Note) -> int | None:
    """The seed that drives the episode; None: the .sumocfg's own."""
    if seed is not None:
        return seed
    if scenario.sumo.sumocfg is None:
        return 0
    if not draws_seed(scenario.sumo):
        return None
    drawn = secrets.randbelow(MOST_SEED + 1)
    note(f"SUMO's option random is on: --seed {drawn} drives this episode again")
    return drawn


def _own(scenario: ScenarioConfig, origin: str) -> ScenarioConfig | None:
    """The scenario behind a name or file, without the settings of the command line.

    None where it cannot stand alone.
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


def _completed(
    result: EpisodeResult,
    scenario: ScenarioConfig,
    own: ScenarioConfig | None,
    sumo_options: Sequence[str],
) -> EpisodeResult:
    """The result with what the rows of a batch have too, and with its inputs in the manifest."""
    further = {
        REDRAWN: result.manifest["redrawn"],
        TRAFFIC_DIGEST: run_key.traffic(scenario, sumo_options),
    }
    return result._replace(
        rows=tuple({**row, **further} for row in result.rows),
        manifest={**result.manifest, **run_key.inputs(scenario, own, sumo_options)},
    )
