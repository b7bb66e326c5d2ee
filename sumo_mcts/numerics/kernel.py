"""The one door to numba: every compiled function of the package is a `@kernel` or an `@entry`."""

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

from sumo_mcts.numerics.announce import teller
from sumo_mcts.numerics.kept import NOTHING_KEPT, SUFFIX, Kept, folder_for

_F = TypeVar("_F", bound=Callable[..., Any])
Types = tuple[Any, ...]  # of arguments, as numba calls them
_NUMBA: Any = numba.core  # has few type hints
_TYPES: Any = numba.types
_SETTINGS: Any = numba.config
_PACKAGE = Path(__file__).resolve().parent.parent
_COMPILED = ("numerics", "prediction", "model", "planners", "evaluation")  # packages with kernels


# --- how functions become kernels ---


def kernel(function: _F) -> _F:
    """A function that other kernels call: compiled, and kept on disk.

    Where Python calls it, it runs as plain Python, with the same results.

    What Python would need to call it compiled takes a third of all compilation; see `entry`.
    Compiled without reference counts, which would cost more than the arithmetic: such a function
    cannot make arrays of its own. With NUMBA_DISABLE_JIT=1 everything runs as plain Python.
    """
    return _compiled(Part, function, _nrt=False, no_cpython_wrapper=True)


def inlined(function: _F) -> _F:
    """A kernel that becomes part of its callers: for those with which trying showed that it helps
    (docs/architecture.md)."""
    return _compiled(Part, function, _nrt=False, no_cpython_wrapper=True, forceinline=True)


def entry(function: _F) -> _F:
    """A kernel that Python calls."""
    return _compiled(Kernel, function, _nrt=False)


def making_arrays(function: _F) -> _F:
    """A kernel that Python calls, and that makes arrays of its own."""
    return _compiled(Kernel, function)


def lengthy(function: _F) -> _F:
    """The same, where plain Python would take minutes."""
    return _compiled(Lengthy, function)


def scalar_function(function: _F, signature: str) -> _F:
    """A function of scalars as an argument of kernels: all of one `signature` are one type to
    numba, so that kernels are compiled, and kept on disk, once for all of them. A function that is
    a kernel already is compiled anew."""
    plain = getattr(function, "py_func", function)
    return cast(_F, plain if is_plain() else numba.cfunc(signature, error_model="numpy")(plain))


def is_plain() -> bool:
    """Whether nothing is compiled at all."""
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


# --- where they are kept ---


_given: list[Path] = []  # the folder of the process that this one assists


def folder() -> Path | None:
    """Where compiled kernels are kept; None: nowhere."""
    return _given[-1] if _given else _own_folder()


def keep_in(place: Path) -> None:
    """Keep them there from now on."""
    _given.append(place)


@cache
def _own_folder() -> Path | None:
    """One for each state of the sources and each environment."""
    files = [path for package in _COMPILED for path in sorted((_PACKAGE / package).glob("*.py"))]
    # numba overlooks a change in another file that a kernel calls
    sources = b"".join(path.read_bytes() for path in [*files, _PACKAGE / "scene.py"])
    return folder_for(
        hashlib.sha256(repr(environment()).encode() + sources).hexdigest()[:16],
        lambda line: teller().notes(line),
    )


def environment() -> tuple[object, ...]:
    """What compiled code depends on beside the sources: versions, processor, level of
    optimisation."""
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
    """How many compiled kernels are there for this environment."""
    where = None if is_plain() else folder()
    return 0 if where is None else sum(path.stat().st_size > 0 for path in where.glob(f"*{SUFFIX}"))


@cache
def _source(path: str) -> bytes:
    return Path(path).read_bytes()


class _Cache:
    """The compiled kernels of one function, in the form in which numba asks for them.

    What cannot be loaded is as if it were not there.
    """

    def __init__(self, function: Callable[..., Any], options: object) -> None:
        self._function, self._options = function, options
        self._kept: dict[Types, Kept] = {}

    def kept(self, arguments: Types) -> Kept | None:
        """Where the kernel for these types of arguments is kept; None: nowhere."""
        where, code = folder(), self._function.__code__
        if where is None:
            return None
        if arguments not in self._kept:
            told = hashlib.sha256(
                repr((arguments, self._options, code.co_firstlineno)).encode()
                + _source(code.co_filename)
            ).hexdigest()[:16]
            name = f"{self._function.__module__.rpartition('.')[2]}.{self._function.__qualname__}"
            self._kept[arguments] = Kept(where / f"{name}-{told}{SUFFIX}")
        return self._kept[arguments]

    def load_overload(self, arguments: Types, context: Any) -> Any:
        """The kernel.

        None where there is none: then we hold the lock from now on, and another process that comes
        meanwhile waits.
        """
        kept = self.kept(arguments)
        if kept is None:
            return None
        context.refresh()
        found = _rebuilt(kept, context)
        if found is None:
            kept.take(teller().waits)
            found = _rebuilt(kept, context)  # another process may have made it meanwhile
        return found

    def save_overload(self, arguments: Types, result: Any) -> None:
        """Keep the kernel, where that is possible."""
        kept = self.kept(arguments)
        if kept is None or result.library.has_dynamic_globals:
            return
        try:
            kept.write(_NUMBA.serialize.dumps(result._reduce()))
        except OSError as error:
            teller().notes(f"{NOTHING_KEPT}: {folder()}: {error.strerror or error}")

    def release(self, arguments: Types) -> None:
        """Let other processes have it."""
        if arguments in self._kept:
            self._kept[arguments].release()


