"""Monte-Carlo tree search drives an ego vehicle through SUMO traffic.

What programs call; docs/api.md has examples.

load_scenario   a built-in scene, a scenario file or a .sumocfg, checked
run_episode     drive it to its end: rows, traces, manifest
run_batch       the episodes of an experiment file, into a folder
Controller      the same driver in a libsumo loop of your own

Each is loaded when it is first used, so that `import sumo_mcts` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sumo_mcts.controller import Controller
    from sumo_mcts.episode import run_episode
    from sumo_mcts.experiments.batch import run_batch
    from sumo_mcts.scenarios import load_scenario

__all__ = ["Controller", "load_scenario", "run_batch", "run_episode"]

_HOMES = {
    "Controller": "sumo_mcts.controller", "load_scenario": "sumo_mcts.scenarios",
    "run_batch": "sumo_mcts.experiments.batch",
    "run_episode": "sumo_mcts.episode.run",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
