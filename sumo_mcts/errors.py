"""The kinds of errors that every part of the package raises or tells apart, and their words."""

import errno

# The disk, the quota, open files, processes, memory, a closed pipe: the machine fails, and the input may be right.
_OF_MACHINE = frozenset(
    {errno.ENOSPC, errno.EDQUOT, errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EAGAIN, errno.EIO, errno.EPIPE, errno.EBADF}
)  # fmt: skip
_NO_THREAD = "can't start new thread"  # Python's words for a shortage of processes


class ConfigError(Exception):
    """Wrong input, in one line that names the file, the key and what is allowed."""


class FailedError(Exception):
    """What could not be done although the input is right, in one line that says what to do."""


def of_machine(error: BaseException) -> bool:
    """Whether an error is about a shortage of the machine, so that it tells nothing about the input."""
    if isinstance(error, OSError):
        return error.errno in _OF_MACHINE
    return isinstance(error, MemoryError) or (isinstance(error, RuntimeError) and _NO_THREAD in str(error))


def in_one_line(error: BaseException) -> str:
    """An exception's type and text without line breaks."""
    return " ".join(f"{type(error).__name__}: {error}".split())


def printable(text: str) -> str:
    """The text with control characters, newlines too, written as escapes."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "backslashreplace").decode() for c in text)
