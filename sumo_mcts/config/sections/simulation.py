"""The sections `sumo`, `egos` and `episode`: what is simulated, which vehicles are driven, and when
an episode ends.
"""

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field, field_validator, model_validator

from sumo_mcts import situations
from sumo_mcts.config.sections.section import Section
from sumo_mcts.config.values import FileName, FileNames, Flag, Float, Id, Positive, SumoValue


def _one_of(kind: str, kinds: Mapping[str, object]) -> str:
    if kind not in kinds:
        raise ValueError(f"has to be one of {', '.join(kinds)}")
    return kind


class DenseConfig(Section):
    """A dense situation of the package: network and traffic are made by the seed."""

    kind: str = Field(
        description="which; docs/dense.md has them all",
        json_schema_extra={"enum": list(situations.DENSE)},
    )
    half: situations.Half = Field(
        "development",
        description="the half of the parameter ranges; `final` is kept for the last measurement",
    )
    family: situations.Family = Field("krauss", description="how the others drive")

    @field_validator("kind")
    @classmethod
    def _known(cls, kind: str) -> str:
        return _one_of(kind, situations.DENSE)


class RuleConfig(Section):
    """A rule of the road with a network of its own: network and traffic are made by the seed."""

    kind: str = Field(
        description="which; docs/rules.md has them all",
        json_schema_extra={"enum": list(situations.RULES)},
    )
    family: situations.Family = Field("krauss", description="how the others drive")

    @field_validator("kind")
    @classmethod
    def _known(cls, kind: str) -> str:
        return _one_of(kind, situations.RULES)


class PassingConfig(Section):
    """Slow traffic that the ego passes: network and traffic are made by the seed."""

    kind: str = Field(
        description="which; docs/passing.md has them all",
        json_schema_extra={"enum": list(situations.PASSING)},
    )
    family: situations.Family = Field("krauss", description="how the others drive")

    @field_validator("kind")
    @classmethod
    def _known(cls, kind: str) -> str:
        return _one_of(kind, situations.PASSING)


class SumoConfig(Section):
    """The simulation: a .sumocfg, or a network with routes, or a situation of the package."""

    sumocfg: FileName | None = Field(
        None, description="a .sumocfg file; its settings stay as they are"
    )
    net: FileName | None = Field(None, description="network (.net.xml, .net.xml.gz)")
    dense: DenseConfig | None = Field(None, description="a dense situation, in place of a network")
    rule: RuleConfig | None = Field(
        None, description="a situation for one rule of the road, in place of a network"
    )
    passing: PassingConfig | None = Field(
        None, description="a situation with slow traffic to pass, in place of a network"
    )
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
        sources = [self.sumocfg, self.net, self.dense, self.rule, self.passing]
        if len(sources) - sources.count(None) != 1:
            raise ValueError("give either sumocfg or net or dense or rule or passing")
        return self


class EgoConfig(Section):
    """A vehicle that the planner drives."""

    id: Id = Field(description="vehicle id")
    until: Id | None = Field(
        None, description="the goal: the end of this edge; default the last of its route"
    )
    connected: Flag = Field(
        False, description="whether it and the other connected egos tell each other their plans"
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
