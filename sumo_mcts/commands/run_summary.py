"""The rows of a run in words, for a person."""

from typing import Any

from sumo_mcts.episode.run import EpisodeResult
from sumo_mcts.errors import printable
from sumo_mcts.records import Row


def summary(result: EpisodeResult) -> str:
    """The rows of a run, one after the other."""
    return "\n\n".join(summary_of(row) for row in result.rows)


def summary_of(row: Row) -> str:
    """A row: what was driven, its outcome, and a line for each kind of measure."""
    lines = [_title(row), _line("outcome", _outcome(row))]
    if row["free_flow_s"] is None:  # the ego never drove
        return "\n".join(lines)
    lines += [
        _line("travel time", _travel_time(row)),
        _line("standing", _standing(row)),
        *([_line("missed", printable(row["detours"]))] if row["detours"] else []),
        _line("comfort", _comfort(row)),
        _line("others", _others(row)),
        _line("rules", _rules(row)),
        _line("planning", _planning(row)),
        _line("digest", str(row["trace_digest"])[:16]),
    ]
    return "\n".join(lines)


def _line(name: str, words: str) -> str:
    return f"  {name:12s} {words}"


def _title(row: Row) -> str:
    ego, seed = printable(row["ego"]), _shown(row["seed"])
    return f"{row['scenario']}  ego {ego}  planner {row['variant']}  seed {seed}"


def _outcome(row: Row) -> str:
    fault = "" if row["at_fault"] is None else ", at fault" if row["at_fault"] else ", not at fault"
    return f"{row['outcome']}{fault}" + (f": {row['error']}" if row["error"] else "")


def _travel_time(row: Row) -> str:
    ratio = (
        ""
        if row["travel_time_s"] is None or not row["free_flow_s"]
        else f" ({row['travel_time_s'] / row['free_flow_s']:.2f} x free flow)"
    )
    return (
        f"{_shown(row['travel_time_s'], ' s')}{ratio}, {_shown(row['time_lost_s'], ' s')} lost, "
        f"{_shown(row['distance_m'], ' m')} driven"
    )


def _standing(row: Row) -> str:
    return (
        f"{_shown(row['stopped_s'], ' s')} in all, {_shown(row['longest_stop_s'], ' s')} at a "
        f"stretch, {_shown(row['stopped_at_green_s'], ' s')} first at green"
    )


def _comfort(row: Row) -> str:
    comfortable = None if row["comfortable_share"] is None else 100.0 * row["comfortable_share"]
    return (
        f"strongest braking {_shown(row['max_decel_mps2'], ' m/s2')}, rms jerk "
        f"{_shown(row['rms_jerk_mps3'], ' m/s3')}, {_shown(comfortable, ' %', 0)} of the time "
        "comfortable"
    )


def _others(row: Row) -> str:
    return (
        f"braking imposed {_shown(row['imposed_max_decel_mps2'], ' m/s2')}, smallest TTC "
        f"{_shown(row['min_ttc_s'], ' s')}, PET {_shown(row['min_pet_s'], ' s')}"
    )


def _rules(row: Row) -> str:
    return (
        f"red lights run {_shown(row['red_lights_run'])}, speeding "
        f"{_shown(row['speeding_share'], '', 3)}"
    )


def _planning(row: Row) -> str:
    return (
        f"{_shown(row['cycles'])} decisions, {_shown(row['plan_ms_p50'], ' ms')} (p50) "
        f"{_shown(row['plan_ms_p99'], ' ms')} (p99), "
        f"{_shown(row['realtime_factor'], ' x real time')}"
    )


def _shown(value: Any, unit: str = "", digits: int = 1) -> str:
    """A value with its unit; "-" where there is none."""
    if value is None:
        return "-"
    return f"{value:.{digits}f}{unit}" if isinstance(value, float) else f"{value}{unit}"
