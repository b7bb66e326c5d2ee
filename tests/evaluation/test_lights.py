"""The referee on small hand-made roads: lights."""

from helpers import (
    edges,
    ego_at,
    frame_of,
    lights,
)
from helpers_referee import SIGNALLED, STEP, referee

from sumo_mcts.scene import AFTER_STOP, GREEN, RED, YELLOW


def lit(
    where: list[tuple[str, float, float]], colours: list[int], step: float = STEP
) -> tuple[int, int]:
    """Red and yellow runs of an ego at (lane, s, v), one a step, while the light of its link shows
    the colours."""
    route = edges(SIGNALLED, "wi", "eo")
    frames = [
        frame_of(
            SIGNALLED,
            k * step,
            ego_at(SIGNALLED, name, s, v, route=route),
            signals=lights(colour, RED, RED),
        )
        for k, ((name, s, v), colour) in enumerate(zip(where, colours, strict=True))
    ]
    judge = referee(SIGNALLED, frames[0], "wi", "eo", step=step)
    for frame in frames[1:]:
        judge.observe(frame)
    return judge.row()["red_lights_run"], judge.row()["yellow_run"]


def test_red_light_run() -> None:
    slow = [("wi_0", 55.5 + 5 * k, 10.0) for k in range(7)] + [(":we_0", 0.5, 10.0)]
    assert lit(slow, [RED] * 8) == (1, 0)
    assert lit(slow, [GREEN] * 8) == (0, 0)
    assert lit(slow, [GREEN] * 2 + [RED] * 6) == (1, 0)  # 29.5 m and 10 m/s: 1.7 m/s2
    assert lit(slow, [RED] * 7 + [GREEN]) == (0, 0)
    assert lit(slow, [GREEN] * 7 + [RED]) == (0, 0)
    assert lit(slow[:7], [RED] * 7) == (0, 0)


def test_red_that_may_be_passed_after_a_stop() -> None:
    fast = [("wi_0", 55.5 + 5 * k, 10.0) for k in range(7)] + [(":we_0", 0.5, 10.0)]
    assert lit(fast, [AFTER_STOP] * 8) == (1, 0)
    onto = [("wi_0", 80.5, 10.0), ("wi_0", 85.5, 10.0), (":we_0", 0.5, 10.0)]
    far = [("wi_0", 75.5, v) for v in (5.0, 0.0, 0.0)] + onto
    near = [*far[:3], ("wi_0", 80.5, 10.0), ("wi_0", 85.5, 0.0), onto[2]]
    assert lit(near, [AFTER_STOP] * 6) == (0, 0)
    assert lit(near, [RED] * 6) == (1, 0)
    assert lit(far, [AFTER_STOP] * 6) == (1, 0)  # 15 m before the line


def test_red_light_run_over_a_lane_skipped_within_a_step() -> None:
    assert lit(
        [("wi_0", s, 24.0) for s in (15.5, 39.5, 63.5, 87.5)] + [("eo_0", 1.5, 24.0)],
        [RED] * 5,
        step=1.0,
    ) == (1, 0)


def test_whoever_could_not_stop_at_the_end_of_green_ran_no_light() -> None:
    near = [
        ("wi_0", 65.0, 15.0),
        ("wi_0", 72.0, 15.0),
        ("wi_0", 79.5, 15.0),
        ("wi_0", 87.0, 15.0),
        (":we_0", 4.5, 15.0),
    ]
    assert lit(near, [GREEN, GREEN, RED, RED, RED]) == (0, 0)  # 18 m at 15 m/s: 6.3 m/s2
    assert lit([("wi_0", 65.5, 15.0), *near[1:]], [GREEN, RED, RED, RED, RED]) == (
        0,
        0,
    )  # 24.5 m: 4.6 m/s2
    assert lit([("wi_0", 64.5, 15.0), *near[1:]], [GREEN, RED, RED, RED, RED]) == (
        1,
        0,
    )  # 25.5 m: 4.4 m/s2
    assert lit(near[2:], [RED, RED, RED]) == (0, 0)  # taken over too late
    stopped = [("wi_0", 72.0, 15.0), ("wi_0", 89.0, 0.0), ("wi_0", 89.5, 1.0), (":we_0", 0.5, 2.0)]
    assert lit(stopped, [GREEN, RED, RED, RED]) == (1, 0)  # it did stop


def test_yellow_run() -> None:
    way = [("wi_0", 80.0, 10.0), ("wi_0", 85.0, 10.0), (":we_0", 0.5, 10.0)]
    assert lit(way, [GREEN, YELLOW, YELLOW]) == (0, 0)  # 10 m at 10 m/s: 5 m/s2
    far = [("wi_0", 70.0, 10.0), ("wi_0", 75.0, 10.0), *way]
    assert lit(far, [GREEN, YELLOW, YELLOW, YELLOW, YELLOW]) == (0, 1)  # 20 m: 2.5 m/s2
    assert lit(far, [GREEN, YELLOW, YELLOW, YELLOW, RED]) == (0, 1)
    assert lit(far, [GREEN, GREEN, GREEN, GREEN, YELLOW]) == (0, 0)
    assert lit(far, [GREEN, YELLOW, YELLOW, RED, RED]) == (1, 0)
