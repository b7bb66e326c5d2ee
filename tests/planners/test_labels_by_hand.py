"""The labels of the reference's solver: what is kept of a state, which of two in a cell stays, how
those of a kind are ranked; and the bookkeeping of the solver around them."""

import math

import numpy as np
import pytest
from helpers import ego_at
from helpers_model import lanes_east, plain, scene_of, situation_of, task_of

from sumo_mcts.model.interaction import Neighbours
from sumo_mcts.model.local_map import State
from sumo_mcts.planners.ply import ALIVE, LOST
from sumo_mcts.planners.reference import problem_of, root_lines
from sumo_mcts.planners.reference_labels import (
    Labels,
    _mixed,
    _slot,
    copy_label,
    merge,
    rank,
    write_label,
)
from sumo_mcts.planners.reference_solver import (
    FREE,
    LOSING,
    Rest,
    Solution,
    _at_least,
    _new_labels,
    _note,
    _rest,
    _same,
    best_root,
    solve,
)

LANES = lanes_east(3, 900.0)
TASK = task_of(LANES, ego_at(LANES, "a_1", 100.0, 8.0))
write, copied, merged, ranked = map(plain, (write_label, copy_label, merge, rank))
CELL, KIND = np.array([0.25, 0.25, 0.5, 0.05, 0.5, 0.5]), np.array([5.0, 1.0])
STATE = State(3, 10.1, 8.1, 0.6, 0.11, 4, 0.2)
NEAR = Neighbours(30.0, 7.0, 5)
OTHERS = np.array([[4.1, 6.1], [5.1, 9.1]])


def labels(
    *those: tuple[State, float], near: Neighbours = NEAR, others: np.ndarray = OTHERS
) -> Labels:
    """Labels with these states and costs, and room for two more."""
    found = _new_labels(len(those) + 2, 3, OTHERS)
    for k, (state, cost) in enumerate(those):
        write(found, k, state, near, others, cost)
    return found


def test_a_label_holds_the_state_the_traffic_and_the_cost() -> None:
    found = labels((STATE, 2.5))
    assert found.where[0].tolist() == [3, 4] and found.cost[0] == 2.5
    assert found.motion[0].tolist() == [10.1, 8.1, 0.6, 0.11, 0.2]
    assert (found.followers[0], found.leader[0].tolist()) == (5, [30.0, 7.0])
    assert found.others[0].tolist() == OTHERS.tolist()
    found.line[0], found.bound[0], found.key[0], found.rank[0] = 7.0, 9.0, 11, 13
    other = _new_labels(2, 3, OTHERS)
    copied(found, 0, other, 1)
    for name in Labels._fields:
        value = getattr(other, name)
        same = np.array_equal(value[1], getattr(found, name)[0])
        assert same is (name != "rank") and not value[0].any()


def test_of_two_in_a_cell_the_cheaper_one_stays() -> None:
    near_by = STATE._replace(s=10.2, v=8.2, a=0.9, progress=0.14)
    for first, second, count in ((2.0, 3.0, 1), (3.0, 2.0, 1), (2.0, 2.0, 1)):
        found, table = labels((STATE, first), (near_by, second)), np.zeros(16, np.int64)
        assert merged(table, CELL, found, 0) == 1 and merged(table, CELL, found, 1) == count
        assert found.cost[0] == min(first, second)
        assert found.motion[0, 0] == (10.2 if second < first else 10.1)
        assert sorted(table.tolist()) == [0] * 15 + [1]


@pytest.mark.parametrize(
    "change",
    [
        {"node": 2}, {"other": 5}, {"s": 10.3}, {"v": 7.9}, {"a": 0.4}, {"progress": 0.16},
        {"s": 9.9}, {"v": 8.3}, {"a": 1.1}, {"progress": 0.09},
    ],
)  # fmt: skip
def test_what_is_a_cell_away_is_another_state(change: dict[str, float]) -> None:
    found = labels((STATE, 2.0), (STATE._replace(**change), 3.0))
    table = np.zeros(16, np.int64)
    assert [merged(table, CELL, found, k) for k in range(2)] == [1, 2]
    assert found.cost[:2].tolist() == [2.0, 3.0] and sorted(table)[-2:] == [1, 2]
    # a third one finds the cheaper of its own cell
    write(found, 2, STATE._replace(**change), NEAR, OTHERS, 1.0)
    assert merged(table, CELL, found, 2) == 2 and found.cost[:2].tolist() == [2.0, 1.0]


