"""What a scenario file may say: its sections, and what has to fit between them.

Every key has its unit, its default and its bounds in the file of its section (sections/). Unknown
keys are refused.
"""

from pydantic import Field, field_validator, model_validator

from sumo_mcts.config.sections.cost import CostConfig
from sumo_mcts.config.sections.perception import PredictionConfig, SensorConfig
from sumo_mcts.config.sections.planning import (
    EgoModelConfig,
    FailSafeConfig,
    IdmConfig,
    PaperConfig,
    PlannerConfig,
)
from sumo_mcts.config.sections.section import Section
from sumo_mcts.config.sections.simulation import EgoConfig, EpisodeConfig, SumoConfig
from sumo_mcts.config.sections.traffic import TrafficConfig
from sumo_mcts.registry import PLANNERS

MOST_STATES = 2000  # of a forecast: they are kept for every agent and hypothesis


class ScenarioConfig(Section):
    """One scenario file."""

    name: str = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=100, description="safe as a file name"
    )
    description: str = Field("", max_length=10_000)
    sumo: SumoConfig
    egos: tuple[EgoConfig, ...] = Field(min_length=1, max_length=100)
    traffic: TrafficConfig = TrafficConfig()
    episode: EpisodeConfig = EpisodeConfig()
    sensor: SensorConfig = SensorConfig()
    prediction: PredictionConfig = PredictionConfig()
    ego_model: EgoModelConfig = EgoModelConfig()
    planner: PlannerConfig = PlannerConfig()
    paper: PaperConfig = PaperConfig()
    idm: IdmConfig = IdmConfig()
    cost: CostConfig = CostConfig()
    failsafe: FailSafeConfig = FailSafeConfig()

    @field_validator("egos")
    @classmethod
    def _each_once(cls, egos: tuple[EgoConfig, ...]) -> tuple[EgoConfig, ...]:
        ids = [ego.id for ego in egos]
        twice = next((name for name in ids if ids.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"{twice} is named twice")
        return egos

    @model_validator(mode="after")
    def _forecast_fits(self) -> "ScenarioConfig":
        row = PLANNERS.get(self.planner.name)
        section = "planner" if row is None else row.section
        plan = getattr(self, section)
        states = (plan.look_ahead_steps + plan.rollout_steps) * plan.step_s / self.prediction.step_s
        if states > MOST_STATES:
            raise ValueError(
                f"prediction.step_s: with {section}.look_ahead_steps, {section}.rollout_steps and "
                f"{section}.step_s a forecast of {states:.0f} states; "
                f"allowed are {MOST_STATES}"
            )
        return self

    @property
    def reproducible(self) -> bool:
        """Whether no clock has a say in decisions."""
        return self.planner.time_budget_ms is None and not self.planner.enforce_deadline
