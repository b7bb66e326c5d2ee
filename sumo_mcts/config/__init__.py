"""Scenario files: read, checked, complete with defaults. What other packages need of it.

schema.py       what a scenario file may say; its sections lie in sections/
loading.py      from a file, or a mapping, to a ScenarioConfig
problems.py     the words for what is wrong
names.py        the names of planners, predictors and cost terms
plugins.py      the code behind the names of plugins
builtin.py      the scenarios and experiments of the package
docs.py         the tables of docs/scenario-file.md
"""

from sumo_mcts.config.loading import (
    build,
    digest,
    json_schema,
    load,
    name_from,
    parsed,
    plugin_names,
    require_permission,
    require_scenario,
)
from sumo_mcts.config.names import PLANNER_GROUP, is_plugin
from sumo_mcts.config.problems import positive, refused, whole
from sumo_mcts.config.schema import ScenarioConfig
from sumo_mcts.config.sections.perception import SensorConfig
from sumo_mcts.config.sections.simulation import DenseConfig, EgoConfig, SumoConfig
from sumo_mcts.config.sections.traffic import (
    CROWD_ID,
    Actor,
    CrowdConfig,
    Depart,
    DriversConfig,
    Event,
    Stream,
    TrafficConfig,
    VehicleEvent,
)
from sumo_mcts.config.values import MOST_SEED, Flag, Id
from sumo_mcts.errors import ConfigError

__all__ = [
    "CROWD_ID",
    "MOST_SEED",
    "PLANNER_GROUP",
    "Actor",
    "ConfigError",
    "CrowdConfig",
    "DenseConfig",
    "Depart",
    "DriversConfig",
    "EgoConfig",
    "Event",
    "Flag",
    "Id",
    "ScenarioConfig",
    "SensorConfig",
    "Stream",
    "SumoConfig",
    "TrafficConfig",
    "VehicleEvent",
    "build",
    "digest",
    "is_plugin",
    "json_schema",
    "load",
    "name_from",
    "parsed",
    "plugin_names",
    "positive",
    "refused",
    "require_permission",
    "require_scenario",
    "whole",
]
