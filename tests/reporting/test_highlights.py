"""A report lists what went wrong and the hardest moments, and no planner fills the list."""

from collections import Counter

from helpers_rows import crashed, made_row

from sumo_mcts.reporting.highlights import choose_highlights


def test_what_went_wrong_is_worth_a_look_and_the_hardest_moments() -> None:
    rows = [made_row(seed=seed, min_ttc_s=9.0 - seed / 10) for seed in range(10)]
    rows[2] = crashed(rows[2])
    rows[3]["failsafe_interventions"] = 2
    rows[4].update(outcome="off_route", imposed_max_decel_mps2=5.5)
    shown, of = choose_highlights(rows, 50)
    assert [(each.row["seed"], each.reasons) for each in shown] == [
        (2, ("collision at fault",)),
        (4, ("off route", "imposed braking 5.5 m/s²")),
        (3, ("2 fail-safe interventions",)),
        (9, ("TTC 8.10 s",)), (8, ("TTC 8.20 s",)), (7, ("TTC 8.30 s",)),
    ]  # fmt: skip
    assert of == 6


def test_stuck_episodes_lead_the_list_after_collisions_at_fault() -> None:
    rows = [made_row(seed=seed, min_ttc_s=None, longest_stop_s=0.0) for seed in range(8)]
    rows[1]["failsafe_interventions"] = 1
    rows[2].update(outcome="off_route")
    rows[3] = crashed(rows[3], at_fault=False)
    rows[4].update(longest_stop_s=95.4)
    rows[5].update(outcome="timeout", longest_stop_s=140.0)
    rows[6] = crashed(rows[6])
    rows[7].update(longest_stop_s=60.0)  # as long as its twin
    twins = [made_row(variant="sumo", seed=seed, longest_stop_s=12.0) for seed in range(8)]
    twins[7]["longest_stop_s"] = 60.0
    shown, _ = choose_highlights([*rows, *twins], 50)
    assert [(each.row["seed"], each.reasons) for each in shown] == [
        (6, ("collision at fault",)),
        (5, ("timeout, stood 140 s at a stretch, its twin 12 s",)),
        (4, ("stood 95 s at a stretch, its twin 12 s",)),
        (3, ("collision, not at fault",)),
        (2, ("off route",)),
        (1, ("1 fail-safe intervention",)),
        (7, ("stood 60 s at a stretch, its twin 60 s",)),
    ]
    alone, _ = choose_highlights(rows, 50)
    assert [each.row["seed"] for each in alone] == [6, 5, 3, 2, 1, 4, 7]
    old = [{**row, "longest_stop_s": None} for row in (*rows, *twins)]
    assert [each.row["seed"] for each in choose_highlights(old, 50)[0]] == [6, 5, 3, 2, 1]


def test_one_bad_driver_does_not_fill_the_list() -> None:
    rows = [
        crashed(made_row(variant="mcts-idm-100", seed=seed), min_ttc_s=None) for seed in range(100)
    ]
    rows += [
        crashed(made_row(variant="constant", seed=seed), min_ttc_s=None) for seed in range(100)
    ]
    rows += [
        crashed(made_row(variant="mcts-idm-1000", seed=seed), min_ttc_s=None) for seed in range(2)
    ]
    shown, of = choose_highlights(rows, 12)
    assert Counter(each.row["variant"] for each in shown) == {
        "mcts-idm-100": 10,
        "mcts-idm-1000": 2,
    }
    assert of == 202
    assert len(choose_highlights(rows, 150)[0]) == 150


def test_where_nothing_happened_there_is_still_something_to_see() -> None:
    shown, of = choose_highlights([made_row(seed=seed, min_ttc_s=None) for seed in (4, 5)], 50)
    assert ([(each.row["seed"], each.reasons) for each in shown], of) == (
        [(4, ("nothing happened",))],
        1,
    )


def test_the_twin_is_not_worth_a_look() -> None:
    assert choose_highlights([crashed(made_row(variant="sumo"))], 50) == ([], 0)
