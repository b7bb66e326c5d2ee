"""Moments from above and from behind the ego: perspective, signals, labels."""

import math
from pathlib import Path

import numpy as np
import pytest
from helpers_recorded import of_a_user
from helpers_trace import crossing_trace, highway_trace
from PIL import Image, ImageDraw

from sumo_mcts.reporting import camera, canvas, ground, sheet
from sumo_mcts.reporting.chase import chase, placed
from sumo_mcts.reporting.lights import Light, lights
from sumo_mcts.reporting.perspective import AIM, BACK, HEIGHT, NEAR, clipped, eye_behind
from sumo_mcts.reporting.solids import normal_of, person, vehicle
from sumo_mcts.road import RIGHT
from sumo_mcts.scene import GREEN, RED, YELLOW, Signals
from sumo_mcts.world.roadmap import known_roadmap

SIZE = (1200, 750)


def near(image: Image.Image, colour: canvas.Colour, tolerance: int = 30) -> np.ndarray:
    """[height, width] pixels of about this colour."""
    return np.abs(np.asarray(image).astype(int) - colour).max(axis=2) <= tolerance


# --- perspective ---


def test_the_eye_looks_over_the_ego_at_the_road_ahead() -> None:
    eye = eye_behind(100.0, 50.0, math.pi / 2, SIZE)  # to the north
    np.testing.assert_allclose(eye.place, [100.0, 50.0 - BACK, HEIGHT], atol=1e-9)
    aim, left, right, high = eye.pixels(
        eye.seen(
            np.array(
                [(100, 50 + AIM, 0), (97, 50 + AIM, 0), (103, 50 + AIM, 0), (100, 50 + AIM, 2)]
            )
        )
    )
    np.testing.assert_allclose(aim, np.array(SIZE) / 2, atol=1e-6)
    assert left[0] < aim[0] < right[0] and right[0] - aim[0] == pytest.approx(aim[0] - left[0])
    assert high[1] < aim[1]


def test_sizes_shrink_with_the_distance_along_the_view() -> None:
    eye = eye_behind(0.0, 0.0, 0.0, SIZE)
    for x in (5.0, 40.0, 200.0):
        seen = eye.seen(np.array([(x, 1.0, 0.0), (x, -1.0, 0.0)]))
        left, right = eye.pixels(seen)
        assert right[0] - left[0] == pytest.approx(2.0 * eye.focal / seen[0, 2])


@pytest.mark.parametrize("metres", [5.0, 30.0, 400.0])
def test_a_row_tells_how_far_its_ground_is(metres: float) -> None:
    eye = eye_behind(0.0, 0.0, 0.3, SIZE)
    on_ground = np.array([*(eye.place[:2] + metres * np.array([math.cos(0.3), math.sin(0.3)])), 0])
    row = eye.pixels(eye.seen(on_ground))[1]
    assert row > eye.horizon
    assert float(eye.depth(np.array([row]))[0]) == pytest.approx(metres)
    assert eye.depth(np.array([eye.horizon - 1.0]))[0] == np.inf


def test_the_lowest_row_is_beyond_what_is_cut_off() -> None:
    eye = eye_behind(0.0, 0.0, 0.0, SIZE)
    ground_there = np.array([eye.place[0] + eye.depth(np.array([float(SIZE[1])]))[0], 0.0, 0.0])
    assert eye.seen(ground_there)[2] > NEAR


def test_areas_are_cut_where_they_pass_the_eye() -> None:
    square = np.array([(-1.0, 0.0, -5.0), (1.0, 0.0, -5.0), (1.0, 0.0, 5.0), (-1.0, 0.0, 5.0)])
    cut, shift = clipped(square), np.array([0.0, 0.0, 10.0])
    assert len(cut) == 4 and cut[:, 2].min() == NEAR and cut[:, 2].max() == 5.0
    np.testing.assert_allclose(clipped(square + shift), square + shift)
    assert len(clipped(square - shift)) == 0


