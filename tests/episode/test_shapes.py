"""Networks of unusual shape: the ego arrives without fault, about as fast as SUMO's own driver."""

import itertools
from pathlib import Path

import pytest
from helpers_pairs import Case, drives_as_its_twin

# Two roads that merge; their lanes are four times as long as they are drawn.
SQUEEZED = Case(
    nodes='<node id="a" x="0" y="0"/><node id="b" x="60" y="0"/><node id="c" x="120" y="0"/>'
    '<node id="d" x="60" y="60"/>',
    edges='<edge id="ab" from="a" to="b" length="200" numLanes="2" priority="2"/>'
    '<edge id="bc" from="b" to="c" length="200" numLanes="2" priority="2"/>'
    '<edge id="db" from="d" to="b" length="200" priority="1"/>',
    connections="",
    routes='<vType id="car"/>'
    '<flow id="f" type="car" begin="0" end="60" period="4" departLane="best" departSpeed="max">'
    '<route edges="ab bc"/></flow>'
    '<flow id="g" type="car" begin="0" end="60" period="6" departSpeed="max">'
    '<route edges="db bc"/></flow>'
    '<vehicle id="ego" type="car" depart="40" departSpeed="max"><route edges="db bc"/></vehicle>',
)
# In the middle of a road all vehicles stand for a while, on a lane drawn at a fifth of its length.
QUEUE = Case(
    nodes='<node id="a" x="0" y="0"/><node id="b" x="40" y="0"/><node id="c" x="80" y="0"/>',
    edges='<edge id="ab" from="a" to="b" length="200"/><edge id="bc" from="b" to="c" length="200"/>',
    connections="",
    routes='<vType id="car"/><route id="r" edges="ab bc"/>'
    '<vehicle id="v0" type="car" route="r" depart="0" departPos="180">'
    '<stop lane="bc_0" startPos="10" endPos="20" duration="30"/></vehicle>'
    + "".join(
        f'<vehicle id="v{k}" type="car" route="r" depart="0" departPos="{180 - 10 * k}"/>'
        for k in range(1, 6)
    )
    + '<vehicle id="ego" type="car" route="r" depart="0" departPos="100"/>',
)


@pytest.mark.slow
@pytest.mark.parametrize("case", [SQUEEZED, QUEUE], ids=["merging", "queue"])
def test_lanes_longer_than_they_are_drawn(case: Case, tmp_path: Path) -> None:
    ego = drives_as_its_twin(tmp_path, case)
    assert ego["max_decel_mps2"] < 4.6 and ego["imposed_max_decel_mps2"] < 4.6


ARMS = {"w": (-120, 0, 3), "e": (120, 0, 3), "n": (0, 120, 1), "s": (0, -120, 1)}
STEP = '<step-length value="0.5"/>'


def flow(name: str, route: str, period: float) -> str:
    return (
        f'<flow id="{name}" begin="0" end="25" period="{period}" departLane="best" '
        f'departSpeed="max"><route edges="{route}"/></flow>'
    )


def crossing(
    route: str, *options: str, lane: str = "", kind: str = "", sumo: str = STEP, ego: str = ""
) -> Case:
    """A crossing of two roads of two lanes, the one from west to east first; the ego drives a route
    over it.

    `lane`: attributes of each edge, `kind`: of the ego's type, `ego`: instead of the ego.
    """
    usual = (
        '<vehicle id="ego" type="own" depart="15" departLane="best" departSpeed="max">'
        f'<route edges="{route}"/></vehicle>'
    )
    return Case(
        nodes='<node id="c" x="0" y="0" type="priority"/>'
        + "".join(f'<node id="{arm}" x="{x}" y="{y}"/>' for arm, (x, y, _) in ARMS.items()),
        edges="".join(
            f'<edge id="{a}{b}" from="{a}" to="{b}" numLanes="2" priority="{rank}" {lane}/>'
            for arm, (_, _, rank) in ARMS.items()
            for a, b in ((arm, "c"), ("c", arm))
        ),
        connections="",
        routes=f'<vType id="own" {kind}/>'
        + flow("f0", "wc ce", 6)
        + flow("f1", "ec cw", 7)
        + flow("f2", "nc cs", 8)
        + (ego or usual),
        netconvert=options,
        sumo=sumo,
    )


