"""The only module that uses numba: the decorators for compiled functions, and their cache on disk.

kernel, inlined          called by other kernels
entry                    called by Python
making_arrays, lengthy   called by Python, and allocate arrays
"""

import hashlib
import pickle
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar, cast

import numba.core.serialize

from sumo_mcts.numerics.announce import announcer
from sumo_mcts.numerics.kept import NOTHING_KEPT, SUFFIX, Kept, folder_for

_F = TypeVar("_F", bound=Callable[..., Any])
Types = tuple[Any, ...]  # numba types of the arguments of a kernel
_NUMBA: Any = numba.core  # Any, since numba has few type hints
_TYPES: Any = numba.types
_SETTINGS: Any = numba.config
_PACKAGE = Path(__file__).resolve().parent.parent
_COMPILED = ("numerics", "prediction", "model", "planners", "evaluation")  # packages with kernels
# fields of tuples that kernels read, beside the tuples in those packages
_TUPLES = ("road.py", "scene.py", "config/sections/cost.py")


# --- how functions become kernels ---


def kernel(function: _F) -> _F:
    """A function that other kernels call: compiled, and kept on disk.

    Python can call it too, but then it runs as plain Python, with the same results. A wrapper for
    compiled calls from Python would take a third of the compile time; `entry` makes one.

    The code is compiled without reference counts, which would cost more than the arithmetic. So
    the function cannot allocate arrays. With NUMBA_DISABLE_JIT=1 everything runs as plain Python.
    """
    return _compiled(Part, function, _nrt=False, no_cpython_wrapper=True)


def inlined(function: _F) -> _F:
    """A kernel that is inlined into its callers.

    For the few functions that were measured to be faster so (docs/decisions/inlined-kernels.md).
    """
    return _compiled(Part, function, _nrt=False, no_cpython_wrapper=True, forceinline=True)


def entry(function: _F) -> _F:
    """A kernel that Python calls. Other threads go on meanwhile."""
    return _compiled(Kernel, function, _nrt=False, nogil=True)


def making_arrays(function: _F) -> _F:
    """A kernel that Python calls, and that allocates arrays."""
    return _compiled(Kernel, function)


def lengthy(function: _F) -> _F:
    """Like `making_arrays`, for a function that would take minutes as plain Python.

    It is compiled at its first call, even during the trial of prepare.py.
    """
    return _compiled(Lengthy, function)


def scalar_function(function: _F, signature: str) -> _F:
    """A function of scalars that can be passed to kernels as an argument.

    All functions of one `signature` have one type in numba. So kernels are compiled, and kept on
    disk, once for all of them. A `function` that is a kernel already is compiled again.
    """
    plain = getattr(function, "py_func", function)
    return cast(_F, plain if is_plain() else numba.cfunc(signature, error_model="numpy")(plain))


def is_plain() -> bool:
    """Whether compilation is off (NUMBA_DISABLE_JIT=1)."""
    return bool(_SETTINGS.DISABLE_JIT)


def _compiled(kind: "type[Kernel]", function: _F, **options: Any) -> _F:
    if is_plain():
        return function
    common = {
        "nopython": True,
        "boundscheck": None,
        "fastmath": False,
        "error_model": "numpy",
        "no_cfunc_wrapper": True,
    }
    made = kind(function, targetoptions={**common, **options})
    made.enable_caching()
    return cast(_F, made)


# --- the cache on disk ---


_given: list[Path] = []  # in a second process (prepare.py): the folder of the first one


def folder() -> Path | None:
    """The folder of compiled kernels; None: they are not kept."""
    return _given[-1] if _given else _own_folder()


def keep_in(place: Path) -> None:
    """Keep compiled kernels in this folder from now on."""
    _given.append(place)


