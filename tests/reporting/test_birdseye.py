"""The drawings show what the trace says: the ego in its colour where it was, words that fit, frames
in real time."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers_trace import crossing_trace, highway_trace
from PIL import Image

from sumo_mcts.records import Trace, load_trace, save_trace
from sumo_mcts.reporting import animation, birdseye, camera, canvas, ground, storyboard
from sumo_mcts.scene import Follow


def near(image: Image.Image, colour: canvas.Colour, tolerance: int = 40) -> np.ndarray:
    """[height, width] pixels of about this colour."""
    pixels = np.asarray(image.convert("RGB")).astype(int)
    return np.abs(pixels - colour).max(axis=2) <= tolerance


def without_plans(trace: Trace) -> Trace:
    """Plans and tried continuations have the ego's colour too."""
    return trace._replace(
        cycles=tuple(
            c._replace(decision=c.decision._replace(plan=None, children=(), chosen=-1))
            for c in trace.cycles
        )
    )


@pytest.mark.parametrize("time", [0.0, 6.0, 12.5, 17.5])
@pytest.mark.parametrize("trace", [crossing_trace(), highway_trace()], ids=["crossing", "highway"])
def test_the_ego_is_drawn_where_it_is(trace: Trace, time: float) -> None:
    image, view = birdseye.picture(without_plans(trace), time)
    rows, columns = np.nonzero(near(image, canvas.EGO))
    shot = camera.shot_at(trace, time)
    expected = view.pixels(shot.ego[:2])[0] / canvas.SS
    assert len(rows) > 100
    np.testing.assert_allclose([columns.mean(), rows.mean()], expected, atol=3)
    length, width = np.array([shot.cycle.ego.length, shot.cycle.ego.width]) * view.scale / canvas.SS
    assert 0.5 * length * width < len(rows) < 1.1 * length * width


def test_north_is_up_and_east_is_right() -> None:
    _, view = birdseye.picture(crossing_trace(), 0.0)
    here, north, east = view.pixels(np.array([[0.0, 0.0], [0.0, 10.0], [10.0, 0.0]]))
    assert north[1] < here[1]
    assert north[0] == here[0]
    assert east[0] > here[0]


def test_the_windscreen_is_in_front() -> None:
    image, view = birdseye.picture(without_plans(crossing_trace()), 0.0)  # heading north
    rows, _ = np.nonzero(near(image, canvas.EGO_DARK, 20))
    assert (
        rows.mean() < view.pixels(camera.shot_at(crossing_trace(), 0.0).ego[:2])[0][1] / canvas.SS
    )


def test_the_others_move_between_cycles_and_turn_the_shorter_way() -> None:
    trace = crossing_trace()
    a, b = trace.cycles[4], trace.cycles[5]
    shot = camera.shot_at(trace, a.time + 0.25)
    n, m = a.agents.ids.index("car.02"), b.agents.ids.index("car.02")
    np.testing.assert_allclose(shot.others[n, 1], (a.agents.y[n] + b.agents.y[m]) / 2)
    turned = camera._between(np.array([0.0, 0.0, 3.1]), np.array([0.0, 0.0, -3.1]), 0.5)
    assert np.cos(turned[2]) == pytest.approx(-1.0)


@pytest.mark.slow
def test_the_storyboard_is_a_picture_with_the_ego_in_every_panel(tmp_path: Path) -> None:
    storyboard.storyboard(crossing_trace(), tmp_path / "new" / "s.png")
    with Image.open(tmp_path / "new" / "s.png") as image:
        assert image.format == "PNG"
        assert image.width > 1800
        blue = near(image, canvas.EGO)
    middle = (104 + blue.shape[0] - 96) // 2
    for half in (blue[104:middle], blue[middle:-96]):
        for third in np.array_split(half, 3, axis=1):
            assert third.sum() > 300


@pytest.mark.parametrize("moments", [1, 2, 5, 6, 50])
def test_any_number_of_moments_can_be_drawn(tmp_path: Path, moments: int) -> None:
    trace = crossing_trace()
    storyboard.storyboard(trace._replace(cycles=trace.cycles[:7]), tmp_path / "s.png", moments)
    assert (tmp_path / "s.png").stat().st_size > 0


