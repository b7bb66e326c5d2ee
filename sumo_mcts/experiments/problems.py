"""Why a batch cannot go on, in one line."""

from collections.abc import Callable
from pathlib import Path

from sumo_mcts.errors import FailedError


class BatchError(FailedError):
    """A batch that could not go on: what is done is kept, and the same command goes on.

    One line.
    """


def kept(out: Path, write: Callable[[], object]) -> None:
    """Write into the folder `out`. Raises BatchError where the disk does not take it."""
    try:
        write()
    except OSError as error:
        raise exhausted(f"--out {out}", error) from None


def lost(error: BaseException) -> BatchError:
    """The error if no worker is left."""
    return BatchError(
        f"the workers are lost ({_reason(error)}); what is done is kept, and the same command "
        "goes on"
    )


def exhausted(where: str, error: BaseException) -> BatchError:
    """The message if the machine has no memory, disk space, processes or files left."""
    reason = getattr(error, "strerror", None) or _reason(error)
    return BatchError(
        f"{where}: {reason}; what is done is kept, and the same command goes on when that is mended"
    )


def _reason(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__} {error}".split())