@cache
def _own_folder() -> Path | None:
    """A folder for this state of the sources and this environment."""
    files = [path for package in _COMPILED for path in sorted((_PACKAGE / package).glob("*.py"))]
    # numba overlooks changes in another file that a kernel calls, and names and order of fields
    files += [_PACKAGE / name for name in _TUPLES]
    sources = b"".join(path.read_bytes() for path in files)
    return folder_for(
        hashlib.sha256(repr(environment()).encode() + sources).hexdigest()[:16],
        lambda line: announcer().notes(line),
    )


def environment() -> tuple[object, ...]:
    """What compiled code depends on beside the sources: versions, processor, optimisation level."""
    processor = _NUMBA.registry.cpu_target.target_context.codegen().magic_tuple()
    return (
        numba.__version__,
        version("llvmlite"),
        sys.version,
        sys.implementation.cache_tag,
        *map(str, processor),
        str(_SETTINGS.OPT),
    )


def kept_kernels() -> int:
    """The number of compiled kernels on disk for this environment."""
    where = None if is_plain() else folder()
    return 0 if where is None else sum(path.stat().st_size > 0 for path in where.glob(f"*{SUFFIX}"))


@cache
def _source(path: str) -> bytes:
    return Path(path).read_bytes()


class _Cache:
    """The compiled kernels of one function, with the methods of numba's own cache classes.

    A file that cannot be loaded counts as missing.
    """

    def __init__(self, function: Callable[..., Any], options: object) -> None:
        self._function, self._options = function, options
        self._kept: dict[Types, Kept] = {}

    def kept(self, arguments: Types) -> Kept | None:
        """The file of the kernel for these types of arguments; None: it is not kept."""
        where, code = folder(), self._function.__code__
        if where is None:
            return None
        if arguments not in self._kept:
            digest = hashlib.sha256(
                repr((arguments, self._options, code.co_firstlineno)).encode()
                + _source(code.co_filename)
            ).hexdigest()[:16]
            name = f"{self._function.__module__.rpartition('.')[2]}.{self._function.__qualname__}"
            self._kept[arguments] = Kept(where / f"{name}-{digest}{SUFFIX}")
        return self._kept[arguments]

    def load_overload(self, arguments: Types, context: Any) -> Any:
        """The kernel from disk, or None.

        After None this process holds the lock on the file, so that other processes wait until it
        has compiled the kernel.
        """
        kept = self.kept(arguments)
        if kept is None:
            return None
        context.refresh()
        found = _rebuilt(kept, context)
        if found is None:
            kept.take(announcer().waits)
            found = _rebuilt(kept, context)  # another process may have compiled it meanwhile
        return found

    def save_overload(self, arguments: Types, result: Any) -> None:
        """Write the kernel to disk, where that is possible."""
        kept = self.kept(arguments)
        if kept is None or result.library.has_dynamic_globals:
            return
        try:
            kept.write(_NUMBA.serialize.dumps(result._reduce()))
        except OSError as error:
            announcer().notes(f"{NOTHING_KEPT}: {folder()}: {error.strerror or error}")

    def release(self, arguments: Types) -> None:
        """Release the lock on the file."""
        if arguments in self._kept:
            self._kept[arguments].release()


def _rebuilt(kept: Kept, context: Any) -> Any:
    """The kernel in a file, as numba needs it; None where the file is missing or damaged."""
    content = kept.read()
    if content is None:
        return None
    try:
        return _NUMBA.compiler.CompileResult._rebuild(context, *pickle.loads(content))
    except Exception:
        return None


# --- classes of kernels ---

Run = Callable[["Kernel", Sequence[Any]], Any]
_trials: list[Run] = []  # the last one is called instead of compiling (see `tried`)


@contextmanager
def tried(run: Run) -> Iterator[None]:
    """Inside the block nothing is compiled: `run` is called with the kernel and its arguments.

    This holds for kernels that are not on disk yet, and for all kernels that they call.
    """
    _trials.append(run)
    try:
        yield
    finally:
        _trials.remove(run)


