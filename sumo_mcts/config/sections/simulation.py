"""The sections `sumo`, `egos` and `episode`: what is simulated, which vehicles are driven, and when
an episode ends.
"""

from typing import Annotated

from pydantic import Field, model_validator

from sumo_mcts.config.sections.section import Section
from sumo_mcts.config.values import FileName, FileNames, Float, Id, Positive, SumoValue


class SumoConfig(Section):
    """The simulation: either a .sumocfg, or a network with routes."""

    sumocfg: FileName | None = Field(
        None, description="a .sumocfg file; its settings stay as they are"
    )
    net: FileName | None = Field(None, description="network (.net.xml, .net.xml.gz)")
    routes: FileNames = Field((), description="route files")
    additional: FileNames = Field(
        (), description="additional files: vehicle types, signal plans, stops"
    )
    step_length_s: Annotated[Float, Field(ge=0.001, le=10)] | None = Field(
        None, description="step of the simulation; default 0.1, with a sumocfg its own"
    )
    options: dict[str, SumoValue] = Field(
        {}, description="further SUMO options, without the dashes"
    )

    @model_validator(mode="after")
    def _one_source(self) -> "SumoConfig":
        if (self.sumocfg is None) == (self.net is None):
            raise ValueError("give either sumocfg or net")
        return self


class EgoConfig(Section):
    """A vehicle that the planner drives."""

    id: Id = Field(description="vehicle id")
    until: Id | None = Field(
        None, description="the goal: the end of this edge; default the last of its route"
    )


class EpisodeConfig(Section):
    """When an episode ends."""

    stop_time_s: Positive | None = Field(
        None, description="time limit after departure; default time_limit_s"
    )
    success_edge: Id | None = Field(
        None,
        description="arrived as soon as the front is on this edge; default the end of the goal "
        "edge",
    )
    time_limit_s: Positive | None = Field(
        None, description="time limit after departure; default 3 x free-flow time + 120"
    )
    depart_limit_s: Positive = Field(3600.0, description="how long to wait for the ego's departure")
