"""What a worker of a batch does: drives an episode, tries whether a scenario starts, chooses egos
in a network."""

import math
import signal
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sumo_mcts import records
from sumo_mcts.config import ScenarioConfig, digest
from sumo_mcts.driver.driver import Driver
from sumo_mcts.driver.factories import forecast_label
from sumo_mcts.driver.warmup import warm_up
from sumo_mcts.episode import run_episode
from sumo_mcts.episode.goals import check_edges
from sumo_mcts.episode.launch import LaunchOptions
from sumo_mcts.episode.loop import Loop
from sumo_mcts.errors import ConfigError, of_machine
from sumo_mcts.experiments.experiment import TRAFFIC, Episode
from sumo_mcts.experiments.schema import Egos
from sumo_mcts.numerics.announce import announced, unannounced
from sumo_mcts.records import Row
from sumo_mcts.records.highlights import Bar, is_highlight
from sumo_mcts.records.measures import REDRAWN, TRAFFIC_DIGEST
from sumo_mcts.world.arguments import network_of, sumo_arguments, without_outputs
from sumo_mcts.world.candidates import Candidate, candidates, not_passing
from sumo_mcts.world.crowd import Cast
from sumo_mcts.world.roadmap import known_roadmap

AMONG = 4  # egos are drawn from the first suitable vehicles: so many times the number asked for,
AMONG_LEAST = 100  # but no fewer than these
SOON_S = 30.0  # simulated, for which a check waits for egos
SHORTAGE = "shortage of the machine"  # begins errors that say nothing about their episode


class Driven(NamedTuple):
    """What is left of an episode."""

    rows: tuple[Row, ...]
    traces: dict[str, bytes]  # by key: content of the files of those that may be kept
    maps: dict[str, bytes]  # by name: content of the files of the roads that these refer to


def drive(episode: Episode, bar: Bar) -> Driven:
    """Drive an episode. A failure is its outcome.

    Raises OSError and MemoryError where the machine fails.
    """
    try:
        with unannounced():  # the batch says it
            result = run_episode(
                episode.config,
                episode.seed,
                sumo_options=without_outputs(episode.config.sumo),
                variant=episode.variant,
                measured=episode.measured,
            )
    # libsumo's exceptions share no base, and do not travel between processes
    except Exception as error:
        if of_machine(error):
            raise
        return Driven(failed(episode, f"{type(error).__name__}: {error}"), {}, {})
    key_of = {row["key"]: key for row, key in zip(result.rows, episode.keys, strict=True)}
    further = {
        REDRAWN: result.manifest["redrawn"],
        TRAFFIC_DIGEST: digest(episode.config, TRAFFIC),
    }
    rows = tuple({**row, "key": key_of[row["key"]], **further} for row in result.rows)
    kept = {row["key"] for row in rows if is_highlight(row, bar)}
    traces = [trace._replace(key=key_of[trace.key]) for trace in result.traces]
    traces = [trace for trace in traces if trace.key in kept]
    maps = (
        {}
        if result.road is None
        else {trace.setting.map: records.map_bytes(result.road) for trace in traces[:1]}
    )
    return Driven(rows, {trace.key: records.trace_bytes(trace) for trace in traces}, maps)


def drive_within(seconds: float, episode: Episode, bar: Bar) -> Driven:
    """The same. The operating system ends the process after `seconds`, where it can do that."""
    if not hasattr(signal, "setitimer"):
        return drive(episode, bar)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        return drive(episode, bar)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def of_shortage(row: Row) -> bool:
    """Whether a row reports a shortage of the machine: then its episode is driven again."""
    return str(row.get("error") or "").startswith(SHORTAGE)


def failed(episode: Episode, message: str, *, shortage: bool = False) -> tuple[Row, ...]:
    """The rows of an episode of which only an error is known."""
    config = episode.config
    message = f"{SHORTAGE}: {message}; the same command drives it again" if shortage else message
    known = {
        "scenario": config.name, "variant": episode.variant, "planner": config.planner.name,
        "seed": episode.seed, "outcome": "error", "error": message,
        "prediction": _prediction(config), "config_digest": digest(config), REDRAWN: None,
        TRAFFIC_DIGEST: digest(config, TRAFFIC),
    }  # fmt: skip
    return tuple(
        records.complete_row({**known, "key": key, "ego": ego.id})
        for key, ego in zip(episode.keys, config.egos, strict=True)
    )


def _prediction(config: ScenarioConfig) -> str | None:
    """What the forecast is called, as far as its code can still be loaded."""
    try:
        return forecast_label(config)
    except ConfigError:
        return None


