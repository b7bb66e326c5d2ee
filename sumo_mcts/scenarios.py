"""Finds the scenario behind a name, a file or a .sumocfg: for the command line and for programs."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from os import PathLike, fspath
from pathlib import Path

from sumo_mcts import config, files
from sumo_mcts.config import ScenarioConfig, builtin
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments.batch import built_in
from sumo_mcts.world.arguments import is_sumocfg, key_of_value, network_of, sumocfg_arguments
from sumo_mcts.world.candidates import Candidate, candidates
from sumo_mcts.world.roadmap import known_roadmap

LISTED = 25  # candidates shown
SEARCHED = 100_000  # vehicles checked for `--ego any`
Note = Callable[[str], None]
# Groups of built-in scenarios, in the order in which they are listed, and what they have in common.
GROUPS = {
    "paper": "The paper's scenes; SUMO drives the others",
    "scripted": "The paper's scenes; the others follow their scripts",
    "varied": "The scenes of the paper's table, in traffic drawn by the seed",
    "dense": "Dense traffic, drawn by the seed",
    "rule": "Rules of the road, drawn by the seed",
    "passing": "Slow traffic to pass, drawn by the seed",
}


def load_scenario(
    scenario: str | PathLike[str], *assignments: str, ego: str | Sequence[str] = (),
    until: str | None = None, sumo_options: Sequence[str] = (),
    allow_plugins: bool = False,
) -> ScenarioConfig:  # fmt: skip
    """The scenario behind a built-in name, a scenario file or a .sumocfg, checked and complete with
    defaults.

    assignments: keys to set, "a.b=c", as `--set` does; values are YAML
    ego: vehicle id, or several; default the scenario's own. A .sumocfg has none: it needs an id, or
        "any", the first suitable vehicle
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
    require_egos(name, egos)
    return resolve(name, None, egos, until, assignments, sumo_options, allow_plugins=allow_plugins)


def resolve(
    scenario: str, seed: int | None, egos: Sequence[str], until: str | None,
    overrides: tuple[str, ...], sumo_options: Sequence[str], *,
    allow_plugins: bool = False,
) -> ScenarioConfig:  # fmt: skip
    """The scenario behind a name, a YAML file or a .sumocfg. Raises ConfigError.

    `seed` and `sumo_options`: for the simulation in which --ego any looks for a vehicle.
    """
    if not is_sumocfg(scenario):
        path, changes = builtin.scenario_path(scenario), {}
        if egos or until:
            names = list(egos) or [
                ego.id for ego in config.load(path, overrides, allow_plugins=allow_plugins).egos
            ]
            changes = {"egos": [_ego(name, until) for name in names]}
        return config.load(path, overrides, changes=changes, allow_plugins=allow_plugins)
    check_sumocfg(scenario)
    names = [
        _first_suitable(scenario, until, seed, sumo_options) if name == "any" else name
        for name in egos
    ]
    path = Path(scenario)
    data = {
        "name": config.name_from(path),
        "sumo": {"sumocfg": str(files.absolute(path))},
        "egos": [_ego(name, until) for name in names],
    }
    return config.build(data, scenario, overrides, allow_plugins=allow_plugins)


def resolve_each(
    scenario: str,
    egos: Sequence[str],
    until: str | None,
    overrides: tuple[str, ...],
    sumo_options: Sequence[str] = (),
    *,
    allow_plugins: bool,
) -> list[ScenarioConfig]:
    """The scenario with each ego alone; without `egos` once, with its own together."""
    require_egos(scenario, egos)
    each = [[ego] for ego in egos] or [[]]
    return [
        resolve(scenario, None, names, until, overrides, sumo_options, allow_plugins=allow_plugins)
        for names in each
    ]


def list_candidates(sumocfg: str, seed: int | None, sumo_options: Sequence[str]) -> list[Candidate]:
    """Vehicles that could be the ego, suitable ones first."""
    check_sumocfg(sumocfg)
    with naming_source(sumocfg, sumocfg):
        found = candidates(sumocfg_arguments(sumocfg, seed, sumo_options), 4 * LISTED)
    return sorted(found, key=lambda c: not c.suitable)[:LISTED]


def require_egos(scenario: str, egos: Sequence[str]) -> None:
    """Raise ConfigError where a .sumocfg is given without an ego."""
    if is_sumocfg(scenario) and not egos:
        raise ConfigError(
            f"{scenario}: --ego: not given; `sumo-mcts run {scenario}` lists the candidates"
        )


def listed_scenarios() -> list[dict[str, str]]:
    """Name, description and group of the built-in scenarios, in the order of GROUPS."""
    found = [config.load(builtin.scenario_path(name)) for name in builtin.scenario_names()]
    order = list(GROUPS)
    return [
        {"name": each.name, "description": each.description, "group": group_of(each)}
        for each in sorted(found, key=lambda each: order.index(group_of(each)))
    ]


def group_of(scenario: ScenarioConfig) -> str:
    """The group of GROUPS in which a built-in scenario is listed, by what moves its traffic."""
    if scenario.traffic.crowd.count[1] > 0:
        return "varied"
    drawn = next((kind for kind in GROUPS if getattr(scenario.sumo, kind, None)), "")
    egos = {ego.id for ego in scenario.egos}
    drivers = {actor.driver for actor in scenario.traffic.actors if actor.id not in egos}
    return drawn or ("scripted" if drivers == {"script"} else "paper")


def listed_experiments() -> list[dict[str, str]]:
    """Name and description of the built-in experiments."""
    return built_in()


@contextmanager
def naming_source(origin: str, sumocfg: str | None = None) -> Iterator[None]:
    """Puts the origin in front of every ConfigError that is raised inside.

    Where a value stands in the `sumocfg`, its key there is named too.
    """
    here = (origin, str(files.absolute(Path(origin))), "--")

    def with_source(message: str) -> str:
        message += "" if sumocfg is None else key_of_value(sumocfg, message.rpartition(" ")[2])
        return message if message.startswith(here) else f"{origin}: {message}"

    try:
        yield
    except ConfigError as error:
        raise ConfigError(
            with_source(str(error)), [with_source(line) for line in error.every]
        ) from None


def check_sumocfg(path: str) -> None:
    """Raise ConfigError where a .sumocfg or its network cannot be read."""
    why = files.problem(path)
    if why:
        raise ConfigError(f"{path}: {why}")
    with naming_source(path):
        known_roadmap(network_of(path, None))  # SUMO itself does not survive every network


def _ego(name: str, until: str | None) -> dict[str, str]:
    return {"id": name} if until is None else {"id": name, "until": until}


def _first_suitable(
    sumocfg: str, until: str | None, seed: int | None, sumo_options: Sequence[str]
) -> str:
    with naming_source(sumocfg, sumocfg):
        found = candidates(
            sumocfg_arguments(sumocfg, seed, sumo_options),
            SEARCHED,
            lambda c: c.suitable,
            until=until,
        )
    if not found or not found[-1].suitable:
        raise ConfigError(
            f"{sumocfg}: --ego any: no suitable vehicle "
            f"departs{'' if until is None else f' and passes edge {until}'}; without --ego the "
            "candidates are listed"
        )
    return found[-1].id