def road(*x: tuple[float, float], route: str = "", ego: str = "", extra: str = "") -> Case:
    """A road of two lanes over places (x, z), m."""
    names = "abcdefgh"[: len(x)]
    whole = route or " ".join(map("".join, itertools.pairwise(names)))
    usual = f'<vehicle id="ego" depart="5" departLane="best"><route edges="{whole}"/></vehicle>'
    return Case(
        nodes="".join(
            f'<node id="{name}" x="{at}" y="0" z="{z}"/>'
            for name, (at, z) in zip(names, x, strict=True)
        ),
        edges="".join(
            f'<edge id="{a}{b}" from="{a}" to="{b}" numLanes="2"/>'
            for a, b in itertools.pairwise(names)
        ),
        connections="",
        routes=extra + flow("f", whole, 5) + (ego or usual),
    )


LOOP = Case(
    nodes='<node id="a" x="0" y="0"/><node id="b" x="80" y="0"/><node id="c" x="160" y="0"/>'
    '<node id="d" x="160" y="80"/><node id="e" x="80" y="80"/><node id="x" x="120" y="-80"/>',
    edges="".join(
        f'<edge id="{a}{b}" from="{a}" to="{b}"/>' for a, b in ("ab", "bc", "cd", "de", "eb", "bx")
    ),
    connections="",
    routes=flow("f", "ab bc cd de eb bx", 7)
    + '<vehicle id="ego" depart="10"><route edges="ab bc cd de eb bc cd de eb bx"/></vehicle>',
)
DEAD_END = Case(
    nodes='<node id="a" x="0" y="0"/><node id="b" x="150" y="0"/>',
    edges='<edge id="ab" from="a" to="b"/><edge id="ba" from="b" to="a"/>',
    connections='<connection from="ab" to="ba" fromLane="0" toLane="0"/>',
    routes=flow("f", "ab ba", 8)
    + '<vehicle id="ego" depart="10" departSpeed="max"><route edges="ab ba"/></vehicle>',
)
CASES = {
    "on-the-left": crossing("sc cw", "--lefthand", "true"),
    "waits-in-the-middle": crossing("wc cn"),
    "sidewalk": crossing("wc cn", "--sidewalks.guess", "true", "--crossings.guess", "true"),
    "without-lanes-inside": crossing("wc ce", "--no-internal-links", "true"),
    "ballistic": crossing(
        "sc cw", sumo='<step-length value="1"/><step-method.ballistic value="true"/>'
    ),
    "short-steps": crossing("sc cn", sumo='<step-length value="0.05"/>'),
    "semitrailer": crossing(
        "sc cn", kind='vClass="trailer" guiShape="truck/semitrailer" length="16.5"'
    ),
    "bus": crossing("sc cw", kind='vClass="bus"'),
    "bicycle": crossing("sc cn", kind='vClass="bicycle"'),
    "trip": crossing("", ego='<trip id="ego" depart="15" from="sc" to="ce"/>'),
    "longer-than-drawn": crossing("sc cw", lane='length="300"'),
    "longer-than-drawn-1-s": crossing("sc cw", lane='length="300"', sumo=""),
    "shorter-than-drawn": crossing("wc cn", lane='length="60"'),
    "hills": road((0, 0), (100, 10), (200, 0)),
    "below-a-metre": road((0, 0), (100, 0), (100.6, 0), (101.2, 0), (200, 0)),
    "drawn-type": road(
        (0, 0),
        (150, 0),
        ego='<vehicle id="ego" type="any" depart="5"><route edges="ab"/></vehicle>',
        extra='<vTypeDistribution id="any"><vType id="lorry" vClass="truck" probability="0.5"/>'
        '<vType id="car" probability="0.5"/></vTypeDistribution>',
    ),
    "loop": LOOP,
    "dead-end": DEAD_END,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_an_unusual_shape(name: str, tmp_path: Path) -> None:
    ego = drives_as_its_twin(tmp_path, CASES[name])
    assert ego["max_decel_mps2"] < 4.6
