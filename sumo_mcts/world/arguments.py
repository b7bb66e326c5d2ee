"""SUMO's command line for a scenario: the scenario's files and options, the user's further options,
and what the referee needs."""

import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from sumo_mcts import files
from sumo_mcts.config import MOST_SEED, ScenarioConfig, SumoConfig
from sumo_mcts.errors import ConfigError
from sumo_mcts.world import options as sumo_options
from sumo_mcts.world.crowd import Cast, write_routes
from sumo_mcts.world.options import Given, full_name, option_names
from sumo_mcts.world.simulation import WINDOW_DELAY_MS

DEFAULT_STEP = 0.1  # s

# What the referee judges by; no scenario may set it otherwise.
REFEREE_OPTIONS = {
    "collision.action": "warn",
    "collision.check-junctions": "true",
    "collision.mingap-factor": "0",
}

AFTER_DASHES = "options after --"  # how messages call the user's further options

# A user's option may set anything but these, the referee's and those of the SSM device.
_OURS = ("configuration-file", "net-file", "error-log")
# Root elements of a .sumocfg.
_CONFIGURATIONS = ("configuration", "sumoConfiguration", "sumo-configuration")
_MOST_BYTES = 10_000_000  # of a .sumocfg

_UNWRITTEN = "/dev/null"  # SUMO's own word for no file, on every system
_UNSAVED = {"save-state.times": "", "save-state.period": "-1"}  # SUMO then saves no states

Options = dict[str, str]


def sumo_arguments(
    config: ScenarioConfig,
    seed: int | None,
    cast: Cast,
    folder: Path,
    extra: Sequence[str],
    measured: Iterable[str] = (),
) -> list[str]:
    """The command line, without the program's name.

    Files that SUMO reads or writes for us lie in `folder`; `extra` are the user's further options,
    which go before ours. `measured`: vehicles whose TTC, DRAC and PET SUMO measures. SUMO never
    chooses a seed itself: an episode can be driven again.

    Raises ConfigError where a file is missing or an option contradicts what the referee needs.
    """
    sumo = config.sumo
    require_good(sumo, extra)
    options: Options = (
        {"configuration-file": sumo.sumocfg}
        if sumo.sumocfg is not None
        else {"net-file": str(sumo.net), "time-to-teleport": "-1"}
    )
    if sumo.step_length_s is not None or sumo.sumocfg is None:
        options["step-length"] = str(sumo.step_length_s or DEFAULT_STEP)
    options |= _file_lists(sumo, [str(write_routes(cast, folder))] if cast.actors else [])
    options |= {full_name(key): _text(value) for key, value in sumo.options.items()}
    options |= _seeding(sumo, seed)
    own = {**options, **ssm_options(measured, folder), **REFEREE_OPTIONS}
    given = option_names(extra)
    return [*_flat({key: value for key, value in own.items() if key not in given}), *extra]


def sumocfg_arguments(sumocfg: str, seed: int | None, extra: Sequence[str]) -> list[str]:
    """The command line to look at a .sumocfg, with SUMO driving: it writes none of its files.

    Raises ConfigError.
    """
    sumo = SumoConfig(sumocfg=str(files.absolute(Path(sumocfg))))
    require_good(sumo, extra)
    extra = [*extra, *without_outputs(sumo, extra)]
    given = option_names(extra)
    own = {"configuration-file": str(sumo.sumocfg), **_seeding(sumo, seed), **REFEREE_OPTIONS}
    return [*_flat({key: value for key, value in own.items() if key not in given}), *extra]


def _seeding(sumo: SumoConfig, seed: int | None) -> Options:
    """Options that set the seed, never to one of SUMO's choice; `seed` None: the file's."""
    if seed is not None and seed > MOST_SEED:
        raise ConfigError(f"seed: at most {MOST_SEED}, got {seed}")
    return {
        **({"random": "false"} if draws_seed(sumo) else {}),
        **({} if seed is None else {"seed": str(seed)}),
    }


def _file_lists(sumo: SumoConfig, actors: list[str]) -> Options:
    """Options that name route and additional files, those of the .sumocfg among them: else SUMO
    would forget these. `actors`: route files of ours."""
    result = {}
    for name, paths in (
        ("route-files", [*sumo.routes, *actors]),
        ("additional-files", list(sumo.additional)),
    ):
        if paths:
            result[name] = ",".join([*_named_in(sumo.sumocfg, name), *paths])
    if any("," in path for path in (*sumo.routes, *sumo.additional, *actors)):
        raise ConfigError("sumo.routes: SUMO splits file names at commas; rename the file")
    return result


