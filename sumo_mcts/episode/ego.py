"""One ego of a scenario, from waiting for its departure to its outcome."""

import contextlib
from collections.abc import Iterator

import numpy as np

from sumo_mcts.config import EgoConfig
from sumo_mcts.driver.vehicle import EgoVehicle
from sumo_mcts.episode.digest import Digest
from sumo_mcts.episode.launch import Running
from sumo_mcts.episode.take_over import TakeOver, true_scene
from sumo_mcts.errors import ConfigError, of_machine
from sumo_mcts.evaluation.hindsight import Hindsight
from sumo_mcts.evaluation.referee import COLLISION, Referee
from sumo_mcts.records import Row
from sumo_mcts.scene import Decision


class Ego:
    """Waits while it has neither a vehicle nor an end; drives while it has a vehicle."""

    def __init__(self, config: EgoConfig, noise: np.random.SeedSequence) -> None:
        """`noise` seeds its sensor's errors."""
        self.config, self.noise = config, noise
        self.vehicle: EgoVehicle | None = None  # None: not departed, or done
        self.done = False
        self._referee: Referee | None = None
        self._hindsight: Hindsight | None = None
        self._unavoidable: bool | None = None
        self._error: str | None = None
        self._digest = Digest()

    @property
    def id(self) -> str:
        """Its id in SUMO."""
        return self.config.id

    def begin(self, taken: TakeOver) -> None:
        """It is under control from now on."""
        self.vehicle, self._referee, self._hindsight = taken

    def accept(self, decision: Decision) -> None:
        """Drive this until the next decision."""
        assert self.vehicle is not None, "begin() first"
        self.vehicle.accept(decision)
        self._digest.add_decision(decision)

    def judge(self, running: Running) -> None:
        """Look at the step that is just over; with an outcome the ego is handed back to SUMO."""
        vehicle, hindsight = self.vehicle, self._hindsight
        assert vehicle is not None and self._referee is not None, "begin() first"
        frame = vehicle.look()
        self._digest.add_state(frame.ego)
        if hindsight is not None:
            hindsight.note(true_scene(running.world, frame))
        outcome = self._referee.observe(frame)
        if outcome is None:
            return
        self.done, self.vehicle = True, None
        vehicle.release()
        if (
            outcome == COLLISION
            and hindsight is not None
            and running.actors.only_scripts_beside(self.id)
        ):
            self._unavoidable = hindsight.unavoidable()

    @contextlib.contextmanager
    def guarded(self) -> Iterator[None]:
        """What fails inside is this ego's end alone; wrong input (ConfigError) and a failing
        machine end the episode."""
        try:
            yield
        except ConfigError:
            raise
        except Exception as error:  # libsumo's exceptions share no base
            if of_machine(error):
                raise
            self.fail(f"{type(error).__name__}: {error}")

    def fail(self, message: str) -> None:
        """End with outcome `error`."""
        vehicle, self.vehicle = self.vehicle, None
        self._error, self.done = message, True
        if self._referee is not None:
            self._referee.fail(message)
        if vehicle is not None:
            with contextlib.suppress(Exception):  # SUMO itself may be what failed
                vehicle.release()

    def lose(self, message: str) -> None:
        """SUMO is gone: an ego that is not done fails, and nothing can be handed back."""
        self.vehicle = None
        if not self.done:
            self.fail(message)

    def row(self) -> Row:
        """The keys of its row that follow from states alone."""
        judged = (
            self._referee.row()
            if self._referee is not None
            else {"outcome": "error", "error": self._error or "not started"}
        )
        return {
            **judged,
            "ego": self.id,
            "inevitable": self._unavoidable,
            "trace_digest": self._digest.text(),
        }
