"""A town made up at run time: a grid of streets with signals, full of vehicles."""

import random
import subprocess
from pathlib import Path
from xml.etree import ElementTree

from sumo_mcts.errors import ConfigError
from sumo_mcts.world.arguments import sumo_program

SIDE = 7  # junctions to each side
BLOCK = 100.0  # m
LANES = 2
FILLED_S = 30.0  # s within which the vehicles enter


def write_grid(folder: Path, vehicles: int, ego_departs: float) -> list[str]:
    """Write network and routes for `vehicles` besides the vehicle "ego", which departs at
    `ego_departs` s. Returns SUMO's arguments. Raises ConfigError."""
    net, routes = folder / "grid.net.xml", folder / "grid.rou.xml"
    shape = [
        "--grid",
        "--grid.number",
        str(SIDE),
        "--grid.length",
        str(BLOCK),
        "--default.lanenumber",
        str(LANES),
        "--tls.guess",
        "--no-turnarounds",
    ]
    done = subprocess.run(
        [sumo_program("netgenerate"), *shape, "--output-file", str(net)],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise ConfigError(f"netgenerate fails: {' '.join(done.stderr.split())}")
    _write_trips(routes, _streets(net), vehicles, ego_departs)
    return ["--net-file", str(net), "--route-files", str(routes)]


def _streets(net: Path) -> list[str]:
    return [
        edge.attrib["id"]
        for edge in ElementTree.parse(net).getroot().iter("edge")
        if edge.get("function") != "internal"
    ]


def _write_trips(path: Path, streets: list[str], vehicles: int, ego_departs: float) -> None:
    """Each vehicle drives between two streets drawn at random, the ego from the outside through the
    middle."""
    rng = random.Random(1)
    root = ElementTree.Element("routes")
    for i in range(vehicles):
        origin, target = rng.sample(streets, 2)
        depart = {
            "depart": f"{FILLED_S * i / vehicles:.2f}",
            "departLane": "random",
            "departPos": "random_free",
            "departSpeed": "0",
        }
        via = " ".join(rng.sample(streets, 6))
        ElementTree.SubElement(
            root, "trip", {"id": f"v{i}", "from": origin, "to": target, "via": via, **depart}
        )
    ElementTree.SubElement(
        root,
        "trip",
        {
            "id": "ego",
            "from": "B1B2",
            "to": "E4F4",
            "via": "C2C3 D3D2 B2B3 C3C2",
            "depart": str(ego_departs),
        },
    )
    root[:] = sorted(root, key=lambda trip: float(trip.attrib["depart"]))
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
