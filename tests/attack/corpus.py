"""All kinds of wrong inputs by name."""

from collections.abc import Callable, Iterable, Mapping

from .case import Case
from .kinds import (
    environment,
    experiments,
    interruptions,
    numbers,
    options,
    records,
    scenarios,
    special_files,
    streams,
    sumo_files,
)

KINDS: Mapping[str, Callable[[], Iterable[Case]]] = {
    "yaml": scenarios.yaml_cases,
    "scenario": scenarios.key_cases,
    "number": numbers.cases,
    "experiment": experiments.cases,
    "set": options.set_cases,
    "option": options.cases,
    "sumo-option": options.sumo_option_cases,
    "sumocfg": sumo_files.configuration_cases,
    "network": sumo_files.network_cases,
    "traffic": sumo_files.traffic_cases,
    "environment": environment.cases,
    "special-file": special_files.cases,
    "stream": streams.stream_cases,
    "disk": streams.disk_cases,
    "archive": records.archive_cases,
    "record": records.row_cases,
    "interruption": interruptions.cases,
}


def cases(kind: str) -> list[Case]:
    """The cases of a kind."""
    return list(KINDS[kind]())
