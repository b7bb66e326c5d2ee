"""What a wrong input is: the files, the command, and which answers are right."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

DRIVEN, FAILED, REFUSED = 0, 1, 2  # exit statuses
ONLY_REFUSED = frozenset({REFUSED})
NOT_DRIVEN = frozenset({FAILED, REFUSED})
ANY = frozenset(
    {DRIVEN, FAILED, REFUSED}
)  # the input may be taken, but never with a traceback, a hang or a dead process

BEFORE_SUMO_S = 20.0  # twice the promised 10 s: a slow machine that does something else too
DRIVING_S = 60.0  # where an episode may run


class Interruption(NamedTuple):
    """A signal while the command runs."""

    number: int
    after_s: float
    whole_group: bool  # to its children too, as a terminal sends it


def nothing(folder: Path) -> None:
    """Change nothing in the folder."""


class Case(NamedTuple):
    """One wrong input."""

    kind: str
    name: str
    words: tuple[str, ...]  # what follows `sumo-mcts`
    files: Mapping[str, bytes] = {}  # beside the good ones, or in place of them
    recorded: bool = (
        False  # whether output folders, `rec` of a batch and `one` of a run, lie beside them too
    )
    prepare: Callable[[Path], None] = (
        nothing  # what no content of a file can say: pipes, links, folders
    )
    environment: Mapping[str, str | None] = {}  # None: not set
    prefix: tuple[str, ...] = ()  # a program that starts the command in another surrounding
    allowed: frozenset[int] = ONLY_REFUSED
    naming: tuple[
        str, ...
    ] = ()  # the file, key or option: the line on standard error has to name all of these
    patience_s: float = BEFORE_SUMO_S
    said: bool = True  # False: standard error is not there to be read
    interruption: Interruption | None = None

    @property
    def title(self) -> str:
        """Unique among all cases."""
        return f"{self.kind}: {self.name}"


def scenario_case(
    kind: str,
    name: str,
    text: str | bytes,
    allowed: frozenset[int] = ONLY_REFUSED,
    naming: tuple[str, ...] = (),
) -> Case:
    """`run` with a scenario file of this content; the file has to be named, and `naming` too."""
    content = text.encode() if isinstance(text, str) else text
    patience = DRIVING_S if DRIVEN in allowed else BEFORE_SUMO_S
    words, files = ("run", "s.yaml", "--json"), {"s.yaml": content}
    return Case(
        kind, name, words, files, allowed=allowed, patience_s=patience, naming=("s.yaml", *naming)
    )
