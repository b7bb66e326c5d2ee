"""The tables count what the rows say."""

import math

from helpers_rows import crashed, made_row, made_rows

from sumo_mcts.records.statistics import Contrast, Estimate, Rate, wilson
from sumo_mcts.reporting import tables
from sumo_mcts.reporting.cells import Cell


def cells(name: str, rows: list[dict[str, object]]) -> list[dict[str, Cell]]:
    found = (tables.study(rows), *tables.tables(rows))
    table = next(table for table in found if table.name == name)
    return [
        dict(zip((column.key for column in table.columns), row, strict=True)) for row in table.rows
    ]


def test_outcomes() -> None:
    rows = [
        made_row(seed=0),
        crashed(made_row(seed=1)),
        crashed(made_row(seed=2), at_fault=False),
        made_row(seed=3, outcome="off_route"),
        made_row(seed=4, outcome="error"),
    ]
    (found,) = cells("outcomes", rows)
    assert found["episodes"] == 5
    assert found["arrived"] == Rate(1, 5, wilson(1, 5))
    assert found["collisions"] == Rate(
        2, 4, wilson(2, 4)
    )  # of the one that ended in an error nobody knows
    assert found["at_fault"] == Rate(1, 4, wilson(1, 4))
    assert found["other_outcomes"] == "1 error, 1 off route"


def test_pairs_whose_twin_does_not_arrive_stand_apart() -> None:
    late = {"outcome": "timeout", "travel_time_s": None}
    rows = [made_row(seed=seed, travel_time_s=10.0) for seed in range(4)]
    rows[1] = crashed(rows[1])
    twins = [
        made_row(variant="sumo", seed=seed, travel_time_s=20.0, imposed_brakes_4=seed)
        for seed in range(4)
    ]
    twins[3].update(late)
    (found,) = cells("twin", [*rows, *twins])
    assert found["pairs"] == 4
    assert found["arrived_with_twin"] == Rate(2, 3, wilson(2, 3))
    assert found["arrived_without_twin"] == Rate(1, 1, wilson(1, 1))
    ratio, imposed = found["travel_time_ratio"], found["imposed_brakes_4"]
    assert isinstance(ratio, Estimate)
    assert isinstance(imposed, Contrast)
    assert ratio == Estimate(0.5, None, 3)
    assert (imposed.k, imposed.other, imposed.n, imposed.per_hundred) == (0, 3, 4, -75.0), (
        "over all pairs, those too whose twin does not arrive"
    )


def test_a_study_shows_each_variant_beside_its_twins() -> None:
    rows = [made_row(seed=seed, travel_time_s=20.0 + seed, hard_brakes=0) for seed in range(4)]
    rows[0] = crashed(rows[0], imposed_brakes_2=1, hard_brakes=1)
    twins = [made_row(variant="sumo", seed=seed, travel_time_s=20.0) for seed in range(3)]
    twins[1] = crashed(twins[1])
    alone = made_row("exit")
    left, exit_ = cells("study", [*rows, *twins, alone])
    imposed = left.pop("imposed_brakes_2")
    assert isinstance(imposed, Contrast) and (imposed.k, imposed.other, imposed.n) == (1, 0, 3)
    assert left == {
        "scenario": "left",
        "variant": "mcts-idm-100",
        "arrived": Rate(3, 4, wilson(3, 4)),
        "at_fault": Rate(1, 4, wilson(1, 4)),
        "twin_at_fault": Rate(1, 3, wilson(1, 3)),
        "travel_time_ratio": Estimate(math.inf, None, 2),
        "travel_time_ratio_p90": math.inf,
        "travel_time_ratio_p95": math.inf,
        "travel_time_ratio_p99": math.inf,
        "imposed_brakes_3": Contrast(0, 0, 3, 0.0, None),
        "imposed_brakes_4": Contrast(0, 0, 3, 0.0, None),
        "hard_brakes": Rate(1, 4, wilson(1, 4)),
        "plan_ms_p50": 2.5,
    }
    assert (exit_["arrived"], exit_["twin_at_fault"]) == (Rate(1, 1, wilson(1, 1)), None)
    assert exit_["travel_time_ratio"] is None is exit_["travel_time_ratio_p99"]


def test_slow_pairs_stand_beside_the_median() -> None:
    rows = [made_row(seed=seed, travel_time_s=float(seed)) for seed in range(1, 41)]
    rows += [made_row(variant="idm", seed=seed, travel_time_s=100.0) for seed in range(1, 41)]
    rows += [made_row(variant="sumo", seed=seed, travel_time_s=10.0) for seed in range(1, 41)]
    slow = [f"travel_time_ratio_p{percent}" for percent in (90, 95, 99)]
    for name, told in (("twin", [3.6, 3.8, 4.0]), ("variants", [0.36, 0.38, 0.4])):
        assert [cells(name, rows)[0][key] for key in slow] == told, name


def test_over_all_scenarios_each_variant_is_paired_with_its_twins() -> None:
    rows = [
        made_row(scene, "idm", seed, travel_time_s=time)
        for scene, time in (("left", 10.0), ("exit", 30.0))
        for seed in range(2)
    ]
    rows[0] = crashed(rows[0])
    twins = [
        made_row(scene, "sumo", seed, travel_time_s=20.0, imposed_brakes_3=1)
        for scene in ("left", "exit")
        for seed in range(2)
    ]
    driver, twin = cells("overall", [*rows, *twins])
    assert (driver["variant"], driver["episodes"], driver["arrived"], driver["at_fault"]) == (
        "idm",
        4,
        Rate(3, 4, wilson(3, 4)),
        Rate(1, 4, wilson(1, 4)),
    )
    assert driver["travel_time_ratio"] == Estimate(1.5, None, 4)
    imposed = driver["imposed_brakes_3"]
    assert isinstance(imposed, Contrast) and (imposed.k, imposed.other, imposed.per_hundred) == (
        0,
        4,
        -100.0,
    )
    assert (
        twin["variant"] == "sumo"
        and twin["travel_time_ratio"] is None
        and twin["imposed_brakes_3"] is None
    )
    assert cells("overall", [row for row in [*rows, *twins] if row["scenario"] == "left"]) == [], (
        "one scenario is its own sum"
    )


