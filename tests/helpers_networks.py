"""Makes small networks with netconvert, and runs SUMO in them."""

import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import libsumo
import sumo


def netconvert(folder: Path, nodes: str, edges: str, connections: str, *options: str) -> str:
    """Run netconvert on the XML elements of its three input files. Returns the network file."""
    for name, text in (("nodes", nodes), ("edges", edges), ("connections", connections)):
        (folder / f"{name}.xml").write_text(f"<{name}>{text}</{name}>")
    command = [
        str(Path(sumo.SUMO_HOME) / "bin" / "netconvert"),
        "--offset.disable-normalization",
        "true",
        "-n",
        "nodes.xml",
        "-e",
        "edges.xml",
        "-x",
        "connections.xml",
        "-o",
        "x.net.xml",
    ]
    subprocess.run(
        [*command, "--no-turnarounds", "true", *options],
        cwd=folder,
        check=True,
        capture_output=True,
    )
    return str(folder / "x.net.xml")


@contextmanager
def simulation(
    net: str, routes: Sequence[Path | str], step: float = 0.1, change_s: float = 3.0, seed: int = 1
) -> Iterator[None]:
    """Inside the block SUMO runs with these routes."""
    files = [
        "-n",
        net,
        "-r",
        ",".join(map(str, routes)),
        "--step-length",
        str(step),
        "--lanechange.duration",
        str(change_s),
        "--seed",
        str(seed),
    ]
    libsumo.start(
        [
            "sumo",
            *files,
            "--collision.action",
            "warn",
            "--no-step-log",
            "true",
            "--no-warnings",
            "true",
        ]
    )
    try:
        yield
    finally:
        libsumo.close()