def shots(*places: tuple[float, float], others: tuple[float, float]) -> list[camera.Shot]:
    """The ego at these places in turn, and another vehicle that stands."""
    there = np.array([[*others, 0.0]])
    nothing: Any = None
    return [camera.Shot(nothing, 0.0, np.array([x, y, 0.0, 5.0]), there) for x, y in places]


@pytest.mark.parametrize(("away", "shown"), [(40.0, True), (60.0, False)])
def test_the_others_near_the_ego_are_in_the_picture(away: float, shown: bool) -> None:
    size = (600, 460)
    for view in camera.views_of(shots((0.0, 0.0), (40.0, 0.0), others=(40.0 + away, 5.0)), size):
        across = (40.0 + away - view.west) * view.scale / canvas.SS
        assert (across < size[0]) == shown


def test_vehicles_can_be_read_in_upright_windows() -> None:
    """They move with an ego that drives north for 180 m: 20 px of a car of 4.7 m."""
    views = camera.views_of(shots((0.0, 0.0), (0.0, 180.0), others=(0.0, 20.0)), (286, 572))
    assert views[0].north != views[1].north
    assert min(view.scale / canvas.SS for view in views) * 4.7 > 20.0


def test_moments_run_from_the_first_cycle_to_the_last_in_order() -> None:
    trace = crossing_trace()
    for count in range(2, 10):
        chosen = storyboard.choose_moments(trace, count)
        assert len(chosen) == count
        assert chosen[0] == 0
        assert chosen[-1] == len(trace.cycles) - 1
        assert chosen == sorted(set(chosen))


def test_moments_prefer_a_change_of_mind() -> None:
    cycles = []
    for i, cycle in enumerate(crossing_trace().cycles[:21]):
        decision = cycle.decision._replace(
            command=Follow(np.zeros(5), 0),
            chosen=0,
            children=(cycle.decision.children[5 if i < 11 else 6],),
        )
        cycles.append(
            cycle._replace(
                decision=decision,
                ego=crossing_trace().cycles[0].ego,
                agents=crossing_trace().cycles[0].agents,
            )
        )
    assert storyboard.choose_moments(crossing_trace()._replace(cycles=tuple(cycles)), 3) == [
        0,
        11,
        20,
    ]


@pytest.mark.slow
def test_the_animation_runs_in_real_time_and_is_small(tmp_path: Path) -> None:
    path = tmp_path / "a.gif"
    animation.animation(crossing_trace(), path)
    assert path.stat().st_size <= animation.GIF_BYTES
    with Image.open(path) as image:
        assert image.format == "GIF"
        assert image.width == 720
        assert image.n_frames == len(animation.frame_times(crossing_trace())) == 176
        durations, frames = [], []
        for k in range(image.n_frames):
            image.seek(k)
            durations.append(image.info["duration"])
            frames.append(np.asarray(image.convert("RGB")))
    assert durations == [100] * 175 + [animation.HOLD_MS]
    assert all((a != b).any() for a, b in pairwise(frames))


def test_a_long_animation_with_a_moving_camera_stays_small(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        animation, "GIF_BYTES", 100_000
    )  # the same path as for a long episode, in less time
    trace = highway_trace()
    animation.animation(trace._replace(cycles=trace.cycles[:11]), tmp_path / "a.gif")
    with Image.open(tmp_path / "a.gif") as image:
        assert image.n_frames == 26


def stretched(trace: Trace, seconds: float) -> Trace:
    """The same decisions, spread over so many seconds."""
    last = len(trace.cycles) - 1
    return trace._replace(
        cycles=tuple(
            cycle._replace(time=k * seconds / last) for k, cycle in enumerate(trace.cycles)
        )
    )


@pytest.mark.parametrize(("seconds", "speed"), [(30.0, 1), (30.1, 2), (200.0, 13), (7200.0, 450)])
def test_a_long_drive_is_shown_faster_from_its_first_decision_to_its_last(
    seconds: float, speed: int
) -> None:
    trace = stretched(highway_trace(), seconds)
    times = animation.frame_times(trace)
    assert animation.film_speed(trace) == speed
    assert len(times) <= animation.REAL_TIME_S * animation.FPS + 1
    assert (times[0], times[-1]) == (0.0, seconds)
    np.testing.assert_allclose(np.diff(times)[:-1], speed / animation.FPS)


