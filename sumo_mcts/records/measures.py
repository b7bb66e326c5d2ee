"""The one table of measures: every key of an episode's row.

MEASURES gives the order, types and bounds of a row (rows.py) and the columns of episodes.csv. It
also gives the reference table of docs/measures.md, which docs.py generates, and the check of rows
that are read (reporting/results.py). A report counts, labels and explains each key by it
(reporting/columns.py).

A key is filled in one of three places: evaluation/referee.py, Referee.row(), from states;
episode/recorder.py, Recorder.planning(), from decisions; episode/run.py, completed(), what was run
and how long it took. Three of each ego's are added by episode/ego.py, Ego.row(), and the last two,
of what was drawn, where a row is kept: experiments/tasks.py and commands/run.py.

A new measure takes three files: the code that computes it, its line here, its test. With a label
and a Count it stands in a table of the report, too, if TABLES names it. COMPARED names those whose
episodes are compared with the twin's. After an error the referee keeps only some keys
(referee.py, _KNOWN_AFTER_ERROR): the others are null.
"""

from enum import Enum
from typing import Any, NamedTuple

MOST = 1e12  # of any number in a row
Row = dict[str, Any]  # an episode of one ego: a value, or None (unknown), by key


class Kind(Enum):
    """What the values of a key are."""

    TEXT = "text"
    TRUTH = "true or false"
    COUNT = "whole number"
    NUMBER = "number"
    SHARE = "share, 0 to 1"


class Count(Enum):
    """How a measure is counted over episodes: the sentence that a report prints."""

    EPISODES = "Counted are the episodes with any."
    FAULTS = "Counted are the episodes that ended in a collision at fault."
    COLLISIONS = "Counted over the collisions of which it is known."
    MEDIAN = "Median over the episodes in which it is known."
    MEDIAN_ARRIVED = "Median over the episodes that arrived."
    MEAN = "Mean over the episodes."
    SUM = "Sum over the episodes."
    LARGEST = "Largest of all episodes."
    PER_DECISION = "Mean over the decisions of all episodes."
    DECISIONS = "Counted over the decisions of all episodes."


class Measure(NamedTuple):
    """One key of the row."""

    key: str
    kind: Kind
    meaning: str  # a sentence, or more
    unit: str = ""
    label: str = ""  # the heading of its column in a report
    counted: Count | None = None  # None: no report counts it
    digits: int = 2  # after the point, in a report
    column: str = ""  # what a report's files call its column; "": as the key
    required: bool = False  # without it a line is no row

    def is_of_kind(self, value: Any) -> bool:
        """Whether a value has this measure's type; None, unknown, has every type."""
        if value is None:
            return True
        if self.kind in (Kind.TEXT, Kind.TRUTH):
            return isinstance(value, str if self.kind is Kind.TEXT else bool)
        numbers = int if self.kind is Kind.COUNT else int | float
        return isinstance(value, numbers) and not isinstance(value, bool)

    def is_within(self, value: Any) -> bool:
        """Whether a value has this measure's type and, if a number, lies within its bounds."""
        if value is None or self.kind in (Kind.TEXT, Kind.TRUTH):
            return self.is_of_kind(value)
        return self.is_of_kind(value) and bool(0 <= value <= self.most)

    @property
    def most(self) -> float:
        """The largest number that it may be; the smallest is 0."""
        return 1.0 if self.kind is Kind.SHARE else MOST


_IMPOSED = (
    "How often an agent braked beyond {} m/s² because of the ego: the ego was its leader, or in "
    "the way of its next 4 s."
)
_PERCENTILE = (
    "{} % of the decisions took at most so long, from scene to decision; time in which kernels "
    "were compiled or loaded is left out."
)
TEXT, TRUTH, COUNT, NUMBER, SHARE = Kind

