"""Makes small networks with netconvert, and runs SUMO in them."""

import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import libsumo
import sumo

ENDS = {"w": (-1, 0), "s": (0, -1), "e": (1, 0), "n": (0, 1)}  # of a crossing, counterclockwise
FAR = 120.0  # m to the ends


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


def four_arms(folder: Path, control: str, *options: str) -> str:
    """Four arms of one lane each way; with `priority` the road from west to east has it. Returns
    the network file."""
    nodes, roads = f'<node id="c" x="0" y="0" type="{control}"/>', ""
    for name, (x, y) in ENDS.items():
        nodes += f'<node id="{name}" x="{FAR * x}" y="{FAR * y}"/>'
        more = f'speed="13.9" priority="{3 if control == "priority" and name in "we" else 1}"'
        roads += f'<edge id="{name}c" from="{name}" to="c" {more}/>'
        roads += f'<edge id="c{name}" from="c" to="{name}" {more}/>'
    return netconvert(folder, nodes, roads, "", *options)


def car(route: str, place: float, stops: str = "") -> str:
    """A vehicle, named after the arm that it comes from."""
    way = f'<route edges="{route[0]}c c{route[1]}"/>'
    begins = f'depart="0" departPos="{place}" departSpeed="8"'
    return f'<vehicle id="{route[0]}" type="car" {begins}>{way}{stops}</vehicle>'


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