def ssm_options(vehicles: Iterable[str], folder: Path) -> Options:
    """Options that equip vehicles with SUMO's surrogate safety device, as the referee reads it.

    In a process SUMO keeps to those that it was first given, whatever later simulations ask for.
    """
    named = ",".join(sorted(set(vehicles)))
    if not named:
        return {}
    return {
        "device.ssm.explicit": named,
        "device.ssm.measures": "TTC DRAC PET",
        "device.ssm.thresholds": "3.0 3.0 2.0",
        "device.ssm.range": "60",
        "device.ssm.extratime": "5",
        "device.ssm.file": str(folder / "ssm.xml"),
    }


def without_outputs(sumo: SumoConfig, extra: Sequence[str] = ()) -> list[str]:
    """Options with which SUMO writes no file that its configuration asks for; what `extra` sets
    stays.

    What additional files ask for (detectors) it does write. Raises ConfigError where the .sumocfg
    is none.
    """
    asked = [given.name for given in _own_options(sumo)]
    given = option_names(extra)
    unwritten = {key: _UNWRITTEN for key in asked if sumo_options.writes(key)}
    unsaved = {key: value for key, value in _UNSAVED.items() if key in asked}
    return _flat(
        {key: value for key, value in {**unwritten, **unsaved}.items() if key not in given}
    )


def _flat(options: Mapping[str, str]) -> list[str]:
    """The words of a command line."""
    return [part for name, value in options.items() for part in (f"--{name}", value)]


# --- what a scenario says ---


def is_sumocfg(name: str) -> bool:
    """Whether a file is a configuration of SUMO: by its name, or by its root element, since
    *.sumo.cfg and others are usual too."""
    if name.endswith(".sumocfg"):
        return True
    try:
        return files.xml_root(name) in _CONFIGURATIONS
    except (OSError, ValueError):
        return False


def network_of(sumocfg: str | None, net: str | None) -> str:
    """The network file that a .sumocfg names, or `net` where there is no .sumocfg.

    Raises ConfigError where there is none.
    """
    named = [net] if sumocfg is None else _named_in(sumocfg, "net-file")
    if not named or named[0] is None:
        raise ConfigError(f"{sumocfg}: net-file: not given")
    why = files.problem(named[0])
    if why:
        raise ConfigError(
            f"{'sumo.net' if sumocfg is None else f'{sumocfg}: net-file'}: {named[0]}: {why}"
        )
    return named[0]


def files_of(sumo: SumoConfig) -> list[str]:
    """The files that decide what SUMO simulates: the scenario's, and those that its .sumocfg names.

    Raises ConfigError where the .sumocfg is none.
    """
    named = [
        path
        for name in ("net-file", "route-files", "additional-files")
        for path in _named_in(sumo.sumocfg, name)
    ]
    return [
        path
        for path in (sumo.sumocfg, sumo.net, *sumo.routes, *sumo.additional, *named)
        if path is not None
    ]


def draws_seed(sumo: SumoConfig) -> bool:
    """Whether a scenario asks SUMO to choose a new seed each time."""
    return any(
        given.name == "random" and not sumo_options.is_off(given.value)
        for given in _own_options(sumo)
    )


def window_delay_ms(sumo: SumoConfig) -> float:
    """How long a simulated second is to take at least in SUMO's window, ms, by the scenario or its
    .sumocfg."""
    delays = [
        float(given.value)
        for given in _own_options(sumo)
        if given.name == "delay" and sumo_options.is_number(given.value)
    ]
    return delays[-1] if delays else WINDOW_DELAY_MS


def key_of_value(sumocfg: str, value: str) -> str:
    """The option that a .sumocfg gives this value, as " (key)"; "": there is none.

    SUMO's messages leave it out.
    """
    try:
        return next((f" ({given.name})" for given in _entries(sumocfg) if given.value == value), "")
    except ConfigError:
        return ""


def sumo_home() -> str:
    """The folder of the SUMO that this package comes with, whichever the environment names."""
    import sumo  # type: ignore[import-untyped]

    return str(Path(sumo.__file__).parent)


def sumo_program(name: str) -> str:
    """The path of a program of that SUMO. Raises ConfigError where it is not there."""
    found = shutil.which(name, path=str(Path(sumo_home()) / "bin"))
    if found is None:
        raise ConfigError(f"{name} is not installed; it is part of: pip install eclipse-sumo")
    return found


