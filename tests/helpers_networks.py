"""Networks made on the spot."""

import subprocess
from pathlib import Path

import sumo


def netconvert(folder: Path, nodes: str, edges: str, connections: str, *options: str) -> str:
    """The network file that netconvert makes of the elements of its three kinds of input."""
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
    subprocess.run([*command, "--no-turnarounds", "true", *options], cwd=folder, check=True, capture_output=True)
    return str(folder / "x.net.xml")