def test_followers_and_those_that_react_make_a_cell_too() -> None:
    moved = [OTHERS + np.eye(4)[k].reshape(2, 2) * 0.5 for k in range(4)]
    for near, others in ((NEAR._replace(followers=6), OTHERS), *((NEAR, each) for each in moved)):
        found, table = labels((STATE, 2.0)), np.zeros(16, np.int64)
        write(found, 1, STATE, near, others, 3.0)
        assert [merged(table, CELL, found, k) for k in range(2)] == [1, 2]
    found, table = labels((STATE, 2.0)), np.zeros(16, np.int64)
    write(found, 1, STATE, NEAR, OTHERS + 0.3, 3.0)  # within half a forecast time and 0.5 m/s
    assert [merged(table, CELL, found, k) for k in range(2)] == [1, 1]


@pytest.mark.parametrize(
    ("late", "faster", "same"), [(0.0, 3.0, True), (0.0, 6.0, False), (0.6, 0.0, False)]
)
def test_times_and_speeds_of_those_that_react_have_cells_of_their_own(
    late: float, faster: float, same: bool
) -> None:
    """Of half a forecast time, and here of 5 m/s."""
    found, cell = labels((STATE, 2.0), (STATE, 1.0)), np.array([0.25, 0.25, 0.5, 0.05, 0.5, 5.0])
    found.others[1, 0] += late, faster
    table = np.zeros(64, np.int64)
    assert merged(table, cell, found, 0) == 1
    assert merged(table, cell, found, 1) == (1 if same else 2)


def test_the_best_of_each_kind_come_first() -> None:
    """Kinds are 5 m and 1 m/s wide, on a lane; what else a state has does not matter."""
    kinds = [10.1, 11.0, 30.0, 12.0, 31.0, 10.3]
    found = labels(*((STATE._replace(s=s, a=0.1 * k), 1.0 + k) for k, s in enumerate(kinds)))
    ranked(np.ones(32, np.int64), KIND, found, np.arange(6))
    assert found.rank[:6].tolist() == [0, 1, 0, 2, 1, 3]
    ranked(np.zeros(32, np.int64), KIND, found, np.array([5, 4, 3, 2, 1, 0]))
    assert found.rank[:6].tolist() == [3, 2, 1, 1, 0, 0]
    assert len(set(found.key[:6])) == 2


def test_each_half_of_a_key_tells_numbers_and_their_order_apart() -> None:
    """And stays below 2^31 for all that it has seen, so that no product overflows."""
    rng, halves = np.random.default_rng(5), (set(), set())  # type: ignore[var-annotated]
    rows = [rng.permutation([-7, -1, 0, 1, 2, 40]) for _ in range(100)]
    different = {tuple(row.tolist()) for row in rows}
    for row in different:
        low = high = 0
        for number in row:
            low, high = plain(_mixed)(low, high, number)
            assert 0 <= low < 2**31 and 0 <= high < 2**31
        halves[0].add(low)
        halves[1].add(high)
    assert [len(half) for half in halves] == [len(different)] * 2


def test_keys_that_would_share_a_place_in_the_table_get_their_own() -> None:
    """Places are taken one after the other, and the first follows the last."""
    found = labels(*[(STATE, 0.0)] * 3)
    table, key = np.zeros(4, np.int64), [7, 11, 15]
    slots = []
    for k in range(3):
        slot = plain(_slot)(table, found, key[k])
        slots.append(slot)
        found.key[k], table[slot] = key[k], k + 1
    assert slots == [3, 0, 1] and [plain(_slot)(table, found, each) for each in key] == slots


# --- around them ---


def test_beginnings_that_come_to_the_same_are_one() -> None:
    again = STATE._replace(s=10.1 + 1e-8)
    found = labels((STATE, 2.0), (again, 2.0), (STATE._replace(node=2), 2.0),
                   (STATE._replace(other=3), 2.0), (STATE, 2.1), (STATE._replace(v=8.2), 2.0),
                   (STATE._replace(v=8.0), 2.0), (STATE, 1.9), (STATE._replace(turn=9.0), 2.0))  # fmt: skip
    assert [plain(_same)(found, i) for i in range(9)] == [0, 0, 2, 3, 4, 5, 6, 7, 0]


