"""The files of compiled kernels, in a folder to which only this user can write; large networks lie
in such a folder, too.

The content of these files is executed, so no other user may change them.
"""

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
NOTHING_KEPT = "compiled kernels are not kept"  # begin of the message, the reason follows
MOST_LINKS = 40  # symbolic links in the path of a folder, as many as Linux follows
POLL_S = 0.05  # between two checks whether another process has finished
# Longest wait for another process that compiles: if that one is suspended, this one must go on.
LONGEST_WAIT_S = 120.0
_DIGEST = hashlib.sha256().digest_size
Note = Callable[[str], object]


# --- the folder ---


def folder_for(key: str, note: Note) -> Path | None:
    """A folder to which only this user can write, for kernels compiled under `key`.

    If no lasting folder can be used, it is one for this process, and `note` gets a message.
    None: no folder can be made.
    """
    return lasting_folder(f"kernels-{key}") or _for_this_process(note)


def lasting_folder(name: str) -> Path | None:
    """A folder to which only this user can write, in the cache folder or else in the temporary one;
    None: there can be none."""
    for base in _bases():
        folder = base / name
        with suppress(OSError):
            _make(folder)
            if is_ours(folder):
                return folder
    return None


def is_ours(folder: Path) -> bool:
    """Whether only this user can write to a folder, and only this user or root can replace it."""
    if not hasattr(os, "getuid"):  # Windows: folders of a user are private
        return True
    try:
        state = folder.lstat()
        alone = (
            stat.S_ISDIR(state.st_mode) and state.st_uid == os.getuid() and not _others_write(state)
        )
        return alone and os.access(folder, os.W_OK | os.X_OK) and _is_safe_path(folder.parent)
    except OSError:
        return False


def _make(folder: Path) -> None:
    """Make a folder and its missing parents, for this user alone."""
    if not folder.parent.exists():
        _make(folder.parent)
    folder.mkdir(mode=0o700, exist_ok=True)


def _bases() -> Iterator[Path]:
    """Possible parents of the folder: in the user's cache folder, then in the temporary folder."""
    named = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if named.is_absolute():  # the XDG specification: ignore relative paths
        yield named / NAME
    else:
        with suppress(RuntimeError):  # the user has no home folder
            if Path.home().is_dir():  # else root would create it
                yield Path.home() / ".cache" / NAME
    own = _temporary() / (f"{NAME}-{os.getuid()}" if hasattr(os, "getuid") else NAME)
    with suppress(OSError):
        own.mkdir(mode=0o700, exist_ok=True)
        if is_ours(own):
            yield own


def _temporary() -> Path:
    """The temporary folder of the system.

    The tempfile module may return one that the supervisor removes when this process ends.
    """
    named = Path(os.environ.get("TMPDIR", ""))
    return named if named.is_absolute() else Path("/tmp")


def _for_this_process(note: Note) -> Path | None:
    """A folder for this process alone, removed when the process ends."""
    try:
        folder = Path(tempfile.mkdtemp(prefix=f"{NAME}-"))
    except OSError as error:
        note(f"{NOTHING_KEPT}: no folder can be written: {error.strerror or error}")
        return None
    atexit.register(_remove, folder, os.getpid())
    note(
        f"{NOTHING_KEPT}: neither in the cache folder nor in {_temporary()} is there a folder "
        "to which only this user can write"
    )
    return folder


def _remove(folder: Path, process: int) -> None:
    if os.getpid() == process:  # not in a fork of that process
        shutil.rmtree(folder, ignore_errors=True)


def _is_safe_path(folder: Path) -> bool:
    """Whether no other user can replace a folder.

    So every folder and link of its path must belong to this user or root, and no other user may
    write to the folders. Raises OSError.
    """
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

    Many systems give each user a group of one member. Such a group counts as this user.
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
    """Whether no other user can replace files in a folder.

    With the sticky bit, as in /tmp, other users may add files but not replace ours.
    """
    open_to_others = _others_write(state) and not state.st_mode & stat.S_ISVTX
    return stat.S_ISDIR(state.st_mode) and state.st_uid in (0, os.getuid()) and not open_to_others


# --- the files ---


class Kept:
    """A file that one process writes and all may read. The file is also the lock for writing it.

    It holds a digest, then the content. It is empty until the content was written, also where the
    writing process was interrupted.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: int | None = None  # file descriptor, while this object holds the lock

    def read(self) -> bytes | None:
        """The content; None where it is missing or damaged."""
        with suppress(OSError):
            written = self._path.read_bytes()
            content = written[_DIGEST:]
            if content and hashlib.sha256(content).digest() == written[:_DIGEST]:
                return content
        return None

    def is_there(self) -> bool:
        """Whether the content is complete, and no other process is writing it."""
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
        """Take the lock, and wait for it while another process holds it.

        During the wait `waiting` is called again and again with the seconds so far. After
        LONGEST_WAIT_S this returns without the lock.
        """
        began = time.monotonic()
        while not self._try() and time.monotonic() - began < LONGEST_WAIT_S:
            waiting(time.monotonic() - began)
            time.sleep(POLL_S)

    def write(self, content: bytes) -> None:
        """Write the content, if this object holds the lock. After an OSError the file is empty."""
        if self._file is None:
            return
        try:
            self._fill(hashlib.sha256(content).digest() + content)
        except OSError:
            os.ftruncate(self._file, 0)
            raise

    def release(self) -> None:
        """Release the lock, if this object holds it."""
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
        """Take the lock if it is free. Returns False where another process holds it.

        Returns True without a lock where the file cannot be opened, or the disk has no locks (some
        network disks): waiting would not help.
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
            pass  # written without a lock: the digest shows whether the content is complete
        self._file = file
        return True
