"""Searches side by side on several threads: compiled code lets the others run."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

_T = TypeVar("_T")


def side_by_side(tasks: Sequence[Callable[[], _T]], threads: int) -> list[_T]:
    """What the tasks return, in their order, whatever the number of threads; the first begins
    first.

    The threads end with the call, which costs about a tenth of a millisecond for each: SUMO and
    whatever forks this process find none.
    """
    threads = min(threads, len(tasks))
    if threads == 1:
        return [task() for task in tasks]
    with ThreadPoolExecutor(threads) as pool:
        return [each.result() for each in [pool.submit(task) for task in tasks]]
