"""The section `traffic`: vehicles and events that the scenario adds to the route files."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from sumo_mcts.config.sections.section import Section
from sumo_mcts.config.values import (
    Acceleration,
    CrowdSize,
    Edges,
    Float,
    Id,
    LaneNumber,
    Metres,
    NonNegative,
    Part,
    Positive,
    Share,
    Speed,
    TopSpeed,
)

CROWD_ID = "crowd_"  # with a number behind it, from 1


class Depart(Section):
    """Where and how an actor enters."""

    time_s: NonNegative = Field(0.0, description="when it enters")
    lane: LaneNumber = Field(0, description="lane of the first edge, 0 = rightmost")
    pos_m: Metres = Field(0.0, description="position of its front on the first edge")
    speed_mps: Speed = Field(0.0, description="speed at entry")


class Event(Section):
    """A command to a vehicle: when, and exactly one of change_lane, slow_to_mps, stop_for_s."""

    at_s: NonNegative | None = Field(None, description="when: seconds after the actor's departure")
    at_m: Metres | None = Field(None, description="or where: metres driven since its departure")
    change_lane: Literal["left", "right"] | None = Field(
        None, description="change to the next lane on that side"
    )
    slow_to_mps: Speed | None = Field(
        None, description="reach this speed (also a higher one) and keep it"
    )
    stop_for_s: Positive | None = Field(
        None, description="brake to a stand, stand this long, go on at the speed it had"
    )
    accel_mps2: Acceleration = Field(2.5, description="acceleration with which the speed changes")

    @model_validator(mode="after")
    def _one_of_each(self) -> "Event":
        if (self.at_s is None) == (self.at_m is None):
            raise ValueError("give either at_s or at_m")
        if sum(x is not None for x in (self.change_lane, self.slow_to_mps, self.stop_for_s)) != 1:
            raise ValueError("give exactly one of change_lane, slow_to_mps, stop_for_s")
        return self


class Vary(Section):
    """How far a drawn scene may lie from the written one: uniform within +- these, times
    traffic.vary."""

    pos_m: Metres = Field(0.0, description="departure position")
    speed_mps: Speed = Field(0.0, description="departure speed and the speeds of its events")
    time_s: NonNegative = Field(0.0, description="departure and event times")


class Actor(Section):
    """A vehicle of the scene.

    `script` holds its speeds and lanes whatever happens; `sumo` drives like SUMO's own traffic.
    """

    id: Id
    route: Edges = Field(description="edges")
    depart: Depart = Depart()
    driver: Literal["sumo", "script"] = "sumo"
    max_speed_mps: TopSpeed | None = Field(
        None, description="its own top speed; default its vehicle type's"
    )
    vtype: Id = Field("DEFAULT_VEHTYPE", description="vehicle type")
    events: tuple[Event, ...] = Field((), max_length=1000)
    vary: Vary = Vary()


class VehicleEvent(Event):
    """An event for a vehicle of the route files."""

    vehicle: Id


class DriversConfig(Section):
    """Shares of the kinds of drivers, drawn for every vehicle of actors and crowd that SUMO drives.

    All 0: their vehicle types stand.
    """

    ordinary: Part = Field(0.0, description="keeps its distance and roughly to the limit")
    aggressive: Part = Field(
        0.0, description="drives close and fast, takes small gaps, lets no other vehicle in"
    )
    inattentive: Part = Field(
        0.0, description="dawdles, and now and then overlooks a vehicle with the right of way"
    )


def _in_order(key: str, pair: tuple[float, float]) -> None:
    if pair[0] > pair[1]:
        raise ValueError(f"{key}: give the smaller number first")


class Stream(Section):
    """A route that vehicles of the crowd may take."""

    route: Edges = Field(description="edges")
    lanes: tuple[LaneNumber, ...] = Field(
        (0,), min_length=1, max_length=100, description="lanes of the first edge, 0 = rightmost"
    )
    pos_m: tuple[Metres, Metres] = Field(
        (0.0, 0.0),
        description="from and to: positions of those that are there from the start",
    )
    speed_mps: tuple[Speed, Speed] = Field(
        (5.0, 10.0),
        description="from and to: their speed; SUMO refuses more than the limit times the driver's "
        "speed factor, 0.8 at least",
    )

    @model_validator(mode="after")
    def _ascending(self) -> "Stream":
        _in_order("pos_m", self.pos_m)
        _in_order("speed_mps", self.speed_mps)
        return self


class CrowdConfig(Section):
    """Further vehicles, driven by SUMO and drawn by the seed: crowd_1, crowd_2, ..."""

    count: tuple[CrowdSize, CrowdSize] = Field((0, 0), description="from and to: how many")
    streams: tuple[Stream, ...] = Field((), max_length=1000)
    late: Share = Field(
        0.5,
        description="share of those that enter later, at the beginning of their route, as does "
        "a vehicle that finds no room at the start",
    )
    within_s: Positive = Field(
        20.0, description="they enter within this time, or as soon as SUMO finds room after it"
    )

    @model_validator(mode="after")
    def _drawable(self) -> "CrowdConfig":
        _in_order("count", self.count)
        if self.count[1] > 0 and not self.streams:
            raise ValueError("count: give streams too")
        return self


class TrafficConfig(Section):
    """Vehicles and events that the scenario adds to the route files."""

    actors: tuple[Actor, ...] = Field((), max_length=2000)
    crowd: CrowdConfig = CrowdConfig()
    drivers: DriversConfig = DriversConfig()
    events: tuple[VehicleEvent, ...] = Field((), max_length=2000)
    vary: Annotated[Float, Field(ge=0, le=3)] = Field(
        1.0, description="scale of all `vary` entries; 0 = the fixed scene"
    )

    @model_validator(mode="after")
    def _ids_are_free(self) -> "TrafficConfig":
        taken = [actor.id for actor in self.actors if actor.id.startswith(CROWD_ID)]
        if self.crowd.count[1] > 0 and taken:
            raise ValueError(f"actors: {taken[0]}: ids that begin with {CROWD_ID} are the crowd's")
        return self
