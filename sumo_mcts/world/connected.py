"""A SUMO that somebody else has started, at the other end of a TraCI connection."""

import time
from contextlib import ExitStack, suppress

from sumo_mcts.errors import ConfigError
from sumo_mcts.world.arguments import REFEREE_OPTIONS
from sumo_mcts.world.library import Remote, remote_at, using
from sumo_mcts.world.simulation import SimulationError, Stepped, option

PATIENCE_S = 20.0  # for a SUMO that still reads its files
AGAIN_S = 0.2
MOST_PORT = 65535


class Connected(Stepped):
    """The simulation in use from its construction to close()."""

    def __init__(self, address: str) -> None:
        """Connect to `address`, host:port.

        Raises ConfigError where nobody answers there, or SUMO runs with options with which the
        referee cannot judge.
        """
        self._address = address
        self._remote = _connected(address)
        self._use = ExitStack()
        self._use.enter_context(using(self._remote))
        try:
            _require_referee_options(address)
        except BaseException:
            self.close()
            raise

    def step(self) -> None:
        """One step. Raises SimulationError where the connection ends."""
        try:
            self._remote.connection.simulationStep()
        except Exception as error:  # traci's and the socket's
            raise SimulationError(f"the connection to {self._address} has ended: {error}") from None

    def close(self) -> None:
        """Leave the connection. SUMO ends with its last one."""
        self._use.close()
        with suppress(Exception):  # it may have ended already
            self._remote.connection.close()


def host_and_port(address: str) -> tuple[str, int]:
    """The parts of host:port. Raises ConfigError."""
    host, _, port = address.rpartition(":")
    if not host or not port.isascii() or not port.isdigit() or not 0 < int(port) <= MOST_PORT:
        raise ConfigError(
            f"--connect: host:port of a SUMO that was started with --remote-port, as in "
            f"localhost:8813, got {address!r:.60}"
        )
    return host, int(port)


def _connected(address: str) -> Remote:
    """A connection, once SUMO has read its files. Raises ConfigError."""
    host, port = host_and_port(address)
    until = time.monotonic() + PATIENCE_S
    while True:
        try:
            return remote_at(host, port)
        except OSError as error:
            if time.monotonic() >= until:
                raise ConfigError(
                    f"--connect: nobody answers at {address} ({error.strerror or error}); start "
                    f"SUMO first: sumo -c FILE.sumocfg --remote-port {port} {_flags()} &"
                ) from None
        time.sleep(AGAIN_S)


def _require_referee_options(address: str) -> None:
    """Raise ConfigError where an option differs from what the referee needs."""
    given = {name: option(name) for name in REFEREE_OPTIONS}
    wrong = [name for name, needed in REFEREE_OPTIONS.items() if not _alike(given[name], needed)]
    if wrong:
        has = ", ".join(f"{name} {given[name]}" for name in wrong)
        raise ConfigError(
            f"--connect: the SUMO at {address} runs with {has}, so that contacts could not be "
            f"judged; start it with {_flags()} instead"
        )


def _alike(given: str, needed: str) -> bool:
    try:
        return float(given) == float(needed)
    except ValueError:
        return given == needed


def _flags() -> str:
    return " ".join(f"--{name} {value}" for name, value in REFEREE_OPTIONS.items())
