"""The command validate: finds every mistake in scenarios, experiments and .sumocfg files."""

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from sumo_mcts import config
from sumo_mcts.config import ScenarioConfig
from sumo_mcts.driver.factories import make_planner, make_predictor
from sumo_mcts.driver.params import cost_params
from sumo_mcts.episode.goals import check_edges
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments import tasks
from sumo_mcts.experiments.batch import tried
from sumo_mcts.experiments.schema import is_experiment
from sumo_mcts.scenarios import check_sumocfg, naming_source
from sumo_mcts.world import crowd, scripts
from sumo_mcts.world.arguments import is_sumocfg, network_of, require_good, sumocfg_arguments
from sumo_mcts.world.candidates import candidates
from sumo_mcts.world.generated import standing
from sumo_mcts.world.roadmap import known_roadmap

TRIED_S = 7.0  # wall time that a check may take once SUMO runs


def problems_of(path: Path, *, allow_plugins: bool = False) -> list[str]:
    """A line for each mistake in a scenario file, a .sumocfg or an experiment; none where it can be
    driven.

    SUMO is started, no planner decides. Plugins are made, so that they check their options.
    """
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
    """A line for each mistake in a scenario whose values are right one by one.

    SUMO is started last, where nothing else is wrong.
    """
    sumocfg = scenario.sumo.sumocfg
    seed = 0 if sumocfg is None else None
    plugins: list[Callable[[], object]] = [
        lambda: make_planner(scenario),
        lambda: make_predictor(scenario),
        lambda: cost_params(scenario),
    ]
    found = [line for part in plugins for line in _wrong(part, origin, sumocfg)]
    for part in (
        lambda: require_good(scenario.sumo),
        lambda: _require_fit(scenario),
        lambda: tasks.require_starting(scenario, seed),
    ):
        wrong = _wrong(part, origin, sumocfg)
        if wrong:  # the next part needs what this one checks
            return [*found, *wrong]
    return found


def _require_fit(scenario: ScenarioConfig) -> None:
    """Raise ConfigError, with a line for each mistake, where the scenario does not fit its
    network."""
    with tempfile.TemporaryDirectory(prefix="sumo_mcts-") as folder:
        sumo = standing(scenario.sumo, 0, Path(folder))
        road = known_roadmap(network_of(sumo.sumocfg, sumo.net))
    parts = [
        partial(check_edges, scenario.model_copy(update={"egos": (ego,)}), road)
        for ego in scenario.egos
    ]
    parts += [partial(scripts.check, actor, road) for actor in scenario.traffic.actors]
    parts += [
        partial(crowd.check_stream, k, stream, road)
        for k, stream in enumerate(scenario.traffic.crowd.streams)
    ]
    lines = [str(error) for error in map(_error_of, parts) if error is not None]
    if lines:
        raise ConfigError(lines[0], lines)


def _wrong(part: Callable[[], object], origin: str, sumocfg: str | None) -> list[str]:
    """The lines of the mistake that a part of the check finds, with the source in front."""

    def named() -> None:
        with naming_source(origin, sumocfg):
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
    check_sumocfg(path)
    with naming_source(path, path):
        candidates(sumocfg_arguments(path, None, ()), 1, patience_s=TRIED_S)
