"""A situation as files that SUMO reads: netconvert builds the network, in a moment."""

import subprocess
from collections.abc import Sequence
from pathlib import Path

from sumo_mcts import situations
from sumo_mcts.config import SumoConfig
from sumo_mcts.errors import ConfigError
from sumo_mcts.situations import Half, Situation
from sumo_mcts.situations.kind import source
from sumo_mcts.world.arguments import sumo_program

PATIENCE_S = 60.0  # for netconvert, which takes a tenth of a second
LATERAL_M = 0.8  # lateral resolution, where the family of drivers needs one


def standing(sumo: SumoConfig, seed: int | None, folder: Path) -> SumoConfig:
    """The simulation with files in place of a situation; without one, as it is.

    The files of the seed are written into `folder`; seed None: 0. Raises ConfigError.
    """
    half: Half | None = None
    if sumo.dense is not None:
        kind, family, half = situations.DENSE[sumo.dense.kind], sumo.dense.family, sumo.dense.half
    elif sumo.rule is not None:
        kind, family = situations.RULES[sumo.rule.kind], sumo.rule.family
    elif sumo.passing is not None:
        kind, family = situations.PASSING[sumo.passing.kind], sumo.passing.family
    else:
        return sumo
    values = situations.drawn(kind, half, seed or 0)
    situation = kind.build(values)
    net = _network(kind.name, situation, folder)
    routes = folder / f"{kind.name}.rou.xml"
    random = source(kind.name, half, seed or 0, "traffic")
    trucks = values.get("trucks", 0.0)
    routes.write_text(situations.routes(situation, family, trucks, random), encoding="utf-8")
    lateral = situation.lateral or (LATERAL_M if family in situations.SUBLANE else 0.0)
    return sumo.model_copy(
        update={
            "dense": None,
            "rule": None,
            "passing": None,
            "net": str(net),
            "routes": (str(routes), *sumo.routes),
            "options": {**({"lateral-resolution": lateral} if lateral else {}), **sumo.options},
        }
    )


def _network(name: str, situation: Situation, folder: Path) -> Path:
    """Path of the network that netconvert builds of a situation. Raises ConfigError."""
    net = folder / f"{name}.net.xml"
    options = [f"--output-file={net}", *situation.netconvert]
    for option, text in situations.plain_files(situation).items():
        plain = folder / f"{option}.xml"
        plain.write_text(text, encoding="utf-8")
        options.append(f"--{option}={plain}")
    _netconvert(name, options)
    return net


def _netconvert(name: str, options: Sequence[str]) -> None:
    """Build a network. Raises ConfigError."""
    program = sumo_program("netconvert")
    command = [program, "--no-turnarounds=true", "--junctions.corner-detail=5", *options]
    try:
        done = subprocess.run(
            command, check=False, capture_output=True, text=True, timeout=PATIENCE_S
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ConfigError(f"situation {name}: netconvert: {error}") from None
    if done.returncode != 0:
        lines = [line for line in done.stderr.splitlines() if line.startswith("Error")]
        raise ConfigError(f"situation {name}: netconvert: {' '.join(lines) or 'failed'}")
