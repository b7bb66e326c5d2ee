"""Runs a command in a child process and watches it.

SUMO and compiled code can crash, or never return: no exception handler survives that. However the
child ends, the user gets one line, a documented exit status and a clean temporary folder, and no
process stays behind. The parent imports nothing heavy, so it answers signals from the start.

    parent  blocks signals, forks, waits; sends signals on to the child; kills a child that does
            not respond to them
    child   runs the command; writes lines to the parent: "!", it responds to a signal; "=N", the
            results are written and its status will be N; "?N", it ends because of signal N
"""

import ctypes
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NoReturn

FAILED = 1  # exit status

# The words for each signal that asks for the end; the exit status is 128 + its number.
WORDS: dict[int, str] = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated"}
if hasattr(signal, "SIGHUP"):  # not on Windows
    WORDS[signal.SIGHUP] = "hung up"
TICK_S = 0.5  # between two checks of the child
UNANSWERED_S = 2.0  # until a child has to respond to a signal: in compiled code it cannot
HEEDED_S = 20.0  # for a child that responds, to write its rows and end its workers
CLOSING_S = 5.0  # for a child with written results: SUMO's window may never close
AGAIN_S = 0.5  # a terminal signals parent and child alike: within this time it is the same signal
DEBUG = "SUMO_MCTS_DEBUG"  # environment variable: run in this process, and show tracebacks
_DOING = "doing.txt"  # in the child's temporary folder
Command = Callable[[], int]


