"""Where the built-in networks, routes and configs lie: in a checkout or inside the installed package."""

from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path

from sumo_mcts.config import ConfigError

NAMED = 3  # near names that a message tells

_HERE = Path(__file__).resolve().parent


def root() -> Path:
    """The folder that holds networks/, routes/ and configs/."""
    installed = _HERE / "assets"
    return installed if installed.is_dir() else _HERE.parent


def scenario_names() -> list[str]:
    """The built-in scenarios."""
    return sorted(path.stem for path in (root() / "configs").glob("*.yaml"))


def scenario_path(name_or_path: str) -> Path:
    """The scenario file behind a built-in name or a path. Raises ConfigError."""
    builtin = root() / "configs" / f"{name_or_path}.yaml"
    if builtin.is_file():
        return builtin
    path = Path(name_or_path)
    if path.is_file():
        return path
    raise ConfigError(
        f"{name_or_path}: no such scenario{_near(name_or_path, scenario_names())}; give a .yaml, a .sumocfg, or one of: {', '.join(scenario_names())}"
    )


def experiment_names() -> list[str]:
    """The built-in experiments."""
    return sorted(path.stem for path in (root() / "configs" / "experiments").glob("*.yaml"))


def experiment_path(name_or_path: str) -> Path:
    """The experiment file behind a built-in name or a path. Raises ConfigError."""
    builtin = root() / "configs" / "experiments" / f"{name_or_path}.yaml"
    if builtin.is_file():
        return builtin
    if Path(name_or_path).is_file():
        return Path(name_or_path)
    raise ConfigError(f"{name_or_path}: no such experiment{_near(name_or_path, experiment_names())}; give a .yaml, or one of: {', '.join(experiment_names())}")


def _near(given: str, names: Sequence[str]) -> str:
    """The names, in brackets, that may have been meant."""
    near = get_close_matches(given, names, NAMED, 0.6)
    return f" (near: {', '.join(near)})" if near else ""