def test_how_much_faster_is_written_in_the_picture(tmp_path: Path) -> None:
    shot = camera.shot_at(crossing_trace(), 1.0)
    scene = Image.new("RGB", (720 * canvas.SS, 480 * canvas.SS))
    usual, faster, fastest = (
        np.asarray(animation._frame(scene, shot, "", speed)) for speed in (1, 2, 9)
    )
    assert (usual != faster).any()
    assert (faster != fastest).any()


def test_the_animation_of_a_long_drive_is_small_and_tells_how_far_it_is(tmp_path: Path) -> None:
    said: list[str] = []
    animation.animation(
        stretched(highway_trace(), 200.0), tmp_path / "a.gif", width=180, note=said.append
    )
    assert (said[0], said[-1]) == (
        "drawing the film  frame 1 of 155",
        "drawing the film  frame 155 of 155",
    )
    assert len(said) == 155
    with Image.open(tmp_path / "a.gif") as image:
        assert image.n_frames in (78, 155)


@pytest.mark.parametrize("trace", [crossing_trace(), highway_trace()], ids=["crossing", "highway"])
def test_a_ground_of_tiles_is_the_ground(trace: Trace) -> None:
    """Whatever window is cut from it, also before the first tile."""
    roads = ground.roads_of(trace.lanes)
    _, view = birdseye.picture(trace, 6.0, 360)
    tiles = ground.Ground(roads, view)
    for right, up in ((0, 0), (1, -1), (-700, 301), (333, -77), (-5000, 4000)):
        moved = view._replace(
            west=view.west + right * canvas.SS / view.scale,
            north=view.north + up * canvas.SS / view.scale,
        )
        cut, drawn = (
            np.asarray(image.reduce(canvas.SS)).astype(int)
            for image in (tiles.under(moved), ground.draw_ground(roads, moved))
        )
        assert (np.abs(cut - drawn).max(axis=2) > 30).mean() < 1e-3
    assert len(tiles._tiles) <= ground.TILES


def test_the_ground_is_drawn_once_under_a_camera_that_stays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drawn = []
    draw_ground = ground.draw_ground
    monkeypatch.setattr(
        ground, "draw_ground", lambda roads, view: drawn.append(view) or draw_ground(roads, view)
    )
    trace = crossing_trace()
    assert len(list(animation.frames(trace._replace(cycles=trace.cycles[:5]), 180))) == 21
    assert len(drawn) == 1


def test_a_trace_from_disk_gives_the_same_picture(tmp_path: Path) -> None:
    trace = crossing_trace()
    save_trace(tmp_path / "t.npz", trace)
    before, after = (
        birdseye.picture(trace, 6.0)[0],
        birdseye.picture(load_trace(tmp_path / "t.npz"), 6.0)[0],
    )
    assert (np.asarray(before) != np.asarray(after)).any(axis=2).mean() < 1e-3


def test_empty_surroundings_can_be_drawn(tmp_path: Path) -> None:
    trace = without_plans(crossing_trace(others=0))
    bare = trace.lanes._replace(
        lane_ids=(), points=np.zeros((0, 2)), offset=np.zeros(1, np.int32), width=np.zeros(0),
        internal=np.zeros(0, bool), route=np.zeros(0, bool),
        stop_lines=np.zeros((0, 4)),
    )  # fmt: skip
    storyboard.storyboard(trace._replace(lanes=bare, cycles=trace.cycles[:1]), tmp_path / "s.png")
    animation.animation(trace._replace(lanes=bare, cycles=trace.cycles[:1]), tmp_path / "a.gif")
    with Image.open(tmp_path / "a.gif") as image:
        assert image.n_frames == 1


def test_a_trace_without_cycles_is_refused_by_name(tmp_path: Path) -> None:
    trace = crossing_trace()._replace(cycles=())
    for draw in (storyboard.storyboard, animation.animation):
        with pytest.raises(ValueError, match="crossing--mcts--7"):
            draw(trace, tmp_path / "x")
    assert list(tmp_path.iterdir()) == []


def test_the_hull_holds_every_point() -> None:
    points = np.random.default_rng(0).normal(size=(60, 2))
    hull = ground.hull(points)
    following = np.roll(hull, -1, axis=0)
    for p in points.round(3):
        turn = (following[:, 0] - hull[:, 0]) * (p[1] - hull[:, 1]) - (
            following[:, 1] - hull[:, 1]
        ) * (p[0] - hull[:, 0])
        assert (turn >= -1e-9).all()
