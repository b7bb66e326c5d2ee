"""The errors that all packages raise, and how a message is made fit to print."""

import errno
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from itertools import islice

MOST_SHOWN = 2000  # characters of a message
MOST_OF_VALUE = 100  # ... and of a value that was given
MOST_COMPARED = 20_000  # names that are compared with an unknown one

# The disk, the quota, open files, processes, memory, a closed pipe: the machine fails, and the
# input may be right.
_OF_MACHINE = frozenset(
    {errno.ENOSPC, errno.EDQUOT, errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EAGAIN, errno.EIO,
    errno.EPIPE, errno.EBADF}
)  # fmt: skip
_NO_THREAD = "can't start new thread"  # Python's words for a shortage of processes


class ConfigError(Exception):
    """Wrong input. The message is one line that names the file, the key and what is allowed."""

    def __init__(self, message: str, every: Sequence[str] = ()) -> None:
        """`every`: where several things are wrong, a line for each."""
        super().__init__(printable(message))
        self.every = tuple(printable(line) for line in every) or (str(self),)


class FailedError(Exception):
    """The input is right, and the work failed. The message is one line that says what to do."""


def of_machine(error: BaseException) -> bool:
    """Whether an error comes from a shortage of the machine, not from the input."""
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

    Line breaks, control characters, escapes of terminals, marks that turn the direction of writing
    and halves of characters are written as in Python's texts. A printable text stays as it is.
    """
    return shortened(
        "".join(
            c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode()
            for c in str(text)
        ),
        MOST_SHOWN,
    )


def shown(value: object) -> str:
    """A value as Python writes it, with its middle left out where it is long."""
    try:
        return shortened(repr(value), MOST_OF_VALUE)
    except (ValueError, RecursionError):  # a number of thousands of digits, for example
        return f"a long {type(value).__name__}"


def near(given: str, names: Iterable[str], most: int, likeness: float = 0.5) -> list[str]:
    """Up to `most` names that may have been meant, the nearest first.

    Of very many names only the first are compared.
    """
    return get_close_matches(
        given[:MOST_OF_VALUE], list(islice(names, MOST_COMPARED)), most, likeness
    )


def shortened(text: str, most: int) -> str:
    """The text, with its middle left out where it is longer than `most` characters."""
    if len(text) <= most:
        return text
    head = most * 2 // 3
    return f"{text[:head]} ... {text[len(text) - (most - head - 5) :]}"