def rehearse(
    config: ScenarioConfig,
    seed: int | None,
    decide: bool = True,
    measured: Sequence[str] = (),
    look: bool = False,
) -> str:
    """Start a scenario, and return what is wrong with the input, "" if nothing.

    decide: compile the search. look: go on to the first decision, even if that is not soon.
    measured: as in run_episode. Raises as `drive` does.
    """
    options = LaunchOptions(sumo_options=without_outputs(config.sumo), measured=measured)
    soon = {ego.id for ego in config.egos} <= {actor.id for actor in config.traffic.actors}
    try:
        with closing(Loop(config, seed, options)) as loop:
            road, physics = loop.world.road, loop.world.physics
            Driver(config, road, physics, 0, loop.oracles)  # plugins check their options
            if decide:
                with announced(_nothing):  # the batch says it
                    warm_up(config, road, physics)
            if look or soon:
                loop.scenes()  # until the egos are taken over
    # libsumo's exceptions share no base, and do not travel between processes
    except Exception as error:
        if of_machine(error):
            raise
        kind = "" if isinstance(error, ConfigError) else f"{type(error).__name__}: "
        return " ".join(f"{kind}{error}".split())
    return ""


def require_starting(config: ScenarioConfig, seed: int | None) -> None:
    """Raise ConfigError where a scenario does not start, or egos that depart soon cannot get to
    their goals."""
    episode = config.episode.model_copy(
        update={"depart_limit_s": min(SOON_S, config.episode.depart_limit_s)}
    )
    problem = rehearse(
        config.model_copy(update={"episode": episode}), seed, decide=False, look=True
    )
    if problem:
        raise ConfigError(problem)


def _nothing(_: str) -> None:
    """Say nothing."""


def choose(config: ScenarioConfig, egos: Egos) -> tuple[str, ...]:
    """The egos of a user's network. Raises ConfigError where there are none such."""
    check_edges(config, known_roadmap(network_of(config.sumo.sumocfg, config.sumo.net)))
    return (
        _drawn(config, egos.random, egos.seed)
        if egos.random is not None
        else _known(config, egos.ids)
    )


def some_egos(config: ScenarioConfig, egos: Egos, patience_s: float) -> tuple[str, ...]:
    """Egos to try a user's network with: those that are named, or the first suitable one.

    None where no suitable one departs within `patience_s`, s of wall time. Raises ConfigError where
    the .sumocfg is none.
    """
    if egos.ids:
        return egos.ids
    found = _look(config, lambda candidate: candidate.suitable, patience_s)
    return tuple(candidate.id for candidate in found if candidate.suitable)


def _drawn(config: ScenarioConfig, count: int, seed: int) -> tuple[str, ...]:
    """So many of the first suitable vehicles, in the order of their departure."""
    enough = max(AMONG * count, AMONG_LEAST)
    suitable: list[str] = []

    def found(candidate: Candidate) -> bool:
        suitable.extend([candidate.id] if candidate.suitable else [])
        return len(suitable) >= enough

    _look(config, found)
    if len(suitable) < count:
        passing = "" if config.egos[0].until is None else f" and pass edge {config.egos[0].until}"
        raise ConfigError(
            f"egos: random: asks for {count}, {len(suitable)} suitable vehicles depart within "
            f"{config.episode.depart_limit_s:g} s{passing}"
        )
    chosen = np.random.default_rng(seed).choice(len(suitable), count, replace=False)
    return tuple(suitable[k] for k in sorted(chosen.tolist()))


def _known(config: ScenarioConfig, ids: Sequence[str]) -> tuple[str, ...]:
    """The ids themselves, if such vehicles depart."""
    missing = set(ids)

    def found(candidate: Candidate) -> bool:
        missing.discard(candidate.id)
        return not missing

    departed, until = _look(config, found), config.egos[0].until
    astray = [
        candidate.id
        for candidate in departed
        if candidate.id in ids and until is not None and candidate.why_not == not_passing(until)
    ]
    if astray:
        raise ConfigError(f"egos: {min(astray)}: until: {not_passing(str(until))}")
    if missing:
        some = ", ".join(candidate.id for candidate in departed[:5]) or "none at all"
        raise ConfigError(
            f"egos: {min(missing)}: no such vehicle departs within "
            f"{config.episode.depart_limit_s:g} s; the first that do: {some}"
        )
    return tuple(ids)


def _look(
    config: ScenarioConfig, found: Callable[[Candidate], bool], patience_s: float = math.inf
) -> list[Candidate]:
    """The vehicles that depart, until `found` returns True, or an episode would wait no longer, or
    `patience_s`, s of wall time, are over."""
    limit = config.episode.depart_limit_s
    with tempfile.TemporaryDirectory(prefix="sumo_mcts-") as folder:
        arguments = sumo_arguments(config, None, Cast(), Path(folder), without_outputs(config.sumo))
        return candidates(
            arguments,
            sys.maxsize,
            found,
            until=config.egos[0].until,
            patience_s=patience_s,
            lasting_s=limit,
        )
