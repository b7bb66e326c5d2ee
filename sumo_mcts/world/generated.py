"""A situation as files that SUMO reads: netconvert builds the network, in a moment."""

import subprocess
from collections.abc import Sequence
from pathlib import Path

from sumo_mcts import situations
from sumo_mcts.config import SumoConfig
from sumo_mcts.errors import ConfigError
from sumo_mcts.situations import Family, Half, Kind
from sumo_mcts.situations.kind import source
from sumo_mcts.world.arguments import sumo_program

PATIENCE_S = 60.0  # for netconvert, which takes a tenth of a second
LATERAL_M = 0.8  # lateral resolution, where the family of drivers needs one


def standing(sumo: SumoConfig, seed: int | None, folder: Path) -> SumoConfig:
    """The simulation with files in place of a situation; without one, as it is.

    The files of the seed are written into `folder`; seed None: 0. Raises ConfigError.
    """
    if sumo.dense is not None:
        family, half = sumo.dense.family, sumo.dense.half
        paths = _written(situations.DENSE[sumo.dense.kind], half, family, seed or 0, folder)
    elif sumo.rule is not None:
        family = sumo.rule.family
        paths = _written(situations.RULES[sumo.rule.kind], None, family, seed or 0, folder)
    else:
        return sumo
    net, routes = paths
    sublane = family in situations.SUBLANE
    return sumo.model_copy(
        update={
            "dense": None,
            "rule": None,
            "net": str(net),
            "routes": (str(routes), *sumo.routes),
            "options": {**({"lateral-resolution": LATERAL_M} if sublane else {}), **sumo.options},
        }
    )


def _written(
    kind: Kind, half: Half | None, family: Family, seed: int, folder: Path
) -> tuple[Path, Path]:
    """Paths of the network and of the routes."""
    values = situations.drawn(kind, half, seed)
    situation = kind.build(values)
    net, routes = folder / f"{kind.name}.net.xml", folder / f"{kind.name}.rou.xml"
    options = [f"--output-file={net}", *situation.netconvert]
    for option, text in situations.plain_files(situation).items():
        plain = folder / f"{option}.xml"
        plain.write_text(text, encoding="utf-8")
        options.append(f"--{option}={plain}")
    _netconvert(kind.name, options)
    random = source(kind.name, half, seed, "traffic")
    routes.write_text(
        situations.routes(situation, family, values.get("trucks", 0.0), random), encoding="utf-8"
    )
    return net, routes


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
