"""How a command ends: an error becomes one line on standard error and an exit status.

docs/reliability.md lists them.
"""

import _thread
import errno
import os
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sumo_mcts.errors import ConfigError, FailedError, in_one_line, of_machine, printable
from sumo_mcts.process.supervisor import AGAIN_S, DEBUG, asked_to_end, heeding

OK, FAILED, INVALID = 0, 1, 2  # and 128 + N where signal N asked for the end
# An error without the name of a file is about standard output, where it is one of these.
_OF_OUTPUT = frozenset({errno.ENOSPC, errno.EIO, errno.EPIPE, errno.EBADF})


def ended(command: Callable[[], object]) -> int:
    """Run a command; its exit status. An error or a signal becomes one line on standard error."""
    asked: list[int] = []

    def interrupt(number: int) -> None:
        asked.append(number)
        raise KeyboardInterrupt

    sys.unraisablehook = _interrupt_again
    line, result = "", OK
    with heeding(interrupt):
        try:
            answer = command()
            result = answer if isinstance(answer, int) else OK
        except (Exception, SystemExit, KeyboardInterrupt) as error:
            if os.environ.get(DEBUG) and not asked:
                traceback.print_exc()
            line, result = explained(error)
    if asked:  # whatever a compiler or a callback made of the interrupt
        return asked_to_end(asked[0])
    tell(line)
    return result


def explained(error: BaseException) -> tuple[str, int]:
    """The line and the exit status for an error; no line where one was written before."""
    if isinstance(error, SystemExit):
        return _of_exit(error)
    if isinstance(error, ConfigError):
        return f"error: {error}", INVALID
    if isinstance(error, FailedError):
        return f"error: {error}", FAILED
    if of_machine(error):
        return f"error: {_shortage(error)}", FAILED
    if isinstance(error, OSError):
        return f"error: {_of_file(error)}", INVALID
    place = traceback.extract_tb(error.__traceback__)[-1]
    where = f"{Path(place.filename).name}, line {place.lineno}"
    return (
        (
            f"error: a fault of sumo-mcts: {in_one_line(error)} ({where}); {DEBUG}=1 shows the "
            "traceback"
        ),
        FAILED,
    )


def tell(line: str) -> None:
    """Write a line to standard error, if it is there; "": nothing.

    Control characters, as ids may have them, are escaped.
    """
    if line:
        with suppress(OSError, ValueError):
            print(printable(line), file=sys.stderr, flush=True)  # noqa: T201


@contextmanager
def exiting(exit_with: Callable[[int], BaseException]) -> Iterator[None]:
    """An error that is raised inside becomes one line on standard error.

    Then `exit_with` of the exit status is raised.
    """
    try:
        yield
    except (ConfigError, FailedError, OSError, MemoryError) as error:
        line, status = explained(error)
        tell(line)
        raise exit_with(status) from None


def _of_exit(error: SystemExit) -> tuple[str, int]:
    """Libraries for command lines exit without a line where standard output is a closed pipe."""
    if isinstance(error.__context__, OSError):
        return explained(error.__context__)
    return "", error.code if isinstance(error.code, int) else FAILED


def _shortage(error: BaseException) -> str:
    if isinstance(error, OSError):
        return _of_file(error)
    return (
        "not enough memory"
        if isinstance(error, MemoryError)
        else "the system starts no further threads"
    )


def _of_file(error: OSError) -> str:
    name = error.filename or ("standard output" if error.errno in _OF_OUTPUT else "")
    return ": ".join(str(part) for part in (name, error.strerror or error) if part)


def _interrupt_again(unraisable: "sys.UnraisableHookArgs") -> None:
    """Python ignores an interrupt in a finalizer, or in a callback from compiled code.

    Another interrupt follows, once that is over.
    """

    def later() -> None:
        time.sleep(AGAIN_S)  # sooner it would count as the same signal
        _thread.interrupt_main()

    if unraisable.exc_type is KeyboardInterrupt:
        _thread.start_new_thread(later, ())
    else:
        sys.__unraisablehook__(unraisable)
