"""SUMO's command line for a scenario: the scenario's files and options, the user's further options, and what the referee needs."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from sumo_mcts.config import ConfigError, ScenarioConfig, SumoConfig
from sumo_mcts.world.crowd import Cast, write_routes
from sumo_mcts.world.simulation import full_name, option_names

DEFAULT_STEP = 0.1  # s

# What the referee judges by; no scenario may set it otherwise.
REFEREE_OPTIONS = {"collision.action": "warn", "collision.check-junctions": "true", "collision.mingap-factor": "0"}

_OURS = ("configuration-file", "net-file", "error-log")  # an option after -- may set anything but these and the referee's

# Options by which SUMO writes a file, and what makes it write none.
_WRITES = re.compile(
    r".*[-.]output|netstate-dump|ndump|netstate|person-fcd|summary|tripinfo|personinfo|vehroutes|personroutes|log|log-file|l|message-log|device\.toc\.file"
)
_UNWRITTEN = "/dev/null"  # SUMO's own word for it, on every system
_UNSAVED = {"save-state.times": "", "save-state.period": "-1"}

Options = dict[str, str]


def sumo_arguments(config: ScenarioConfig, seed: int | None, cast: Cast, folder: Path, extra: Sequence[str], measured: Iterable[str] = ()) -> list[str]:
    """The command line, without the program's name. Files that SUMO reads or writes for us lie in `folder`; `extra` is written by the user as it stands.
    `measured`: vehicles whose TTC, DRAC and PET SUMO tells.

    Raises ConfigError where a file is missing or an option contradicts what the referee needs.
    """
    sumo, given = config.sumo, option_names(extra)
    _check_files(sumo)
    options: Options = {"configuration-file": sumo.sumocfg} if sumo.sumocfg is not None else {"net-file": str(sumo.net), "time-to-teleport": "-1"}
    if sumo.step_length_s is not None or sumo.sumocfg is None:
        options["step-length"] = str(sumo.step_length_s or DEFAULT_STEP)
    options |= _file_lists(sumo, [str(write_routes(cast, folder))] if cast.actors else [])
    options |= {full_name(key): _text(value) for key, value in sumo.options.items()}
    if seed is not None:
        options["seed"] = str(seed)
    _refuse("sumo.options", {full_name(key) for key in sumo.options}, ())
    _refuse("options after --", given, _OURS)
    own = {**options, **ssm_options(measured, folder), **REFEREE_OPTIONS}
    return [*_flat({key: value for key, value in own.items() if key not in given}), *extra]


def sumocfg_arguments(sumocfg: str, seed: int | None, extra: Sequence[str]) -> list[str]:
    """The command line of a look at a .sumocfg, with SUMO driving, that writes none of its files."""
    extra = [*extra, *without_outputs(SumoConfig(sumocfg=sumocfg), extra)]
    given = option_names(extra)
    own = {"configuration-file": str(Path(sumocfg).resolve()), **({} if seed is None else {"seed": str(seed)}), **REFEREE_OPTIONS}
    return [*_flat({key: value for key, value in own.items() if key not in given}), *extra]


def without_outputs(sumo: SumoConfig, extra: Sequence[str] = ()) -> list[str]:
    """Options after which SUMO writes nothing of what its configuration asks for, `extra` left as it is. What additional files ask for (detectors) it
    does write. Raises ConfigError where the .sumocfg is none."""
    asked = [*([key for key, _ in _entries(sumo.sumocfg)] if sumo.sumocfg is not None else []), *sumo.options]
    given = option_names(extra)
    unwritten = {key: _UNWRITTEN for key in asked if _WRITES.fullmatch(key)}
    unsaved = {key: value for key, value in _UNSAVED.items() if key in asked}
    return _flat({key: value for key, value in {**unwritten, **unsaved}.items() if full_name(key) not in given})


def network_of(sumocfg: str | None, net: str | None) -> str:
    """The network file of a .sumocfg, or the one given. Raises ConfigError where there is none."""
    named = [net] if sumocfg is None else _named_in(sumocfg, "net-file")
    if not named or named[0] is None:
        raise ConfigError(f"{sumocfg}: net-file: not given")
    if not Path(named[0]).is_file():
        raise ConfigError(f"{'sumo.net' if sumocfg is None else f'{sumocfg}: net-file'}: {named[0]}: no such file")
    return named[0]


def files_of(sumo: SumoConfig) -> list[str]:
    """The files that decide what SUMO simulates: those of the scenario, and those that its .sumocfg names. Raises ConfigError where that is none."""
    named = [path for name in ("net-file", "route-files", "additional-files") for path in _named_in(sumo.sumocfg, name)]
    return [path for path in (sumo.sumocfg, sumo.net, *sumo.routes, *sumo.additional, *named) if path is not None]


def sumo_home() -> str:
    """The folder of the SUMO that this package comes with, whatever another one the environment names."""
    import sumo  # type: ignore[import-untyped]

    return str(Path(sumo.__file__).parent)


def ssm_options(vehicles: Iterable[str], folder: Path) -> Options:
    """Options that equip vehicles with SUMO's surrogate safety device, as the referee reads it; none for none. In a process SUMO keeps to those that it was
    first given, whatever later simulations ask for."""
    named = ",".join(sorted(set(vehicles)))
    return {} if not named else {
        "device.ssm.explicit": named, "device.ssm.measures": "TTC DRAC PET", "device.ssm.thresholds": "3.0 3.0 2.0",
        "device.ssm.range": "60", "device.ssm.extratime": "5", "device.ssm.file": str(folder / "ssm.xml"),
    }  # fmt: skip


def _check_files(sumo: SumoConfig) -> None:
    named = {"sumocfg": [sumo.sumocfg], "net": [sumo.net], "routes": sumo.routes, "additional": sumo.additional}
    for key, paths in named.items():
        for path in paths:
            if path is not None and not Path(path).is_file():
                raise ConfigError(f"sumo.{key}: {path}: no such file")


def _refuse(where: str, given: set[str], further: Sequence[str]) -> None:
    """An option that is not the user's to set."""
    for name in sorted(given):
        if name in REFEREE_OPTIONS:
            raise ConfigError(f"{where}: {name}: the referee needs {REFEREE_OPTIONS[name]}; leave it out")
        if name in further or name.startswith("device.ssm."):
            raise ConfigError(f"{where}: {name}: set by the scenario; leave it out")


