"""One number for what an ego decided and what SUMO made of it: equal runs have equal digests."""

import hashlib
import math
from collections.abc import Sequence

import numpy as np

from sumo_mcts.scene import Decision, EgoState, Follow


class Digest:
    """SHA-256 over decisions and executed states, rounded to micrometres; no timings."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()

    def add_state(self, ego: EgoState) -> None:
        """What SUMO made of a step."""
        self._add([ego.lane, *map(_micro, (ego.s, ego.v, ego.x, ego.y))])

    def add_decision(self, decision: Decision) -> None:
        """What is to be done, and how the search came to it."""
        command = decision.command
        if isinstance(command, Follow):
            asks = [command.asks] if command.asks else []
            self._add([1, command.lane_change, *asks, *map(_micro, command.speeds)])
            self._add([child.visits for child in decision.children])
        else:
            self._hash.update(b"release")

    def text(self) -> str:
        """The digest so far, in hexadecimal."""
        return self._hash.hexdigest()

    def _add(self, numbers: Sequence[int]) -> None:
        self._hash.update(np.array(numbers, np.int64).tobytes())


def _micro(x: float) -> int:
    return round(x * 1e6) if math.isfinite(x) else -1
