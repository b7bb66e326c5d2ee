"""A forked, exact copy of this process and the simulation in it: an oracle.

The copy drives on, writes what came of it into a pipe, and ends. It has the state of every random
generator, so its drivers and insertions draw the same numbers.
"""

import contextlib
import os
import select
import signal
import stat
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import numpy as np

from sumo_mcts.arrays import Floats
from sumo_mcts.errors import ConfigError
from sumo_mcts.process.supervisor import WORDS, die_with_parent
from sumo_mcts.registry import without
from sumo_mcts.scene import Scripted
from sumo_mcts.world.observe import LANE, POSE, POSITION, SPEED, THERE
from sumo_mcts.world.simulation import SimulationError, option

PATIENCE_S = 60.0  # wall time for which an answer is waited for
_FDS = Path("/proc/self/fd")
_EPS = 1e-9


def require_possible(gui: bool) -> None:
    """Raise ConfigError where no simulation can be copied."""
    if sys.platform != "linux":
        _refuse("copies the running process, which works on Linux only")
    if gui:
        _refuse("a copy has no window; leave --gui out")


def require_copyable() -> None:
    """Raise ConfigError where the running simulation cannot be copied.

    With several threads a copy would have one, and wait for the others for ever. With saved states
    it would save those of a time to come.
    """
    for name in ("threads", "device.rerouting.threads"):
        if int(option(name)) > 1:
            _refuse(f"SUMO's option {name} is {option(name)}, a copy has one thread; leave it out")
    for name, never in (("save-state.period", "-1"), ("save-state.times", "")):
        if option(name) != never:
            _refuse(f"SUMO's option {name} is {option(name)}, a copy saves no states; leave it out")


def _refuse(why: str) -> NoReturn:
    raise ConfigError(f"prediction.name: clone: {why}; allowed here: {', '.join(without('clone'))}")


def in_copy(work: Callable[[], Floats], shape: tuple[int, ...]) -> Floats:
    """What `work` returns (float64, of this shape) when it is done in a copy of this process.

    Raises SimulationError where the copy fails.
    """
    ours, theirs = os.pipe()
    try:
        with warnings.catch_warnings():
            # Python warns of other threads: the copy does not need them
            warnings.simplefilter("ignore", DeprecationWarning)
            child = os.fork()
    except OSError:  # a shortage of the machine
        os.close(ours)
        os.close(theirs)
        raise
    if child == 0:
        _run_copy(work, theirs)
    try:
        os.close(theirs)
        answer = _read_all(ours)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        child = 0
    finally:
        os.close(ours)
        if child:  # whatever happened, no process is left behind
            # it may have ended just before
            with contextlib.suppress(ProcessLookupError, ChildProcessError):
                os.kill(child, signal.SIGKILL)
                os.waitpid(child, 0)
    if status == 0 and len(answer) == 8 * int(np.prod(shape)):
        return np.frombuffer(answer, np.float64).reshape(shape)
    how = f"by signal {-status}" if status < 0 else f"with status {status}"
    raise SimulationError(
        f"the copy of the simulation ended {how}"
        + (f": {answer.decode(errors='replace')}" if status > 0 and answer else "")
    )


def at_times(states: Floats, every: float, dt: float, count: int) -> dict[int, Scripted]:
    """The states of N agents at `count` times `dt` s apart, by index.

    `states` [R, N, 8] (columns as in observe.py) are `every` s apart; between two rows an agent
    moves on a straight line.
    """
    place = np.arange(count) * dt / every
    low = np.minimum(np.floor(place + _EPS).astype(int), len(states) - 1)
    high = np.minimum(low + 1, len(states) - 1)
    share = np.where(place - low < _EPS, 0.0, place - low)[:, None, None]
    there = (states[low, :, THERE] > 0.0) & (
        (states[high, :, THERE] > 0.0) | (share[:, :, 0] == 0.0)
    )
    mixed = np.where(
        there[:, :, None], states[low] + share * (states[high] - states[low]), states[low]
    )
    lane = states[low, :, LANE].astype(np.int32)
    s = np.where(states[high, :, LANE] == lane, mixed[:, :, POSITION], states[low, :, POSITION])
    pose = mixed[:, :, POSE]
    return {
        i: Scripted(
            pose=pose[:, i].copy(),
            v=mixed[:, i, SPEED].copy(),
            lane=lane[:, i],
            s=s[:, i],
            valid=there[:, i],
        )
        for i in range(states.shape[1])
    }


def _run_copy(work: Callable[[], Floats], pipe: int) -> NoReturn:
    """All that a copy does, from the fork to its exit."""
    status = 1
    try:
        try:
            for number in WORDS:
                signal.signal(number, signal.SIG_DFL)
            die_with_parent()
            _detach(pipe)
            answer, status = np.ascontiguousarray(work(), np.float64).tobytes(), 0
        except BaseException as error:  # into the answer: no code above may go on
            answer = f"{type(error).__name__}: {error}".encode()
        while answer:
            answer = answer[os.write(pipe, answer) :]
    finally:
        os._exit(status)  # nothing is flushed or cleaned up twice


def _detach(pipe: int) -> None:
    """Cut the copy off from the files of the original.

    What it writes goes into the pipe alone. Files that are being read it reads with a position of
    its own. It can open no others.
    """
    import fcntl  # not on Windows
    import resource

    nowhere = os.open(os.devnull, os.O_RDWR)
    for number in [int(link.name) for link in _FDS.iterdir()]:
        if number in (pipe, nowhere):
            continue
        try:
            mode = os.fstat(number).st_mode
        except OSError:
            continue  # that of the listing itself
        if fcntl.fcntl(number, fcntl.F_GETFL) & os.O_ACCMODE != os.O_RDONLY:
            os.dup2(nowhere, number)
        elif stat.S_ISREG(mode):
            # SUMO reads route files bit by bit: with a shared position the original would miss what
            # the copy has read
            own = os.open(_FDS / str(number), os.O_RDONLY)
            os.lseek(own, os.lseek(number, 0, os.SEEK_CUR), os.SEEK_SET)
            os.dup2(own, number)
            os.close(own)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, 0))


def _read_all(pipe: int) -> bytes:
    """Everything up to the pipe's end."""
    parts: list[bytes] = []
    until = time.monotonic() + PATIENCE_S
    while True:
        ready, _, _ = select.select([pipe], [], [], max(0.0, until - time.monotonic()))
        if not ready:
            raise SimulationError(
                f"the copy of the simulation did not answer within {PATIENCE_S:g} s"
            )
        part = os.read(pipe, 1 << 20)
        if not part:
            return b"".join(parts)
        parts.append(part)