# --- solids ---


@pytest.mark.parametrize("size", [(4.7, 1.8), (12.0, 2.5), (1.7, 0.6), (18.0, 2.5)])
def test_solids_have_the_vehicles_size_and_faces_outwards(size: tuple[float, float]) -> None:
    faces = vehicle(size, (canvas.OTHER, canvas.OTHER_DARK), (True, 1))
    corners = np.concatenate([face.corners for face in faces])
    assert np.ptp(corners[:, 0]) == pytest.approx(size[0], abs=0.05)
    assert np.ptp(corners[:, 1]) <= size[1] + 1e-9
    assert corners[:, 2].min() > 0
    for face in faces:
        middle = face.corners.mean(axis=0)
        outwards = normal_of(face.corners)
        if outwards[2] > np.hypot(*outwards[:2]):
            continue  # a top, turned up
        within = np.clip(middle, (-0.05, 0.0, -9.0), (0.05, 0.0, 9.0))
        assert outwards @ (middle - within) > 0


def test_lamps_are_red_where_it_brakes_and_amber_where_it_blinks() -> None:
    def shown(braking: bool, blinker: int) -> list[tuple[canvas.Colour, float]]:
        faces = vehicle((4.7, 1.8), (canvas.OTHER, canvas.OTHER_DARK), (braking, blinker))
        return [
            (face.colour, float(face.corners[:, 1].mean()))
            for face in faces
            if face.colour in (canvas.BRAKE, canvas.BLINK)
        ]

    assert shown(False, 0) == []
    assert [colour for colour, _ in shown(True, 0)] == [canvas.BRAKE, canvas.BRAKE]
    for side in (1, -1):
        ((colour, y),) = shown(False, side)
        assert colour == canvas.BLINK and y * side > 0


def test_people_are_as_high_as_people() -> None:
    corners = np.concatenate([face.corners for face in person(0.5, (canvas.OTHER, canvas.INK))])
    assert 1.6 < corners[:, 2].max() < 1.9


# --- the picture ---


@pytest.mark.parametrize("trace", [crossing_trace(), highway_trace()], ids=["crossing", "highway"])
def test_the_ego_is_in_the_middle_below_and_the_sky_above(trace: object) -> None:
    shot = camera.shot_at(trace, 6.0)
    image, eye = chase(ground.roads_of(trace.lanes), shot, [], SIZE)
    rows, columns = np.nonzero(near(image, canvas.EGO, 45))
    below = rows > 0.6 * SIZE[1]
    assert below.sum() > 1500
    assert abs(columns[below].mean() - SIZE[0] / 2) < 25
    ahead = eye.pixels(eye.seen(placed(np.array([[0.0, 0.0, 0.5]]), shot.ego[:3])))[0]
    assert abs(rows[below].mean() - ahead[1]) < 60
    sky = np.asarray(image).astype(int)[: int(eye.horizon) - 5]
    assert (np.ptp(sky[:, :, 2], axis=1) == 0).all()


def test_who_is_near_hides_who_is_far() -> None:
    """A lorry between the eye and a car."""
    trace = highway_trace()
    cycle = trace.cycles[0]
    agents = cycle.agents
    two = agents._replace(**{name: getattr(agents, name)[:2] for name in agents._fields})._replace(
        length=np.array([4.6, 12.0]), width=np.array([1.8, 2.5]), a=np.array([-3.0, 0.0])
    )
    shot = camera.shot_at(trace, cycle.time)

    def braking(order: list[float]) -> int:
        others = np.array([(shot.ego[0] + x, shot.ego[1], shot.ego[2]) for x in order])
        there = shot._replace(cycle=cycle._replace(agents=two), others=others)
        image, _ = chase(ground.roads_of(trace.lanes), there, [], SIZE)
        return int(near(image, canvas.BRAKE, 25).sum())

    assert braking([25.0, 60.0]) > 20  # the car is in front
    assert braking([60.0, 25.0]) == 0