def test_variants_are_compared_within_a_scenario_by_seed() -> None:
    found = cells("variants", made_rows(6))
    assert [(row["scenario"], row["variant"], row["against"]) for row in found[:3]] == [
        ("left", "mcts-idm-100", "mcts-idm-1000"), ("left", "mcts-idm-100", "idm"),
        ("left", "mcts-idm-1000", "idm"),
    ]  # fmt: skip
    assert len(found) == 6
    collisions = found[0]["collisions"]
    assert isinstance(collisions, Contrast)
    assert (collisions.k, collisions.other, collisions.n, round(collisions.per_hundred, 6)) == (
        2,
        0,
        6,
        33.333333,
    )
    assert cells("variants", [made_row(), made_row(variant="mcts-idm-1000", seed=1)]) == [], (
        "no seed in common"
    )


def test_late_decisions_are_counted_over_decisions() -> None:
    (found,) = cells(
        "planning",
        [made_row(deadline_misses=3), made_row(seed=1, cycles=60), made_row(variant="sumo")],
    )
    assert (found["decisions"], found["deadline_misses"], found["iterations_used"]) == (
        100,
        Rate(3, 100, wilson(3, 100)),
        2.0,
    )


def test_a_damaged_row_does_not_stop_the_report() -> None:
    (found,) = cells(
        "planning",
        [
            made_row(deadline_misses=300),
            made_row(seed=1, cycles=None, deadline_misses=2),
            made_row(seed=2, deadline_misses=1),
        ],
    )
    assert found["deadline_misses"] == Rate(1, 40, wilson(1, 40))


def test_medians_are_over_what_is_known() -> None:
    (found,) = cells(
        "others",
        [
            made_row(min_ttc_s=None),
            made_row(seed=1, min_ttc_s=2.0),
            made_row(seed=2, min_ttc_s=4.0),
        ],
    )
    assert (found["min_ttc_s"], found["min_pet_s"]) == (3.0, None)


def test_what_is_unknown_did_neither_happen_nor_not() -> None:
    """An episode that ended in an error of the run has no measures."""
    unknown = dict.fromkeys(
        ("imposed_brakes_3", "hard_brakes", "red_lights_run", "failsafe_interventions")
    )
    rows = [
        made_row(imposed_brakes_3=1, red_lights_run=1, hard_brakes=0),
        made_row(seed=1, outcome="error", travel_time_s=None, **unknown),
    ]
    twins = [made_row(variant="sumo", seed=seed) for seed in (0, 1)]
    (found,) = cells("rules", rows)
    assert (found["red_lights_run"], found["failsafe"]) == (
        Rate(1, 1, wilson(1, 1)),
        Rate(0, 1, wilson(0, 1)),
    )
    assert cells("comfort", rows)[0]["hard_brakes"] == Rate(0, 1, wilson(0, 1))
    assert cells("others", rows)[0]["imposed_brakes_3"] == Rate(1, 1, wilson(1, 1))
    imposed = cells("twin", [*rows, *twins])[0]["imposed_brakes_3"]
    assert isinstance(imposed, Contrast)
    assert (imposed.k, imposed.other, imposed.n) == (1, 0, 1)
    assert cells("outcomes", rows)[0]["arrived"] == Rate(1, 2, wilson(1, 2)), (
        "but it did not arrive"
    )


def test_standing_and_time_lost_stand_beside_the_twin_s() -> None:
    """The longest stop of all, the mean at green, the median of what was lost; older rows tell
    nothing."""
    stood = [(3.0, 0.0, 5.0), (90.0, 6.0, 120.0), (None, None, None)]
    keys = ("longest_stop_s", "stopped_at_green_s", "time_lost_s")
    rows = [
        made_row(seed=seed, **dict(zip(keys, each, strict=True))) for seed, each in enumerate(stood)
    ]
    twins = [made_row(variant="sumo", **dict(zip(keys, (2.0, 0.0, 4.0), strict=True)))]
    found = cells("comfort", [*rows, *twins])
    assert [[row[key] for key in keys] for row in found] == [[90.0, 3.0, 62.5], [2.0, 0.0, 4.0]]


def test_an_oracle_is_labelled() -> None:
    rows = [
        made_row(prediction="script"),
        made_row(variant="idm"),
        made_row(variant="mine", prediction="mine:Knowing (oracle)"),
    ]
    assert [row["variant"] for row in cells("outcomes", rows)] == [
        "mcts-idm-100 (oracle)",
        "idm",
        "mine (oracle)",
    ]


def test_inevitable_is_of_the_collisions_that_were_judged() -> None:
    rows = [
        crashed(made_row(seed=seed), inevitable=verdict)
        for seed, verdict in enumerate((True, False, None))
    ]
    assert cells("rules", [*rows, made_row(seed=9)])[0]["inevitable"] == Rate(1, 2, wilson(1, 2))
    assert cells("rules", [made_row()])[0]["inevitable"] is None
