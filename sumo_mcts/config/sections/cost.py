"""The section `cost`: the weights of J."""

from typing import Annotated

from pydantic import Field

from sumo_mcts.config.names import TermName
from sumo_mcts.config.sections.section import Section
from sumo_mcts.config.values import Acceleration, Delay, Float, NonNegative, Positive


class CostWeights(Section):
    """The numbers of the built-in terms: kernels read each of them by its name here
    (model/cost_params.py)."""

    contact: Positive = Field(
        60.0, description="predicted contact now; falls linearly to half of it at the horizon"
    )
    speed_at_contact: NonNegative = Field(1.0, description="added per m/s of speed at contact")
    after_contact: NonNegative = Field(
        1.0,
        description="times the cost of standing there for ever after a predicted contact; 0: the "
        "time after it costs nothing",
    )
    headway_s: Delay = Field(1.2, description="time gap below which following costs")
    headway_gap_m: Annotated[Float, Field(ge=0, le=100)] = Field(
        2.0, description="gap that belongs to it at standstill"
    )
    headway: NonNegative = Field(1.5, description="per second at no gap at all")
    claim_s: Delay = Field(1.6, description="time for which an agent's path ahead belongs to it")
    claim: NonNegative = Field(
        16.0,
        description="per second of standing on the path of an agent that is about to come",
    )
    nearing: NonNegative = Field(
        1.0,
        description="times what a contact costs and the growth of its probability, while the ego "
        "comes near an agent that moves sideways; 0: only contacts in the forecast count",
    )
    acceleration: NonNegative = Field(0.02, description="per second at 1 m/s2, quadratic")
    jerk: NonNegative = Field(
        0.005, description="k of C_c = k j^2 per second, saturating at 10 m/s3"
    )
    braking: NonNegative = Field(
        0.5, description="per second and m/s2 of braking beyond comfort_decel_mps2, quadratic"
    )
    imposed: NonNegative = Field(
        2.0,
        description="per second and m/s2 of braking beyond 2 m/s2 that the ego forces on an agent "
        "that the search moves",
    )
    cut_in_decel_mps2: Acceleration = Field(
        3.0,
        description="braking that is expected of a follower when the ego moves in front of it",
    )
    progress: NonNegative = Field(
        1.0, description="per second of standing where the limit could be driven"
    )
    tail_s: Delay = Field(
        8.0,
        description="for how long beyond the horizon a slow leader, or the end of a lane, still "
        "counts",
    )
    beyond_s: Delay = Field(
        30.0,
        description="s that waiting at lights and for gaps beyond the horizon costs at most; 0: "
        "nothing",
    )
    blocking: NonNegative = Field(0.3, description="per second of standing inside a junction")
    astride: NonNegative = Field(
        4.0,
        description="per second of standing across two lanes: a follower in the one that the ego "
        "leaves takes it to be free",
    )
    route: NonNegative = Field(
        2.0,
        description="per second on a lane that the route leaves, at full urgency, and for "
        "each change needed, at most 3",
    )
    mismatch: NonNegative = Field(
        1.0,
        description="times `route`, where the ego is so much slower than the vehicles of the next "
        "lane that none of them can make room for it in comfort",
    )
    lane_change: NonNegative = Field(0.6, description="C_o,lc per change begun")
    red: Positive = Field(100.0, description="entering on red")


class CostConfig(CostWeights):
    """The terms of J for planner `mcts`. One unit is one second of standing still."""

    term: TermName | None = Field(
        None, description="a further term of your own: a plugin, see extending.md"
    )
    term_weight: NonNegative = Field(1.0, description="handed to it")
