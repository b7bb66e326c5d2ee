"""The kinds of errors that every part of the package raises or tells apart, and their words."""

import errno
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from itertools import islice

MOST_SHOWN = 2000  # characters of a message
MOST_OF_VALUE = 100  # ... and of a value that was given
MOST_COMPARED = 20_000  # names that are compared with one that is not known

# The disk, the quota, open files, processes, memory, a closed pipe: the machine fails, and the
# input may be right.
_OF_MACHINE = frozenset(
    {errno.ENOSPC, errno.EDQUOT, errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EAGAIN, errno.EIO,
    errno.EPIPE, errno.EBADF}
)  # fmt: skip
_NO_THREAD = "can't start new thread"  # Python's words for a shortage of processes


class ConfigError(Exception):
    """Wrong input, in one line that names the file, the key and what is allowed."""

    def __init__(self, message: str, every: Sequence[str] = ()) -> None:
        """`every`: where several things are wrong, a line for each."""
        super().__init__(printable(message))
        self.every = tuple(printable(line) for line in every) or (str(self),)


class FailedError(Exception):
    """What could not be done although the input is right, in one line that says what to do."""


def of_machine(error: BaseException) -> bool:
    """Whether an error is about a shortage of the machine, so that it tells nothing about the
    input."""
    if isinstance(error, OSError):
        return error.errno in _OF_MACHINE
    return isinstance(error, MemoryError) or (
        isinstance(error, RuntimeError) and _NO_THREAD in str(error)
    )


def in_one_line(error: BaseException) -> str:
    """An exception's type and text without line breaks."""
    return " ".join(f"{type(error).__name__}: {error}".split())


def printable(text: object) -> str:
    """The text as one line of bounded length.

    What cannot be printed (line breaks, control characters, escapes of terminals, marks that turn
    the direction of writing, halves of characters) is written as in Python's texts. A printable
    text stays as it is, so it does not matter how often this is done.
    """
    return shortened(
        "".join(
            c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode()
            for c in str(text)
        ),
        MOST_SHOWN,
    )


def shown(value: object) -> str:
    """A value that was given, as Python writes it, with its end left out where it is long."""
    try:
        return shortened(repr(value), MOST_OF_VALUE)
    except (ValueError, RecursionError):  # a number of thousands of digits, for example
        return f"a long {type(value).__name__}"


def near(given: str, names: Iterable[str], most: int, likeness: float = 0.5) -> list[str]:
    """Up to `most` names that may have been meant, the nearest first; of very many names some are
    looked at."""
    return get_close_matches(
        given[:MOST_OF_VALUE], list(islice(names, MOST_COMPARED)), most, likeness
    )


def shortened(text: str, most: int) -> str:
    """The text, with its middle left out where it is longer than `most` characters."""
    if len(text) <= most:
        return text
    head = most * 2 // 3
    return f"{text[:head]} ... {text[len(text) - (most - head - 5) :]}"
