"""Hypotheses searched side by side: the same decisions, and no thread waits for another one."""

import threading
import time

import pytest

from sumo_mcts import config
from sumo_mcts.config import builtin
from sumo_mcts.episode import run_episode
from sumo_mcts.numerics import kernel, yardstick
from sumo_mcts.planners.mcts import mcts_params
from sumo_mcts.planners.threads import side_by_side

SCENE = "unprotected-left-turn"


def test_results_come_in_the_order_of_the_tasks() -> None:
    def late(k: int) -> int:
        time.sleep(0.02 * (4 - k))
        return k

    tasks = [lambda k=k: late(k) for k in range(5)]
    assert [side_by_side(tasks, threads) for threads in (1, 2, 9)] == [list(range(5))] * 3


def test_two_run_at_the_same_time() -> None:
    """Each waits for the other: one after the other they would wait for ever."""
    meeting = threading.Barrier(2, timeout=20.0)
    assert sorted(side_by_side([meeting.wait, meeting.wait], 2)) == [0, 1]


def test_an_error_of_a_task_is_raised() -> None:
    def fails() -> int:
        raise ValueError("told")

    with pytest.raises(ValueError, match="told"):
        side_by_side([lambda: 1, fails], 2)


def test_no_thread_is_left() -> None:
    before = threading.active_count()
    side_by_side([lambda: 1] * 4, 3)
    assert threading.active_count() == before


@pytest.mark.skipif(kernel.is_plain(), reason="nothing is compiled")
def test_compiled_code_lets_other_threads_run() -> None:
    """Held up, this thread would come to count once or not at all."""
    yardstick.searched(1)  # loads it
    other = threading.Thread(target=yardstick.searched, args=(500_000,))
    other.start()
    counted = 0
    while other.is_alive():
        counted += 1
        time.sleep(0.005)
    assert counted > 5


@pytest.mark.slow
def test_any_number_of_threads_decides_alike() -> None:
    digests, hypotheses = set(), set()
    for threads in (1, 2, 3):
        sets = (
            f"planner.threads={threads}", "planner.iterations=400", "episode.stop_time_s=5",
            "prediction.hypotheses=4",
        )  # fmt: skip
        result = run_episode(config.load(builtin.scenario_path(SCENE), sets), 4)
        digests.add(result.rows[0]["trace_digest"])
        hypotheses |= {len(cycle.forecast.weight) for cycle in result.traces[0].cycles}
    assert len(digests) == 1
    assert max(hypotheses) > 2  # there was something to share out


def test_what_is_drawn_comes_from_one_stream() -> None:
    sets = ("planner.threads=2", "planner.adaptive=false")
    assert mcts_params(config.load(builtin.scenario_path(SCENE), sets)).threads == 1
    assert mcts_params(config.load(builtin.scenario_path(SCENE), sets[:1])).threads == 2