# --- what is refused ---


def require_good(sumo: SumoConfig, extra: Sequence[str] = ()) -> None:
    """Raise ConfigError where a file is missing or no file, or where an option may not be set, or
    would make SUMO do something else than simulate.

    Looks at the scenario, its .sumocfg, and `extra`, the options after the --.
    """
    require_files(sumo)
    after = sumo_options.on_command_line(extra, AFTER_DASHES)
    own = [Given(full_name(key), _text(value)) for key, value in sumo.options.items()]
    _refuse("sumo.options", own)
    _refuse(AFTER_DASHES, after)
    sources = [(own, Path(), "sumo.options"), (after, Path(), AFTER_DASHES)]
    if sumo.sumocfg is not None:
        sources.append(
            (
                sumo_options.without_window(_entries(sumo.sumocfg)),
                files.absolute(Path(sumo.sumocfg)).parent,
                sumo.sumocfg,
            )
        )
    for given, folder, where in sources:
        sumo_options.require_bearable(given, where)
        sumo_options.require_readable(given, folder, where)


def require_files(sumo: SumoConfig) -> None:
    """Raise ConfigError, with a line for each, where a scenario names files that are none."""
    lines = []
    for key, path in _named_files(sumo):
        try:
            sumo_options.require_file(Path(path), f"sumo.{key}", xml=True)
        except ConfigError as error:
            lines.append(str(error))
    if lines:
        raise ConfigError(lines[0], lines)


def _named_files(sumo: SumoConfig) -> list[tuple[str, str]]:
    """Key and name of each file of a scenario."""
    named = {
        "sumocfg": [sumo.sumocfg],
        "net": [sumo.net],
        "routes": sumo.routes,
        "additional": sumo.additional,
    }
    return [(key, path) for key, paths in named.items() for path in paths if path is not None]


def _refuse(where: str, given: Sequence[Given]) -> None:
    """Raise ConfigError, with `where` in front, where an option is not the user's to set."""
    for name, value in sorted(given):
        if name in REFEREE_OPTIONS:
            raise ConfigError(
                f"{where}: {name}: the referee needs {REFEREE_OPTIONS[name]}; leave it out"
            )
        if name in _OURS or name.startswith("device.ssm."):
            raise ConfigError(f"{where}: {name}: set by sumo_mcts itself; leave it out")
        if name == "random" and not sumo_options.is_off(value):
            raise ConfigError(
                f"{where}: random: an episode has a seed, so that it can be driven again; leave it "
                "out, and give --seed"
            )


# --- reading options ---


def _own_options(sumo: SumoConfig) -> list[Given]:
    """The options of a scenario's .sumocfg, and those that the scenario adds.

    Raises ConfigError where the .sumocfg is none.
    """
    of_file = _entries(sumo.sumocfg) if sumo.sumocfg is not None else []
    return [*of_file, *(Given(full_name(key), _text(value)) for key, value in sumo.options.items())]


def _named_in(sumocfg: str | None, name: str) -> list[str]:
    """The files that a .sumocfg names under an option."""
    if sumocfg is None:
        return []
    folder = files.absolute(Path(sumocfg)).parent
    return [
        str(path)
        for given in _entries(sumocfg)
        if given.name == name
        for path in sumo_options.paths_in(given.value, folder)
    ]


def _entries(sumocfg: str) -> list[Given]:
    """What a .sumocfg sets, variables replaced. Raises ConfigError where it is none."""
    try:
        files.xml_root(sumocfg)  # refuses what only looks small
        root = ElementTree.fromstring(files.content(sumocfg, _MOST_BYTES))
    except OSError as error:
        raise ConfigError(f"{sumocfg}: {error.strerror}") from None
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise ConfigError(f"{sumocfg}: not a SUMO configuration ({error})") from None
    return [
        _entry(element.tag, element.get("value") or element.get("v") or "")
        for element in root.iter()
        if isinstance(element.tag, str)
    ]


def _entry(key: str, value: str) -> Given:
    name, value = full_name(key), sumo_options.expanded(value)
    is_file = sumo_options.reads(name) or sumo_options.writes(name)
    return Given(name, sumo_options.unescaped(value) if is_file else value)


def _text(value: str | float | bool) -> str:
    """A value of a scenario's option as SUMO reads it."""
    return str(value).lower() if isinstance(value, bool) else str(value)
