"""Monte-Carlo tree search drives an ego vehicle through SUMO traffic.

What programs call; docs/api.md has examples.

load_scenario   a built-in scene, a scenario file or a .sumocfg, checked
run_episode     drive it to its end: rows, traces, manifest
run_batch       the episodes of an experiment file, into a folder
Controller      the same driver in a libsumo loop of your own
ConfigError     wrong input
BatchError      a batch that could not go on
__version__     the version that is installed

Each is loaded when it is first used, so that `import sumo_mcts` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sumo_mcts.controller import Controller
    from sumo_mcts.episode import run_episode
    from sumo_mcts.errors import ConfigError
    from sumo_mcts.experiments.batch import run_batch
    from sumo_mcts.experiments.problems import BatchError
    from sumo_mcts.scenarios import load_scenario

    __version__: str

__all__ = [
    "BatchError", "ConfigError", "Controller", "__version__", "load_scenario", "run_batch",
    "run_episode",
]  # fmt: skip

_HOMES = {
    "BatchError": "sumo_mcts.experiments.problems", "ConfigError": "sumo_mcts.errors",
    "Controller": "sumo_mcts.controller", "load_scenario": "sumo_mcts.scenarios",
    "run_batch": "sumo_mcts.experiments.batch",
    "run_episode": "sumo_mcts.episode.run",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("importlib.metadata").version("sumo-mcts")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
