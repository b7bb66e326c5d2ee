"""Where compiled kernels are kept: files in a folder of this user's alone, since what is loaded
from them is executed."""

import atexit
import hashlib
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

try:
    import fcntl
    import grp
    import pwd
except ImportError:  # not on Windows
    fcntl = None  # type: ignore[assignment]
NAME = "sumo_mcts"
SUFFIX = ".kernel"
NOTHING_KEPT = "compiled kernels are not kept"  # how the line begins that says so
MOST_LINKS = 40  # on the way to a folder, as many as Linux follows
POLL_S = 0.05  # between two looks whether another process is done
LONGEST_WAIT_S = (
    120.0  # for what another process compiles: one that is stopped must not stop others
)
_DIGEST = hashlib.sha256().digest_size
Note = Callable[[str], object]


# --- the folder ---


def folder_for(key: str, note: Note) -> Path | None:
    """A folder of this user's alone for what was compiled under `key`.

    Where none lasts, one for this process, and `note` is told; None: nowhere.
    """
    for base in _bases():
        folder = base / f"kernels-{key}"
        with suppress(OSError):
            _make(folder)
            if is_ours(folder):
                return folder
    return _passing(note)


def is_ours(folder: Path) -> bool:
    """Whether only this user can write there, and only this user or root can put another folder in
    its place."""
    if not hasattr(os, "getuid"):  # on Windows a user's folders are the user's
        return True
    try:
        state = folder.lstat()
        alone = (
            stat.S_ISDIR(state.st_mode) and state.st_uid == os.getuid() and not _others_write(state)
        )
        return alone and os.access(folder, os.W_OK | os.X_OK) and _is_safe_way(folder.parent)
    except OSError:
        return False


def _make(folder: Path) -> None:
    """Make a folder, and those that are missing on the way, for this user alone."""
    if not folder.parent.exists():
        _make(folder.parent)
    folder.mkdir(mode=0o700, exist_ok=True)


def _bases() -> Iterator[Path]:
    """Where the folder may lie: in the user's cache folder, else in a folder of the user's own in
    the temporary folder."""
    named = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if named.is_absolute():  # others are to be ignored, as the specification says
        yield named / NAME
    else:
        with suppress(RuntimeError):  # a user without a home
            if Path.home().is_dir():  # else root would make one
                yield Path.home() / ".cache" / NAME
    own = _temporary() / (f"{NAME}-{os.getuid()}" if hasattr(os, "getuid") else NAME)
    with suppress(OSError):
        own.mkdir(mode=0o700, exist_ok=True)
        if is_ours(own):
            yield own


def _temporary() -> Path:
    """The temporary folder that lasts longer than this process, which may have one of its own
    (supervisor.py)."""
    named = Path(os.environ.get("TMPDIR", ""))
    return named if named.is_absolute() else Path("/tmp")


def _passing(note: Note) -> Path | None:
    """A folder for this process alone, which goes when it ends."""
    try:
        folder = Path(tempfile.mkdtemp(prefix=f"{NAME}-"))
    except OSError as error:
        note(f"{NOTHING_KEPT}: no folder can be written: {error.strerror or error}")
        return None
    atexit.register(_remove, folder, os.getpid())
    note(
        f"{NOTHING_KEPT}: neither the cache folder nor {_temporary()} has room for a folder that "
        "is this user's alone"
    )
    return folder


def _remove(folder: Path, process: int) -> None:
    if os.getpid() == process:  # not in a fork of it
        shutil.rmtree(folder, ignore_errors=True)


def _is_safe_way(folder: Path) -> bool:
    """Whether every folder and link on the way belongs to this user or root, and no other user can
    replace what lies in it. Raises OSError."""
    here, todo, links = Path(folder.anchor), list(folder.parts[:0:-1]), 0
    while todo:
        if not _is_safe(here.lstat()):
            return False
        there = here / todo.pop()
        state = there.lstat()
        if not stat.S_ISLNK(state.st_mode):
            here = there
            continue
        links += 1
        if links > MOST_LINKS or state.st_uid not in (0, os.getuid()):
            return False
        target = there.readlink()
        here = Path(target.anchor) if target.is_absolute() else here
        todo += [part for part in target.parts[::-1] if part != target.anchor]
    return _is_safe(here.lstat())


def _others_write(state: os.stat_result) -> bool:
    """Whether other users may write to a file or folder.

    A group of this user alone, as many systems give each user one, is no other.
    """
    by_group = state.st_mode & stat.S_IWGRP and not _is_of_user_alone(state.st_gid)
    return bool(state.st_mode & stat.S_IWOTH or by_group)


def _is_of_user_alone(group: int) -> bool:
    try:
        known, user = grp.getgrgid(group), pwd.getpwuid(os.getuid())
    except KeyError:
        return False
    return (
        known.gr_name == user.pw_name
        and user.pw_gid == group
        and set(known.gr_mem) <= {user.pw_name}
    )


def _is_safe(state: os.stat_result) -> bool:
    """Of a folder: with the sticky bit, as /tmp has it, others may add files but not replace
    ours."""
    open_to_others = _others_write(state) and not state.st_mode & stat.S_ISVTX
    return stat.S_ISDIR(state.st_mode) and state.st_uid in (0, os.getuid()) and not open_to_others


# --- the files ---


class Kept:
    """Something that one process makes and all may read: a file, which is its lock too.

    It holds a digest, then the content; it is empty where nothing is kept, or the process was
    interrupted.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: int | None = None  # descriptor, while we hold the lock

    def read(self) -> bytes | None:
        """The content; None where there is none, or not as it was written."""
        with suppress(OSError):
            written = self._path.read_bytes()
            content = written[_DIGEST:]
            if content and hashlib.sha256(content).digest() == written[:_DIGEST]:
                return content
        return None

    def is_there(self) -> bool:
        """Whether something was written, is whole, and is not being written now."""
        with suppress(OSError):
            return self._path.stat().st_size > 0 and not self.is_taken() and self.read() is not None
        return False

    def is_taken(self) -> bool:
        """Whether another process holds the lock."""
        if self._file is not None:
            return False
        free = self._try()
        self.release()
        return not free

    def take(self, waiting: Callable[[float], object]) -> None:
        """Hold the lock.

        `waiting` is told, again and again, for how many seconds another process has held it; after
        LONGEST_WAIT_S we go on without.
        """
        began = time.monotonic()
        while not self._try() and time.monotonic() - began < LONGEST_WAIT_S:
            waiting(time.monotonic() - began)
            time.sleep(POLL_S)

    def write(self, content: bytes) -> None:
        """Keep the content, if we hold the lock. Raises OSError, and then keeps nothing."""
        if self._file is None:
            return
        try:
            self._fill(hashlib.sha256(content).digest() + content)
        except OSError:
            os.ftruncate(self._file, 0)
            raise

    def release(self) -> None:
        """Give the lock back, if we hold it."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _fill(self, content: bytes) -> None:
        assert self._file is not None, "the lock is held"
        os.ftruncate(self._file, 0)
        os.lseek(self._file, 0, os.SEEK_SET)
        while content:
            content = content[os.write(self._file, content) :]

    def _try(self) -> bool:
        """Take the lock, unless another process holds it.

        Where there are no locks, as on some disks of a network, or no file, there is nothing to
        wait for.
        """
        if fcntl is None:
            return True
        try:
            file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        except OSError:
            return True
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(file)
            return False
        except OSError:
            pass  # written without a lock; the digest tells what is whole
        self._file = file
        return True
