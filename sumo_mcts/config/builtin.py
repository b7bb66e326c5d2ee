"""The built-in scenarios and experiments: their names and files, in a checkout or inside the
installed package."""

from collections.abc import Sequence
from pathlib import Path

from sumo_mcts import files
from sumo_mcts.errors import ConfigError, near

NAMED = 3  # similar names that a message lists


def root() -> Path:
    """The folder that holds networks/, routes/ and configs/."""
    package = Path(files.__file__).resolve().parent
    installed = package / "assets"
    return installed if installed.is_dir() else package.parent


def scenario_names() -> list[str]:
    """The built-in scenarios."""
    return sorted(path.stem for path in (root() / "configs").glob("*.yaml"))


def scenario_named(name: str) -> Path | None:
    """The file of the built-in scenario of this name; None where there is none."""
    return _of_stem(name, root() / "configs")


def scenario_path(name_or_path: str) -> Path:
    """The scenario file behind a built-in name or a path. Raises ConfigError."""
    choice = (
        f"{_near(name_or_path, scenario_names())}; give a .yaml, a .sumocfg, or one of: "
        f"{', '.join(scenario_names())}"
    )
    return _named(name_or_path, root() / "configs", "scenario", choice)


def experiment_names() -> list[str]:
    """The built-in experiments."""
    return sorted(path.stem for path in (root() / "configs" / "experiments").glob("*.yaml"))


def experiment_path(name_or_path: str) -> Path:
    """The experiment file behind a built-in name or a path. Raises ConfigError."""
    choice = (
        f"{_near(name_or_path, experiment_names())}; give a .yaml, or one of: "
        f"{', '.join(experiment_names())}"
    )
    return _named(name_or_path, root() / "configs" / "experiments", "experiment", choice)


def _named(name_or_path: str, folder: Path, kind: str, choice: str) -> Path:
    """A file of the folder by its stem, or any regular file.

    Raises ConfigError that ends with the `choice` where there is no such file.
    """
    found = _of_stem(name_or_path, folder)
    if found is not None:
        return found
    why = files.problem(name_or_path)
    if why == "no such file":
        raise ConfigError(f"{name_or_path}: no such {kind}{choice}")
    if why:
        raise ConfigError(f"{name_or_path}: {why}{choice}")
    return Path(name_or_path)


def _of_stem(name: str, folder: Path) -> Path | None:
    return next((path for path in folder.glob("*.yaml") if path.stem == name), None)


def _near(given: str, names: Sequence[str]) -> str:
    """The names, in brackets, that may have been meant."""
    found = near(given, names, NAMED, 0.6)
    return f" (near: {', '.join(found)})" if found else ""