class Kernel(_NUMBA.registry.CPUDispatcher):  # type: ignore[misc]
    """A compiled function."""

    def enable_caching(self) -> None:
        """Keep compiled code on disk. numba calls this method by its name."""
        self._cache = _Cache(self.py_func, sorted(self.targetoptions.items()))

    def kept(self, arguments: Types) -> Kept | None:
        """The file of the compiled code for these types of arguments; None: it is not kept."""
        return self._cache.kept(arguments)

    def types_of(self, args: Sequence[Any]) -> Types:
        """The numba types of these arguments."""
        return tuple(self.typeof_pyval(each) for each in args)

    def compile(self, sig: Types) -> Any:
        """The compiled function for these types of arguments, from disk or compiled now."""
        try:
            return super().compile(sig)
        finally:
            self._cache.release(sig)

    def get_call_template(self, args: Sequence[Any], kws: dict[str, Any]) -> Any:
        """The signature with which another kernel calls this one: with types made `general`."""
        return super().get_call_template(
            [general(each) for each in args], {name: general(each) for name, each in kws.items()}
        )

    def _compile_for_args(self, *args: Any, **kws: Any) -> Any:
        if not _trials or not self._can_wait(args):
            return super()._compile_for_args(*args, **kws)
        run = _trials[-1]
        return lambda *given: run(self, given)

    def _can_wait(self, args: Sequence[Any]) -> bool:
        """Whether a call with these arguments may run as plain Python during a trial: it may where
        no compiled code for them is on disk."""
        if any(isinstance(each, _NUMBA.dispatcher.OmittedArg) for each in args):
            return False
        kept = self.kept(self.types_of(args))
        return kept is not None and kept.read() is None


class Part(Kernel):
    """A kernel that only other kernels call as compiled code."""

    def __call__(self, *args: Any, **kws: Any) -> Any:
        """Run the source as plain Python."""
        return _trials[-1](self, args) if _trials and not kws else self.py_func(*args, **kws)


class Lengthy(Kernel):
    """A kernel that would take too long as plain Python."""

    def _can_wait(self, args: Sequence[Any]) -> bool:
        return False


def general(kind: Any) -> Any:
    """The type of an argument for which a kernel is compiled.

    Constants and short integers become int64, so that one compilation serves all of them.
    """
    kind = _TYPES.unliteral(kind)
    return (
        _TYPES.int64
        if isinstance(kind, _TYPES.Integer)
        and kind.signed
        and kind.bitwidth < _TYPES.int64.bitwidth
        else kind
    )


class _Listener(_NUMBA.event.Listener):  # type: ignore[misc]
    def on_start(self, event: Any) -> None:
        """Announce the compilation of a kernel."""
        if isinstance(event.data["dispatcher"], Kernel):
            announcer().compiles()

    def on_end(self, event: Any) -> None:
        """Nothing to announce."""


_NUMBA.event.register("numba:compile", _Listener())


# --- time without compilation ---


class Stopwatch:
    """Measures time from its creation on, without the time in which this thread compiles kernels or
    loads them from disk."""

    def __init__(self) -> None:
        self.began, self._loaded = time.perf_counter(), _LOADING.seconds

    @property
    def loading_s(self) -> float:
        """Time in which this thread compiled or loaded kernels, s."""
        return _LOADING.seconds - self._loaded

    @property
    def seconds(self) -> float:
        """Time since the creation, without `loading_s`, s."""
        return time.perf_counter() - self.began - self.loading_s


class _Loading(threading.local):
    """For each thread, the time in which it compiled and loaded kernels, s.

    numba does both under one lock, and sends an event when it takes or releases the lock.
    """

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


class _Announced(_NUMBA.event.Listener):  # type: ignore[misc]
    """Passes the events of that lock on to `_LOADING`, in the thread that holds the lock."""

    def on_start(self, _: Any) -> None:
        _LOADING.begin()

    def on_end(self, _: Any) -> None:
        _LOADING.end()


_LOADING = _Loading()
_NUMBA.event.register("numba:compiler_lock", _Announced())