def test_moments_between_decisions_have_their_own_time(tmp_path: Path) -> None:
    trace = crossing_trace()
    for count, times in enumerate([(3.1,), (3.1, 4.2), (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)]):
        path = tmp_path / f"{count}.png"
        sheet.sheet(trace, None, times, sheet.VIEWS, path)
        with Image.open(path) as image:
            assert 1900 <= image.width <= 1920
    with pytest.raises(ValueError, match="crossing--mcts--7"):
        sheet.sheet(trace._replace(cycles=()), None, (1.0,), sheet.VIEWS, tmp_path / "x.png")


# --- signals ---


def test_each_lane_shows_what_its_links_are_shown(tmp_path: Path) -> None:
    road = known_roadmap(str(of_a_user(tmp_path).sumo.sumocfg).replace(".sumocfg", ".net.xml"))
    links = [int(road.link[road.signal == q].max()) + 1 for q in range(len(road.signal_ids))]
    offset = np.concatenate([[0], np.cumsum(links)]).astype(np.int32)
    until = np.full((len(links), 1), np.inf)
    alike = Signals(offset, np.full((offset[-1], 1), YELLOW, np.int32), until)
    bars = lights(road, alike)
    entering = {
        lane
        for lane in np.flatnonzero(~road.internal)
        for after in road.successor[slice(*road.successor_offset[lane : lane + 2])]
        if road.signal[after] >= 0
    }
    assert entering and len(bars) == len(entering)
    assert {bar.colour for bar in bars} == {canvas.BLINK}
    for lane, light in zip(sorted(entering), bars, strict=True):
        end = road.points[road.point_offset[lane + 1] - 1]
        np.testing.assert_allclose(light.bar.mean(axis=0), end, atol=1e-9)
        assert np.hypot(*np.diff(light.bar, axis=0)[0]) == pytest.approx(road.width[lane])

    state = np.full((offset[-1], 1), RED, np.int32)
    turns = np.flatnonzero((road.signal >= 0) & (road.direction == RIGHT))
    state[offset[road.signal[turns]] + road.link[turns], 0] = GREEN
    parts = lights(road, Signals(offset, state, until))
    assert {bar.colour for bar in parts} == {canvas.GO, canvas.BRAKE}
    assert len(parts) > len(bars)  # a lane for the right and straight on has two parts
    first = next(k for k, light in enumerate(parts) if light.colour == canvas.GO)
    np.testing.assert_allclose(parts[first].bar[1], parts[first + 1].bar[0])  # right, then left


def test_lights_are_drawn_in_both_views() -> None:
    trace = highway_trace()
    shot = camera.shot_at(trace, 1.0)
    x, y = shot.ego[:2]
    bar = Light(np.array([(x + 20, y - 3.0), (x + 20, y + 3.0)]), canvas.GO)
    roads = ground.roads_of(trace.lanes)
    for lit in (True, False):
        image, _ = chase(roads, shot, [bar] if lit else [], SIZE)
        view = camera.views_of([shot], (600, 460))[0]
        above = sheet._above(roads, shot, [bar] if lit else [], view)
        for drawn in (image, above):
            assert (near(drawn, canvas.GO).sum() > 60) == lit


# --- labels ---


