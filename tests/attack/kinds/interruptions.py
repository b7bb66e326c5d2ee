"""Signals at any moment."""

import random
import signal
from collections.abc import Iterator

from ..case import DRIVEN, DRIVING_S, Case, Interruption

_SEED = 24
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
COMMANDS: dict[str, tuple[tuple[str, ...], float]] = {  # and within which time to interrupt
    "run": (("run", "good.yaml", "--time-limit", "20", "--out", "out"), 3.0),
    "search": (
        (
            "run",
            "good.yaml",
            "--planner",
            "mcts",
            "--set",
            "planner.adaptive=false",
            "--iterations",
            "20000",
            "--time-limit",
            "20",
            "--out",
            "out",
        ),
        6.0,
    ),
    "exhaustive": (("run", "good.yaml", "--planner", "exhaustive", "--time-limit", "20"), 6.0),
    "batch": (("batch", "one.yaml", "--out", "out", "--jobs", "2"), 4.0),
    "forecast": (("forecast", "good.yaml"), 5.0),
    "clone": (
        ("run", "good.yaml", "--planner", "mcts", "--prediction", "clone", "--iterations", "20"),
        5.0,
    ),
    "listing": (("run", "good.sumocfg"), 1.5),
    "validate": (("validate", "good.yaml"), 1.0),
    "help": (("--help",), 0.4),
}
_EACH = 6


def cases() -> Iterator[Case]:
    """Every command, interrupted at moments that the seed draws, as a terminal does it (all
    processes) and as `kill` does it (one)."""
    chance = random.Random(_SEED)
    for what, (words, within_s) in COMMANDS.items():
        for k in range(_EACH):
            number = _SIGNALS[k % len(_SIGNALS)]
            moment = Interruption(
                number, round(chance.uniform(0.0, within_s), 2), whole_group=chance.random() < 0.5
            )
            to = "all processes" if moment.whole_group else "the command"
            # Before Python has started a signal ends it by itself; after the end there is nothing
            # to interrupt.
            early = moment.after_s < 0.3
            allowed = frozenset({128 + number, DRIVEN, *((-number,) if early else ())})
            yield Case(
                "interruption",
                f"{what}: {number.name} to {to} after {moment.after_s} s",
                words,
                allowed=allowed,
                interruption=moment,
                patience_s=DRIVING_S,
                said=not early,
            )
