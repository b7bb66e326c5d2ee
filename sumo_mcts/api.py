"""For programs: scenarios as the command line finds them."""

from collections.abc import Sequence
from os import PathLike, fspath

from sumo_mcts import commands
from sumo_mcts.config import ConfigError, ScenarioConfig


def load_scenario(
    scenario: str | PathLike[str], *assignments: str, ego: str | Sequence[str] = (), until: str | None = None, sumo_options: Sequence[str] = (),
    allow_plugins: bool = False,
) -> ScenarioConfig:  # fmt: skip
    """The scenario behind a built-in name, a scenario file or a .sumocfg, checked and complete with defaults.

    assignments: keys to set, "a.b=c", as `--set` does; values are YAML
    ego: vehicle id, or several; a .sumocfg needs one, or "any", the first suitable vehicle; elsewhere default the scenario's own
    until: id of the edge at whose end the goal is; default the end of the ego's route
    sumo_options: as on SUMO's command line; where "any" looks for a vehicle
    allow_plugins: whether the scenario may name code of your own as module:name

    Raises ConfigError: one line that names the file, the key and what is allowed.
    """
    if not isinstance(scenario, str | PathLike):
        raise ConfigError(f"load_scenario: scenario: a name or a path, got {scenario!r:.60}")
    egos = tuple(ego) if isinstance(ego, list | tuple) else (ego,)
    for key, given in (("assignments", assignments), ("ego", egos)):
        for each in given:
            if not isinstance(each, str):
                raise ConfigError(f"load_scenario: {key}: a text, got {each!r:.60}")
    name = fspath(scenario)
    commands.require_egos(name, egos)
    return commands.resolve(name, None, egos, until, assignments, sumo_options, allow_plugins=allow_plugins)