def _rebuilt(kept: Kept, context: Any) -> Any:
    """A kernel as numba wants it; None where that fails, whatever damage may be the reason."""
    content = kept.read()
    if content is None:
        return None
    try:
        return _NUMBA.compiler.CompileResult._rebuild(context, *pickle.loads(content))
    except Exception:
        return None


# --- what they are ---

Run = Callable[["Kernel", Sequence[Any]], Any]
_trials: list[Run] = []  # the last one runs what is not compiled yet, instead of its being compiled


@contextmanager
def tried(run: Run) -> Iterator[None]:
    """Meanwhile `run` is called with each kernel that is not kept, instead of its being compiled,
    and with those that it calls."""
    _trials.append(run)
    try:
        yield
    finally:
        _trials.remove(run)


class Kernel(_NUMBA.registry.CPUDispatcher):  # type: ignore[misc]
    """A compiled function."""

    def enable_caching(self) -> None:
        """Keep what is compiled."""
        self._cache = _Cache(self.py_func, sorted(self.targetoptions.items()))

    def kept(self, arguments: Types) -> Kept | None:
        """Where it is kept for these types of arguments; None: nowhere."""
        return self._cache.kept(arguments)

    def types_of(self, args: Sequence[Any]) -> Types:
        """What numba takes these arguments for."""
        return tuple(self.typeof_pyval(each) for each in args)

    def compile(self, sig: Types) -> Any:
        """The function for these types of arguments, loaded or compiled."""
        try:
            return super().compile(sig)
        finally:
            self._cache.release(sig)

    def get_call_template(self, args: Sequence[Any], kws: dict[str, Any]) -> Any:
        """How other kernels call it: as `general` has the types of the arguments."""
        return super().get_call_template(
            [general(each) for each in args], {name: general(each) for name, each in kws.items()}
        )

    def _compile_for_args(self, *args: Any, **kws: Any) -> Any:
        if not _trials or not self._can_wait(args):
            return super()._compile_for_args(*args, **kws)
        run = _trials[-1]
        return lambda *given: run(self, given)

    def _can_wait(self, args: Sequence[Any]) -> bool:
        """Whether a call with these arguments may run as plain Python for now: nothing is kept for
        them."""
        if any(isinstance(each, _NUMBA.dispatcher.OmittedArg) for each in args):
            return False
        kept = self.kept(self.types_of(args))
        return kept is not None and kept.read() is None


class Part(Kernel):
    """One that only kernels can call compiled."""

    def __call__(self, *args: Any, **kws: Any) -> Any:
        """Run the source."""
        return _trials[-1](self, args) if _trials and not kws else self.py_func(*args, **kws)


class Lengthy(Kernel):
    """One that takes too long as plain Python."""

    def _can_wait(self, args: Sequence[Any]) -> bool:
        return False


def general(kind: Any) -> Any:
    """The type that an argument is compiled for: not anew for each constant and each shorter
    integer."""
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
        """Numba compiles something."""
        if isinstance(event.data["dispatcher"], Kernel):
            teller().compiles()

    def on_end(self, event: Any) -> None:
        """It has."""


_NUMBA.event.register("numba:compile", _Listener())


# --- how long it takes ---


class Stopwatch:
    """Runs from the moment it is made, and stands still while this thread compiles kernels or loads
    them from the disk."""

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
    """How long a thread has been compiling and loading kernels, s. numba does both under one lock,
    and announces that."""

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
    """Hands numba's announcements on to the thread that they concern."""

    def on_start(self, _: Any) -> None:
        _LOADING.begin()

    def on_end(self, _: Any) -> None:
        _LOADING.end()


_LOADING = _Loading()
_NUMBA.event.register("numba:compiler_lock", _Announced())