# fmt: off
MEASURES = (
    # What was run.
    Measure("key", TEXT, "What was asked: scenario, variant, seed, and the ego where there are "
            "several.", required=True),
    Measure("scenario", TEXT, "The name of the scenario.", required=True),
    Measure("variant", TEXT, "Planner, forecast and budget, then every setting that differs from "
            "the scenario's.", required=True),
    Measure("planner", TEXT, "The planner; `policy` for an agent in the gymnasium environment."),
    Measure("prediction", TEXT, "The predictor; `NAME (oracle)` for an oracle of the user's own; "
            "null where the planner reads no forecast."),
    Measure("ego", TEXT, "The vehicle's id."),
    Measure("seed", COUNT, "The seed of the episode; null where SUMO keeps its own.",
            label="Seed", digits=0),

    # How it ended.
    Measure("outcome", TEXT, "How the episode ended: one of the outcomes above.", required=True),
    Measure("error", TEXT, "Why the run could not go on; null otherwise."),
    Measure("at_fault", TRUTH, "Whether the collision is the ego's fault: its front came first, "
            "the other stood, or it had to let the other pass. What is unclear counts as fault.",
            label="At fault", counted=Count.FAULTS),
    Measure("inevitable", TRUTH, "Whether a search that knows the scripts could not avoid the "
            "collision from 3 s before. Known in scripted scenes only.",
            label="Inevitable", counted=Count.COLLISIONS),
    Measure("collisions", COUNT, "Agents that the ego met in the step that ended the episode."),

    # How the ego drove.
    Measure("travel_time_s", NUMBER, "Time from departure to arrival; null unless arrived.", "s",
            "Travel time", Count.MEDIAN_ARRIVED, 1),
    Measure("free_flow_s", NUMBER, "Time for the same route alone on the road, at the speed limits "
            "and below the vehicle's own top speed.", "s"),
    Measure("in_time", TRUTH, "Whether the ego arrived within the time limit."),
    Measure("distance_m", NUMBER, "Distance driven since departure.", "m"),
    Measure("stopped_s", NUMBER, "Time slower than 0.1 m/s.", "s"),
    Measure("longest_stop_s", NUMBER, "The longest time without a break slower than 0.1 m/s.", "s",
            "Longest stop", Count.LARGEST, 1),
    Measure("stopped_at_green_s", NUMBER, "Time slower than 0.1 m/s as the first before a stop "
            "line whose light is green, for whatever reason.", "s", "Stood at green", Count.MEAN,
            1),
    Measure("time_lost_s", NUMBER, "Time since departure minus the free-flow time of what the ego "
            "has come along its route; null off its route.", "s", "Time lost", Count.MEDIAN, 1),
    Measure("max_decel_mps2", NUMBER, "Strongest braking of the ego, positive.", "m/s²",
            "Hardest braking", Count.MEDIAN),
    Measure("hard_brakes", COUNT, "How often the ego braked beyond 4.5 m/s².",
            label="Hard brakes", counted=Count.EPISODES),
    Measure("rms_jerk_mps3", NUMBER, "Root mean square of the longitudinal jerk, smoothed over "
            "half a second.", "m/s³", "Jerk", Count.MEDIAN),
    Measure("comfortable_share", SHARE, "Share of time within −4.05..2.40 m/s² lengthwise, "
            "4.89 m/s² sideways and 4.13 m/s³ jerk.",
            label="Comfortable", counted=Count.MEDIAN, digits=0),
    Measure("speeding_share", SHARE, "Share of steps faster than the lane's limit times the "
            "vehicle's own speed factor, by more than 0.1 m/s.",
            label="Speeding", counted=Count.EPISODES, column="speeding"),
    Measure("lane_changes", COUNT, "Lane changes carried out.",
            label="Lane changes", counted=Count.MEAN),
    Measure("reroutes", COUNT, "How often the ego left its route for another way to the same goal, "
            "since its lane did not lead on along the route (`ego_model.reroute_after_s`). Time "
            "and distance are those of the way that it drove.",
            label="Rerouted", counted=Count.EPISODES),
    Measure("detours", TEXT, "When and where it did so, by which edges, and why; also where no "
            "other way led to the goal, and where a stop was given up. Null where none of it "
            "happened."),
    Measure("decision_flips", COUNT, "How often the plan for the coming second turned from "
            "accelerating to braking or back.", label="Flips", counted=Count.MEAN),
    Measure("red_lights_run", COUNT, "How often the front crossed a stop line at red though the "
            "ego could have stopped with 4.5 m/s².",
            label="Red light run", counted=Count.EPISODES),
    Measure("yellow_run", COUNT, "How often the ego entered on yellow though 3 m/s² would have "
            "stopped it.", label="Yellow run", counted=Count.EPISODES),

    # What the others had to do about it.
    Measure("imposed_max_decel_mps2", NUMBER, "Strongest braking of another because of the ego.",
            "m/s²", "Imposed", digits=1),
    Measure("imposed_brakes_2", COUNT, _IMPOSED.format(2),
            label="Imposed beyond 2", counted=Count.EPISODES),
    Measure("imposed_brakes_3", COUNT, _IMPOSED.format(3),
            label="Imposed beyond 3", counted=Count.EPISODES),
    Measure("imposed_brakes_4", COUNT, _IMPOSED.format(4),
            label="Imposed beyond 4", counted=Count.EPISODES),
    Measure("min_ttc_s", NUMBER, "Smallest time to collision, by SUMO's surrogate safety device; "
            "null where there was none.", "s", "TTC", Count.MEDIAN),
    Measure("min_pet_s", NUMBER, "Smallest time between one vehicle leaving a conflict area and "
            "the other entering it.", "s", "PET", Count.MEDIAN),
    Measure("max_drac_mps2", NUMBER, "Largest deceleration that was needed to avoid a crash.",
            "m/s²", "DRAC", Count.MEDIAN),

    # How it was planned.
    Measure("failsafe_interventions", COUNT, "Decisions that a fail-safe manoeuvre replaced: "
            "unsafe ones (`failsafe.on`), those of a planner that failed, and late ones "
            "(`planner.enforce_deadline`). The trace tells why.",
            label="Fail-safe", counted=Count.EPISODES, column="failsafe"),
    Measure("iterations_per_decision", COUNT, "The budget (`planner.iterations`); null where "
            "nothing was searched, and with a time budget."),
    Measure("iterations", COUNT, "Passes of the search to its horizon, in all decisions.",
            label="Iterations", counted=Count.PER_DECISION, digits=0, column="iterations_used"),
    Measure("cycles", COUNT, "Decisions taken.",
            label="Decisions", counted=Count.SUM, digits=0, column="decisions"),
    Measure("deadline_s", NUMBER, "The deadline of a decision: the time budget, else the decision "
            "period.", "s"),
    Measure("deadline_misses", COUNT, "Decisions that took longer than the deadline.",
            label="Late", counted=Count.DECISIONS),
    Measure("plan_ms_p50", NUMBER, _PERCENTILE.format(50), "ms", "p50", Count.MEDIAN, 1),
    Measure("plan_ms_p95", NUMBER, _PERCENTILE.format(95), "ms", "p95", Count.MEDIAN, 1),
    Measure("plan_ms_p99", NUMBER, _PERCENTILE.format(99), "ms", "p99", Count.MEDIAN, 1),
    Measure("plan_ms_max", NUMBER, "The slowest decision.", "ms", "Slowest", Count.LARGEST, 1),
    Measure("wall_s", NUMBER, "The whole episode on the clock.", "s"),
    Measure("realtime_factor", NUMBER, "Simulated over wall time of the whole episode.", "×",
            "Real time", Count.MEDIAN, 1),

    # Digests to compare two episodes with.
    Measure("trace_digest", TEXT, "SHA-256 over decisions and executed states, without times on "
            "the clock: the same seed gives the same digest."),
    Measure("config_digest", TEXT, "SHA-256 of the resolved scenario, file names without their "
            "folders."),
)
# Keys that `run` and `batch` add: what makes two episodes a pair, beside scenario, seed and ego.
REDRAWN, TRAFFIC_DIGEST = "redrawn", "traffic_digest"
PAIRING = (
    Measure(REDRAWN, COUNT, "How often the drawn scene was thrown away, since the ego had no way "
            "out at the take-over."),
    Measure(TRAFFIC_DIGEST, TEXT, "SHA-256 of what an episode and its twin share of the scenario: "
            "`sumo`, `egos`, `traffic`, `episode`, and options after `--`."),
)

# The measures in each table of a report, in the order of its columns.
TABLES = {
    "others": ("imposed_brakes_2", "imposed_brakes_3", "imposed_brakes_4", "min_ttc_s",
               "min_pet_s", "max_drac_mps2"),
    "comfort": ("travel_time_s", "time_lost_s", "longest_stop_s", "stopped_at_green_s",
                "comfortable_share", "rms_jerk_mps3", "max_decel_mps2", "hard_brakes",
                "lane_changes", "reroutes", "decision_flips"),
    "rules": ("red_lights_run", "yellow_run", "speeding_share", "failsafe_interventions",
              "inevitable"),
    "planning": ("cycles", "iterations", "plan_ms_p50", "plan_ms_p95", "plan_ms_p99",
                 "plan_ms_max", "deadline_misses", "realtime_factor"),
}
# Those whose episodes are compared pair by pair with the twin's.
COMPARED = ("imposed_brakes_2", "imposed_brakes_3", "imposed_brakes_4")
# fmt: on

BY_KEY = {measure.key: measure for measure in (*MEASURES, *PAIRING)}
ROW_KEYS = tuple(measure.key for measure in MEASURES)
REQUIRED = tuple(measure.key for measure in MEASURES if measure.required)
