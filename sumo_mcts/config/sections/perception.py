"""The sections `sensor` and `prediction`: the traffic that a planner sees, and expects."""

from typing import Annotated, Any, Literal

from pydantic import Field

from sumo_mcts.config.names import PredictorName
from sumo_mcts.config.sections.section import Section
from sumo_mcts.config.values import (
    Acceleration,
    Delay,
    Flag,
    Float,
    Gap,
    Headway,
    Int,
    NonNegative,
    Positive,
    Share,
    StepTime,
)
from sumo_mcts.registry import PREDICTORS


class SensorConfig(Section):
    """What a sensor shows the planner."""

    range_m: Annotated[Float, Field(ge=1, le=10_000)] = Field(200.0, description="sensor range")
    signals: Literal["timing", "current"] = Field(
        "timing",
        description="coming signal phases are broadcast, up to one whose end the traffic decides, "
        "or only the present state is seen",
    )
    position_error_m: Annotated[Float, Field(ge=0, le=100)] = Field(
        0.0, description="standard deviation of the error of an agent's position, along each axis"
    )
    speed_error_mps: Annotated[Float, Field(ge=0, le=100)] = Field(
        0.0, description="standard deviation of the error of an agent's speed"
    )
    error_time_s: Positive = Field(
        1.0,
        description="time after which the share 1/e of an error is left: a tracker's errors last",
    )
    drop_probability: Share = Field(
        0.0, description="probability that an agent is not seen in a cycle"
    )
    occlusion: Flag = Field(False, description="whether vehicles hide what is behind them")
    visible_share: Share = Field(
        0.1,
        description="occlusion: share of an agent, as an angle seen from the ego's centre, that "
        "has to be in view",
    )
    memory_s: NonNegative = Field(
        5.0, description="how long an agent that was dropped or hidden is remembered"
    )


_ORACLES = ", ".join(
    f"{row.name} ({row.label})" for row in PREDICTORS.values() if row.oracle is not None
)


class PredictionConfig(Section):
    """The forward-predicted copy of the traffic."""

    name: PredictorName = Field(
        "idm",
        description=f"the oracles are {_ORACLES}; or a plugin, see extending.md",
    )
    step_s: StepTime = Field(0.2, description="time between forecast states")
    headway_s: Headway = Field(1.2, description="IDM time headway of the others")
    min_gap_m: Gap = Field(2.0, description="IDM gap at standstill")
    accel_mps2: Acceleration = Field(2.0, description="IDM acceleration of the others")
    decel_mps2: Acceleration = Field(2.5, description="IDM comfortable deceleration of the others")
    yield_decel_mps2: Acceleration = Field(
        2.5, description="an agent is expected to yield only if this deceleration suffices"
    )
    yield_gap_s: Delay = Field(1.0, description="time gap that a yielding agent accepts")
    stays_after_s: NonNegative = Field(
        2.0,
        description="a vehicle that stands, and had no reason for it that was seen for this long, "
        "is expected to stay",
    )
    persistence_s: NonNegative = Field(
        2.0,
        description="time after which 1/e is left of an agent's accelerating otherwise than the "
        "model has it (nothing fades of an agent that keeps its speed); 0: none",
    )
    room_on_foot_m: Annotated[Float, Field(ge=0, le=10)] = Field(
        0.4,
        description="margin around a person on foot, since people may turn or stop at any time; "
        "at most half of the distance to the ego now, and sideways half of the room beside who "
        "walks along the ego's lane",
    )
    hypotheses: Int = Field(
        4,
        ge=1,
        le=8,
        description="how many joint hypotheses about the others planner mcts weighs at most: "
        "another turn, not yielding, braking, starting, stopping on foot; "
        "only with idm, the other forecasts have one",
    )
    options: dict[str, Any] = Field(
        {}, description="parameters of a plugin, which checks them itself"
    )