def test_labels_do_not_cover_each_other_and_stay_inside() -> None:
    image = Image.new("RGB", (800, 400), canvas.LAND)
    draw = ImageDraw.Draw(image)
    written: list[tuple[tuple[float, float], str]] = []
    text = draw.text
    draw.text = lambda at, words, **rest: written.append((at, words)) or text(at, words, **rest)
    places = [(400, 200), (410, 204), (405, 190), (-300, 100), (400, 201), (402, 199), (401, 198)]
    sheet._write_labels(
        draw,
        image.size,
        [sheet.Label(np.array(at, float), f"n{k}") for k, at in enumerate(places)],
    )
    assert [words for _, words in written] == ["n0", "n1", "n2", "n4"]  # four heights, none outside
    font = canvas.font_of(sheet.LABEL_PX)
    boxes = [draw.textbbox(at, words, font=font, anchor="ms") for at, words in written]
    for k, box in enumerate(boxes):
        assert all(not _overlap(box, other) for other in boxes[:k])


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def test_a_window_that_stays_shows_who_is_near() -> None:
    shot = camera.shot_at(crossing_trace(), 3.0)
    there = shot._replace(others=shot.ego[:2][None] + np.array([[0.0, -40.0]]))
    usual = camera.views_of([shot], (600, 460))[0]
    wider = camera.views_of([shot], (600, 460), largest=130.0, also=there.others)[0]
    assert not 0 < usual.pixels(there.others)[0][1] < usual.size[1]
    assert 0 < wider.pixels(there.others)[0][1] < wider.size[1]
    beyond = camera.views_of([shot], (600, 460), also=there.others * 20)[0]
    assert beyond == usual


def written(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """All text that pictures have from now on."""
    words: list[str] = []
    text = ImageDraw.ImageDraw.text
    monkeypatch.setattr(
        ImageDraw.ImageDraw,
        "text",
        lambda self, at, said, *rest, **more: (
            words.append(said) or text(self, at, said, *rest, **more)
        ),
    )
    return words


def test_a_car_at_the_edge_has_its_label_and_none_covers_the_ego() -> None:
    image = Image.new("RGB", (800, 400), canvas.LAND)
    draw, font = ImageDraw.Draw(image), canvas.font_of(sheet.LABEL_PX)
    said: list[tuple[tuple[float, float], str]] = []
    text = draw.text
    draw.text = lambda at, words, **rest: said.append((at, words)) or text(at, words, **rest)
    ego, other = (350.0, 180.0, 450.0, 220.0), (650.0, 180.0, 700.0, 220.0)
    places = {"at the left": (10, 300), "at the right": (790, 300), "ego": (400, 200)}
    places |= {"other": (675, 200)}
    labels = [sheet.Label(np.array(at, float), name) for name, at in places.items()]
    sheet._write_labels(draw, image.size, labels, ego, [other])
    assert [words for _, words in said] == list(places)
    for at, words in said:
        box = draw.textbbox(at, words, font=font, anchor="ms")
        assert box[0] >= 0 and box[2] <= 800
        assert not _overlap(box, ego) and not _overlap(box, other)


def test_above_no_label_covers_the_ego(monkeypatch: pytest.MonkeyPatch) -> None:
    shot = camera.shot_at(crossing_trace(), 3.0)
    given: list[tuple[float, ...]] = []
    monkeypatch.setattr(sheet, "_write_labels", lambda *args: given.append(args[3]))
    view = camera.views_of([shot], (600, 460))[0]
    sheet._above(ground.roads_of(crossing_trace().lanes), shot, [], view)
    sheet._chase(ground.roads_of(crossing_trace().lanes), shot, [], SIZE)
    middle = view.pixels(shot.ego[:2])[0]
    for (left, upper, right, lower), (x, y) in zip(
        given, (middle, (SIZE[0] / 2, 0.75 * SIZE[1])), strict=True
    ):
        assert left < x < right and upper < y < lower and right - left < 400


@pytest.mark.parametrize(
    ("views", "there"), [(("chase",), False), (("above",), True), (sheet.VIEWS, True)]
)
def test_the_legend_has_what_the_views_show(
    views: tuple[str, ...], there: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = written(monkeypatch)
    sheet.sheet(crossing_trace(), None, (1.0, 2.0), views, tmp_path / "x.png")
    assert "plan" in words
    assert ("also tried, stronger: more visits" in words) == there
    assert ("N" in words) == there
