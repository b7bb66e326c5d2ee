"""A junction that the ego can miss: one lane of three turns left to the goal; the others lead round
a longer way."""

from pathlib import Path

from helpers_networks import netconvert

NODES = (
    '<node id="a" x="-300" y="0"/><node id="c" x="0" y="0" type="{kind}"/>'
    '<node id="n" x="0" y="200"/><node id="e" x="200" y="0"/><node id="g" x="0" y="400"/>'
    '<node id="z" x="400" y="0"/>'
)
# `around` leads from `out` to the goal, `back` to where the ego came from, `away` nowhere.
EDGES = "".join(
    f'<edge id="{name}" from="{begin}" to="{end}" numLanes="{lanes}" speed="13.9">{{{name}}}</edge>'
    for name, begin, end, lanes in (
        ("in", "a", "c", 3),
        ("left", "c", "n", 1),
        ("out", "c", "e", 1),
        ("around", "e", "n", 1),
        ("back", "e", "a", 1),
        ("goal", "n", "g", 1),
        ("away", "e", "z", 1),
    )
)
AROUND = (("out", "around", 0), ("around", "goal", 0))
BACK = (("out", "back", 0), ("back", "in", 0))
JOINED = (
    ("in", "out", 0),
    ("in", "out", 1),
    ("in", "left", 2),
    ("left", "goal", 0),
    ("out", "away", 0),
)
# lane changes out of the right lane are forbidden
NO_CHANGE = '<lane index="0" changeLeft="emergency"/>'
# The left lane is full of vehicles that stand there for ever.
QUEUE = "".join(
    f'<vehicle id="b{k}" type="car" depart="0" departLane="2" departPos="{at}" departSpeed="0">'
    f'<route edges="in left"/><stop lane="in_2" startPos="{at - 1}" endPos="{at}" duration="9999"/>'
    "</vehicle>"
    for k, at in enumerate(range(6, 296, 8))
)


def network(
    folder: Path,
    *ways: tuple[tuple[str, str, int], ...],
    kind: str = "priority",
    lanes: str = "",
) -> str:
    """Build the junction with these ways on from `out`; `lanes`: settings of the lanes before it.
    Returns the network file."""
    joined = "".join(
        f'<connection from="{before}" to="{after}" fromLane="{lane}" toLane="0"/>'
        for before, after, lane in (*JOINED, *sum(ways, ()))
    )
    inside = dict.fromkeys(("left", "out", "around", "back", "goal", "away"), "")
    return netconvert(
        folder, NODES.format(kind=kind), EDGES.format(**inside, **{"in": lanes}), joined
    )


def routes(
    folder: Path, inside: str = "", queue: str = QUEUE, begin: str = 'depart="1" departSpeed="max"'
) -> Path:
    """Write the routes of the ego, which begins like this and has its stops `inside`, and of those
    who stand in its way."""
    ego = (
        f'<vehicle id="ego" type="ego_car" departLane="0" {begin}>'
        f'<route edges="in left goal"/>{inside}</vehicle>'
    )
    types = '<vType id="car"/><vType id="ego_car" speedDev="0"/>'
    path = folder / "x.rou.xml"
    path.write_text(f"<routes>{types}{queue}{ego}</routes>")
    return path
