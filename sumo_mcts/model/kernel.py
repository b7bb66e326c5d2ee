"""The one door to numba: every compiled function of the package is a `@kernel`."""

import hashlib
import os
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import event

COMPILING = "compiling the search, once for this version (about a minute)"  # to tell whoever waits for it

_F = TypeVar("_F", bound=Callable[..., Any])
_SETTINGS: Any = numba.config  # its options are not in its type hints
_PACKAGE = Path(__file__).resolve().parent.parent


def cache_folder() -> Path:
    """Where compiled code is kept: one folder for each state of the sources, since numba overlooks a change in another file."""
    sources = sorted([*(_PACKAGE / "model").glob("*.py"), *(_PACKAGE / "planners").glob("*.py"), _PACKAGE / "scene.py"])
    key = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    if not _writable(base):
        base = Path(tempfile.gettempdir())
    return base / "sumo_mcts" / f"kernels-{key}"


def is_compiled() -> bool:
    """Whether an earlier run left compiled kernels for these sources."""
    return _CACHE.is_dir() and any(_CACHE.rglob("*.nbc"))


def kernel(function: _F) -> _F:
    """Compile with numba, cached on disk. With NUMBA_DISABLE_JIT=1 the same source runs as plain Python.

    Compiled without reference counts, which would cost more than the arithmetic: such a function cannot make arrays of its own.
    """
    return _compiled(function, _nrt=False)


def inlined(function: _F) -> _F:
    """A kernel that becomes part of its callers: for those with which trying showed that it helps (docs/architecture.md)."""
    return _compiled(function, _nrt=False, forceinline=True)


def making_arrays(function: _F) -> _F:
    """A kernel that makes arrays of its own."""
    return _compiled(function)


def scalar_function(function: _F, signature: str) -> _F:
    """A function of scalars as an argument of kernels: all of one `signature` are one type to numba, so that kernels are compiled, and kept on disk,
    once for all of them. A function that is a kernel already is compiled anew."""
    plain = getattr(function, "py_func", function)
    return cast(_F, plain if _SETTINGS.DISABLE_JIT else numba.cfunc(signature, error_model="numpy")(plain))


class Stopwatch:
    """Runs from the moment it is made, and stands still while this thread compiles kernels or loads them from the disk."""

    def __init__(self) -> None:
        self.began, self._loaded = time.perf_counter(), _LOADING.seconds

    @property
    def loading_s(self) -> float:
        """How long it stood still so far, s."""
        return _LOADING.seconds - self._loaded

    @property
    def seconds(self) -> float:
        """What it shows, s."""
        return time.perf_counter() - self.began - self.loading_s


class _Loading(threading.local):
    """How long a thread has been compiling and loading kernels, s. numba does both under one lock, and announces that."""

    seconds = 0.0
    _depth, _since = 0, 0.0

    def begin(self) -> None:
        if self._depth == 0:
            self._since = time.perf_counter()
        self._depth += 1

    def end(self) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._since


class _Announced(event.Listener):
    """Hands numba's announcements on to the thread that they concern."""

    def on_start(self, _: Any) -> None:
        _LOADING.begin()

    def on_end(self, _: Any) -> None:
        _LOADING.end()


def _compiled(function: _F, **options: Any) -> _F:
    previous = _SETTINGS.CACHE_DIR
    _SETTINGS.CACHE_DIR = str(_CACHE)
    try:
        return cast(_F, numba.njit(cache=True, fastmath=False, error_model="numpy", **options)(function))
    finally:
        _SETTINGS.CACHE_DIR = previous


def _writable(folder: Path) -> bool:
    while not folder.exists():
        folder = folder.parent
    return os.access(folder, os.W_OK)


_CACHE = cache_folder()
_LOADING = _Loading()
event.register("numba:compiler_lock", _Announced())  # type: ignore[no-untyped-call]