def _file_lists(sumo: SumoConfig, actors: list[str]) -> Options:
    """Route and additional files. SUMO would forget those that a .sumocfg names where it is given others."""
    result = {}
    for name, paths in (("route-files", [*sumo.routes, *actors]), ("additional-files", list(sumo.additional))):
        if paths:
            result[name] = ",".join([*_named_in(sumo.sumocfg, name), *paths])
    if any("," in path for path in (*sumo.routes, *sumo.additional, *actors)):
        raise ConfigError("sumo.routes: SUMO splits file names at commas; rename the file")
    return result


def key_of_value(sumocfg: str, value: str) -> str:
    """ " (key)" of the option that a .sumocfg gives this value, which SUMO's complaints leave out; "" where there is none."""
    keys = [key for key, given in _entries(sumocfg) if given == value] if Path(sumocfg).is_file() else []
    return f" ({keys[0]})" if keys else ""


def _named_in(sumocfg: str | None, name: str) -> list[str]:
    """The files that a .sumocfg names under an option."""
    if sumocfg is None:
        return []
    values = [value for key, value in _entries(sumocfg) if full_name(key) == name]
    return [str(Path(sumocfg).resolve().parent / part.strip()) for value in values for part in value.split(",") if part.strip()]


def _entries(sumocfg: str) -> list[tuple[str, str]]:
    """Keys and values of a .sumocfg. Raises ConfigError where it is none."""
    try:
        root = ElementTree.parse(sumocfg).getroot()
    except (ElementTree.ParseError, OSError) as error:
        raise ConfigError(f"{sumocfg}: not a SUMO configuration ({error})") from None
    return [(element.tag, element.get("value") or element.get("v") or "") for element in root.iter()]


def _text(value: str | float | bool) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _flat(options: Mapping[str, str]) -> list[str]:
    return [part for name, value in options.items() for part in (f"--{name}", value)]
