"""Which SUMO is asked: that in this process (libsumo), or one of its own at the other end of a
TraCI connection. Both answer to the same calls."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

from sumo_mcts.errors import ConfigError

# What each shared library that libsumo asks for is called in Debian and Ubuntu.
_PACKAGES = {
    "libGL.so": "libgl1",
    "libX11.so": "libx11-6",
    "libXext.so": "libxext6",
    "libXrender.so": "libxrender1",
    "libatomic.so": "libatomic1",
}


def import_libsumo() -> Any:
    """The libsumo module.

    Raises ConfigError that says which package to install where a system library is missing.
    """
    try:
        import libsumo  # type: ignore[import-untyped]
    except ImportError as error:
        package = next((name for library, name in _PACKAGES.items() if library in str(error)), None)
        hint = f"; install it with: apt-get install {package}" if package else ""
        raise ConfigError(f"libsumo cannot be loaded: {error}{hint}") from None
    return libsumo


@dataclass(frozen=True)
class Remote:
    """A TraCI connection, which answers like the module libsumo."""

    connection: Any  # traci's Connection

    def __getattr__(self, name: str) -> Any:
        """A domain such as `vehicle`, or a call of the connection itself."""
        return getattr(self.connection, name)

    @property
    def TraCIException(self) -> Any:  # noqa: N802  # libsumo's name
        """What a call raises that SUMO cannot answer."""
        return _traci().TraCIException

    @property
    def StepListener(self) -> Any:  # noqa: N802
        """The base class of what is called after each step."""
        return _traci().StepListener


_in_use: ContextVar[Remote | None] = ContextVar("_in_use", default=None)  # None: libsumo


def running_sumo() -> Any:
    """What answers for the simulation in use: libsumo, or a Remote."""
    return _in_use.get() or import_libsumo()


@contextmanager
def using(remote: Remote | None) -> Iterator[None]:
    """Inside the block this connection is in use; None: libsumo."""
    before = _in_use.set(remote)
    try:
        yield
    finally:
        _in_use.reset(before)


def is_running() -> bool:
    """Whether a simulation runs in this process, or at the other end of the connection in use."""
    remote = _in_use.get()
    if remote is None:
        return bool(import_libsumo().simulation.isLoaded())
    try:
        remote.connection.simulation.getTime()
    except Exception:  # one that is closed has no common type of error
        return False
    return True


def remote_of(connection: Any) -> Remote | None:
    """What a user gives as a connection: one of traci's, the module traci for the one in use there,
    or libsumo (None).

    Raises ConfigError.
    """
    name = getattr(connection, "__name__", "")
    if connection is None or name == "libsumo":
        return None
    if name == "traci":
        try:
            connection = connection.getConnection()
        except Exception as error:
            raise ConfigError(f"connection: traci: {error}") from None
    if not all(hasattr(connection, domain) for domain in ("vehicle", "simulation", "lane")):
        raise ConfigError(
            "connection: one of traci's, as traci.connect or traci.getConnection return it, got "
            f"{connection!r:.60}"
        )
    return Remote(connection)


def remote_at(host: str, port: int) -> Remote:
    """A new connection. Raises OSError where nobody listens."""
    return Remote(_traci().connection.Connection(host, port, None, None, False, None))


def _traci() -> Any:
    import traci  # type: ignore[import-untyped]

    return traci
