"""How often, and after how much standing, an ego leaves its route, whatever SUMO's router finds."""

from collections.abc import Sequence
from unittest import mock

from helpers import Lane, agents_at, build, edges, ego_at, lights
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts import config
from sumo_mcts.driver import missed_lane
from sumo_mcts.driver.missed_lane import MissedLane
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Scene
from sumo_mcts.world.detour import Way

PERIOD, PATIENCE = 0.5, 1.0
CONFIG = config.build(
    {
        "name": "x",
        "sumo": {"net": "x.net.xml"},
        "egos": [{"id": "ego"}],
        "ego_model": {"reroute_after_s": PATIENCE},
    },
    "test",
)
STANDS, DRIVES = 0.0, 3.0  # m/s


def fork(*, certain: bool) -> RoadMap:
    """The right lane of `a` leads onto c, the left one onto b; `certain`: none may change."""
    allowed = {"change_left": 0} if certain else {}
    return build(
        [
            Lane("a", 0, ((0.0, 0.0), (100.0, 0.0)), ("c_0",), **allowed),
            Lane("a", 1, ((0.0, 3.0), (100.0, 3.0)), ("b_0",)),
            Lane("b", 0, ((100.0, 3.0), (200.0, 3.0)), ("g_0",)),
            Lane("c", 0, ((100.0, 0.0), (200.0, 0.0)), ("g_0",)),
            Lane("g", 0, ((200.0, 3.0), (300.0, 3.0))),
        ]
    )


class Router:
    """Stands in for SUMO: finds the ways of a list, and takes note of those that are taken."""

    def __init__(self, ways: Sequence[Way]) -> None:
        self._ways = ways
        self.taken: list[tuple[str, ...]] = []

    def ways(self, vehicle: str, onto: Sequence[str], goal: str) -> Sequence[Way]:
        return self._ways

    def take(self, vehicle: str, edges: tuple[str, ...]) -> bool:
        self.taken.append(edges)
        return True

    def stop_edges(self, vehicle: str) -> list[str]:
        return []


# Three ways of the router, which differ by how often they go round.
WAYS = [Way(("c", *("r",) * n, "g"), 30.0 + n) for n in range(3)]


@given(
    st.lists(st.sampled_from([STANDS, STANDS, STANDS, DRIVES]), min_size=30, max_size=90),
    st.lists(st.sampled_from(WAYS), max_size=3, unique=True),
    st.booleans(),
)
def test_a_way_is_taken_again_after_twice_the_wait(
    speeds: list[float], ways: list[Way], certain: bool
) -> None:
    """The ego stands at the same lane's end again and again, as if each way led back there."""
    road, router, stood, said = fork(certain=certain), Router(ways), 0.0, []
    route = edges(road, "a", "b", "g")
    with mock.patch.object(missed_lane, "detour", router):
        watch = MissedLane("ego", road, CONFIG, PERIOD)
        for k, v in enumerate(speeds):
            ego = ego_at(road, "a_0", 95.0, v, route=route)
            before = len(router.taken)
            scene = Scene((k + 1) * PERIOD, 0.1, ego, agents_at(road), lights())
            text = watch.note(scene)
            stood += PERIOD if v == STANDS else 0.0
            assert watch.note(scene) == text and watch.reroutes == len(router.taken)
            said.append(text)
            if len(router.taken) > before:
                way, tries = router.taken[-1], router.taken[:-1].count(router.taken[-1])
                at_once = certain and tries == 0
                assert stood >= PATIENCE * 2.0**tries or at_once
                assert tries == min(router.taken[:-1].count(("a", *w.edges)) for w in ways), way
                # as if it had been round: on another edge, and then on this one again
                there = ego_at(road, "b_0", 5.0, DRIVES, route=route[1:])
                watch.note(scene._replace(time=scene.time + 0.1, ego=there))
                stood = 0.0
    if not ways:
        assert not router.taken
        waits = [text for text in said if text]
        assert all(text.startswith("waits on") for text in waits)
        assert stood // PATIENCE - 1 <= len(waits) <= stood // PATIENCE + certain
    elif stood > PATIENCE * 2.0 ** len(router.taken):
        raise AssertionError("it stands for ever")


def test_the_quickest_of_the_ways_is_taken_first() -> None:
    road, router = fork(certain=True), Router(list(reversed(WAYS)))
    ego = ego_at(road, "a_0", 10.0, DRIVES, route=edges(road, "a", "b", "g"))
    with mock.patch.object(missed_lane, "detour", router):
        MissedLane("ego", road, CONFIG, PERIOD).note(
            Scene(1.0, 0.1, ego, agents_at(road), lights())
        )
    assert router.taken == [("a", "c", "g")]


def test_the_route_itself_is_no_other_way() -> None:
    road, router = fork(certain=True), Router([Way(("b", "g"), 10.0)])
    ego = ego_at(road, "a_0", 10.0, DRIVES, route=edges(road, "a", "b", "g"))
    with mock.patch.object(missed_lane, "detour", router):
        watch = MissedLane("ego", road, CONFIG, PERIOD)
        said = watch.note(Scene(1.0, 0.1, ego, agents_at(road), lights()))
    assert said.startswith("waits on") and not router.taken