def test_a_finished_sequence_is_kept_if_it_is_the_best_of_its_kind() -> None:
    least, best = np.full(2, math.inf), np.zeros((2, 3))

    def note(end: int, cost: float, mark: float) -> tuple[float, ...]:
        plain(_note)(least, best, end, cost, np.full((2, 3), mark))
        return float(least[FREE]), float(least[LOSING]), float(best[0, 0])

    assert note(LOST, 80.0, 1.0) == (math.inf, 80.0, 1.0)
    assert note(LOST, 90.0, 2.0) == (math.inf, 80.0, 1.0)
    assert note(LOST, 70.0, 3.0) == (math.inf, 70.0, 3.0)
    assert note(ALIVE, 99.0, 4.0) == (99.0, 70.0, 4.0)  # free of a loss, so it is shown
    assert note(LOST, 60.0, 5.0) == (99.0, 60.0, 4.0)
    assert note(ALIVE, 98.0, 6.0) == (98.0, 60.0, 6.0)
    assert note(ALIVE, 98.0, 7.0) == (98.0, 60.0, 6.0)


def test_the_best_beginning_is_free_first_and_then_cheap() -> None:
    none = np.zeros((3, 1, 3))
    found = Solution(np.array([1.0, 5.0, 4.0]), np.array([True, False, False]), none, 0)
    assert best_root(found) == 2 and best_root(found, 2) == 1 and best_root(found, 1) == 0


@pytest.mark.parametrize("v", [0.0, 4.0, 11.9, 15.0, 18.0])
@pytest.mark.parametrize("accel", [1.0, 2.6])
def test_no_speed_is_lost_more_slowly_than_the_bound_says(v: float, accel: float) -> None:
    """Against adding up 1 - v / limit step by step, speeding up until the limit: the bound is no
    higher, and where the speed reaches the limit in whole steps it is that."""
    ego = ego_at(LANES, "a_1", 100.0, 8.0)
    problem = problem_of(TASK, situation_of(TASK, scene_of(ego, LANES)))
    local, c = problem.local._replace(open_ahead=False), problem.task.cost
    for steps in (1, 20, 80):
        speeds = np.minimum(v + accel * 0.1 * np.arange(1, steps + 1), 15.0)
        lost = c.progress * 0.1 * float(np.maximum(0.0, 1.0 - speeds / 15.0).sum())
        bound = plain(_at_least)(local, c, Rest(15.0, accel), v, steps, 0.1)
        assert bound <= lost + 1e-9 and bound >= lost - 0.1 * c.progress
        assert plain(_at_least)(local, c, Rest(math.inf, accel), v, steps, 0.1) == 0.0
    short = local._replace(open_ahead=True)
    more = plain(_at_least)(short, c, Rest(15.0, 1.0), 4.0, 20, 0.1) - plain(_at_least)(
        local, c, Rest(15.0, 1.0), 4.0, 20, 0.1
    )
    missing = 15.0 - 4.0 - 2.0  # m/s below the limit at the end, to be picked up with 2.6 m/s2
    assert more == pytest.approx(c.progress * missing * missing / (2.0 * 2.6 * 15.0))
    twice = c._replace(progress=2.0 * c.progress)
    for each in (local, short):
        found = [plain(_at_least)(each, w, Rest(15.0, 1.0), 4.0, 20, 0.1) for w in (c, twice)]
        assert found[1] == pytest.approx(2.0 * found[0]) and found[0] > 0.0


@pytest.mark.parametrize(("length", "limit"), [(900.0, 15.0), (150.0, math.inf)])
def test_where_the_route_may_end_before_the_horizon_nothing_is_certain(
    length: float, limit: float
) -> None:
    road = lanes_east(3, length)
    ego = ego_at(road, "a_1", 100.0, 8.0)
    task = task_of(road, ego)
    problem = problem_of(task, situation_of(task, scene_of(ego, road)))
    assert _rest(problem) == Rest(limit, task.ego.max_accel)
    fast = problem._replace(state=problem.state._replace(a=4.0))
    assert _rest(fast).accel == 4.0


def test_each_beginning_and_each_action_is_driven() -> None:
    """Two plies of two actions each: both beginnings go on with following, with the other's
    sequence, and with both actions."""
    ego = ego_at(LANES, "a_1", 100.0, 8.0)
    problem = problem_of(TASK, situation_of(TASK, scene_of(ego, LANES)))
    few = np.array([(-3.0, 0.0), (1.0, 0.0)])
    problem = problem._replace(
        ends=problem.ends[:2], actions=few, roots=few,
        q=problem.q._replace(horizon=float(problem.ends[1]) * 0.1),
    )  # fmt: skip
    lines = root_lines(problem)
    found = solve(problem, lines)
    steps = int(problem.ends[0])
    # beginnings step by step; for each: following, the sequence found before, both actions; then
    # the sequence of the other
    assert found.driven == 2 * steps + (1 + 2) + (1 + 1 + 2) + 2
    assert not found.collides.any() and np.isnan(found.best[:, 0]).all()
    alone = solve(problem, lines[1:])
    assert alone.value[0] == found.value[1] and found.value[1] < found.value[0]