def supervised(command: Command) -> int:
    """The exit status of a command that runs in a child process, or in this one where that is
    impossible or DEBUG is set."""
    _open_standard_files()
    if not hasattr(signal, "sigtimedwait") or os.environ.get(DEBUG):
        return command()
    watched = {signal.SIGCHLD, *_watched()}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, watched)  # sigtimedwait takes them
    try:
        scratch = Path(tempfile.mkdtemp(prefix="sumo_mcts-"))
    except OSError as error:
        return _say_failed(f"{error.filename or 'temporary folder'}: {error.strerror or error}")
    try:
        return _forked(command, scratch, watched, mask)
    except OSError as error:  # no memory, or too many processes
        return _say_failed(f"cannot start a process: {error.strerror}")
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def die_with_parent() -> None:
    """Have the kernel kill this process when the thread that started it ends (Linux)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


def silence_libraries() -> None:
    """Warnings and log messages of libraries are for developers: hide them from users."""
    import logging  # noqa: PLC0415  # not in the parent
    import warnings  # noqa: PLC0415

    if not os.environ.get(DEBUG):
        warnings.simplefilter("ignore")
        logging.getLogger().addHandler(logging.NullHandler())  # else messages go to standard error


# --- the child's side ---


class _Child:
    """The state of this process as a supervised child."""

    pipe: int | None = None  # to the parent
    scratch: Path | None = None
    asked_at = -AGAIN_S  # when a signal asked for the end, s


def doing(what: str) -> None:
    """Note what this process does: the parent prints it if the process is killed meanwhile.

    "" stands for nothing special.
    """
    if _Child.scratch is not None:
        with suppress(OSError):
            (_Child.scratch / _DOING).write_text(what, encoding="utf-8", errors="backslashreplace")


def results_are_out(status: int) -> None:
    """Report to the parent that the results are written.

    After CLOSING_S the parent ends this process, with this status.
    """
    _report(f"={status}")


def asked_to_end(number: int) -> int:
    """The exit status of a command that ends because signal `number` asked for it.

    The user gets one line: from the parent, where there is one, since it may kill this process
    before or after a line of its own.
    """
    if _Child.pipe is None:
        return _say_asked(number)
    _report(f"?{number}")
    return 128 + number


@contextmanager
def heeding(act: Callable[[int], None]) -> Iterator[None]:
    """Call `act` with the number of each signal that asks for the end.

    The parent gets the report that this process responds to the signal.
    """

    def heed(number: int, _: object) -> None:
        _report("!")
        if time.monotonic() - _Child.asked_at >= AGAIN_S:
            _Child.asked_at = time.monotonic()
            act(number)

    before = {number: signal.signal(number, heed) for number in _watched()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _watched() -> list[int]:
    """The signals that ask for the end, without those that are ignored because of `nohup`."""
    return [
        number
        for number in WORDS
        if number == signal.SIGINT or signal.getsignal(number) is not signal.SIG_IGN
    ]


def _report(text: str) -> None:
    if _Child.pipe is not None:
        with suppress(OSError):
            os.write(_Child.pipe, f"{text}\n".encode())


def _run_child(
    command: Command, scratch: Path, pipe: int, mask: set[int | signal.Signals]
) -> NoReturn:
    """All that the child does, from the fork to its exit."""
    status = FAILED
    try:
        die_with_parent()
        _Child.pipe, _Child.scratch = pipe, scratch
        tempfile.tempdir = str(scratch)  # the parent removes it, however the child ends
        with heeding(_leave):  # until the command has handlers of its own
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            status = command()
    except BaseException as error:
        _say_failed(" ".join(f"{type(error).__name__}: {error}".split()))
    finally:
        os._exit(status)  # no second clean-up, and no window that keeps the process


def _leave(number: int) -> NoReturn:
    os._exit(asked_to_end(number))


# --- the parent's side ---


def _open_standard_files() -> None:
    """Open those of standard input, output and error that are closed.

    Else another file would get their number, and be written to by mistake. Reading finds nothing,
    what is written to standard error is lost, and writing to standard output fails.
    """
    for number, name, mode in (
        (0, "stdin", os.O_RDWR),
        (1, "stdout", os.O_RDONLY),
        (2, "stderr", os.O_RDWR),
    ):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, mode)  # gets the lowest number that is free, which is this one
            setattr(sys, name, os.fdopen(number, "r" if number == 0 else "w", closefd=False))


def _forked(
    command: Command, scratch: Path, watched: set[int], mask: set[int | signal.Signals]
) -> int:
    """The exit status of a command in a child.

    `watched`: signals that are blocked here; `mask`: those that were blocked before.
    """
    reading, writing = os.pipe()
    os.set_blocking(reading, False)
    # If the caller ignores this signal, the child's status would be lost.
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    child = os.fork()
    if child == 0:
        os.close(reading)
        _run_child(command, scratch, writing, mask)
    os.close(writing)
    try:
        return _Watch(child, reading, scratch).status(watched)
    finally:
        os.close(reading)


class _Watch:
    """One child, until its end."""

    def __init__(self, child: int, pipe: int, scratch: Path) -> None:
        self._child, self._pipe, self._scratch = child, pipe, scratch
        self._asked: int | None = None  # the signal that asked for the end, and
        self._asked_at = 0.0  # when, s
        self._kill_at = float("inf")  # s
        self._result: int | None = None  # the status, once the results are written
        self._left_for: int | None = None  # the signal that the child reports to end for

    def status(self, watched: set[int]) -> int:
        """Wait for the child's end; the exit status. Writes the line that the child cannot."""
        while True:
            received = signal.sigtimedwait(watched, TICK_S)
            number, code = os.waitpid(self._child, os.WNOHANG)
            if number:
                return self._ended(os.waitstatus_to_exitcode(code))
            if received is not None and received.si_signo in WORDS:
                self._forward(received.si_signo)
            self._listen()
            if time.monotonic() >= self._kill_at:
                os.kill(self._child, signal.SIGKILL)
                os.waitpid(self._child, 0)
                return self._killed()

    def _forward(self, number: int) -> None:
        now = time.monotonic()
        if self._asked is None:
            self._asked, self._asked_at, self._kill_at = number, now, now + UNANSWERED_S
        elif now - self._asked_at >= AGAIN_S:  # asked twice: at once
            self._kill_at = now
        os.kill(self._child, number)

    def _listen(self) -> None:
        """Read what the child reports."""
        try:
            lines = os.read(self._pipe, 4096).decode(errors="replace").split()
        except BlockingIOError:
            return
        for line in lines:
            if (
                line == "!"
                and self._asked is not None
                and self._kill_at == self._asked_at + UNANSWERED_S
            ):
                self._kill_at = self._asked_at + HEEDED_S
            elif line.startswith("="):
                self._result, self._kill_at = int(line[1:]), time.monotonic() + CLOSING_S
            elif line.startswith("?"):
                self._left_for = int(line[1:])

    def _ended(self, code: int) -> int:
        """The child ended by itself, or another process ended it."""
        self._listen()
        if self._left_for is not None:
            return _say_asked(self._left_for)
        if code >= 0:
            return code
        if self._result is not None:
            return self._result
        if self._asked is not None:
            return _say_asked(self._asked)
        name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
        hint = ", as the system does for want of memory" if -code == signal.SIGKILL else ""
        return _say_failed(f"{self._doing() or 'the process'} was ended by {name}{hint}")

    def _killed(self) -> int:
        """This process ended the child, which was asked to end or has written its results."""
        if self._result is not None:
            return self._result
        if sys.stderr.isatty():
            _write("\r\x1b[K\x1b[?25h", end="")  # of a progress line, and its hidden cursor
        assert self._asked is not None
        return _say_asked(self._asked)

    def _doing(self) -> str:
        with suppress(OSError):
            return (self._scratch / _DOING).read_text(encoding="utf-8")
        return ""


def _say_asked(number: int) -> int:
    _write(WORDS[number])
    return 128 + number


def _say_failed(line: str) -> int:
    _write(f"error: {line}")
    return FAILED


def _write(text: str, end: str = "\n") -> None:
    with suppress(OSError, ValueError):  # standard error may be closed
        os.write(2, (text + end).encode(errors="backslashreplace"))
