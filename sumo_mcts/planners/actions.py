"""Actions and sequences of actions: their columns, and the kernels that read and write them.

An action is an acceleration, or car following, with or without a lane change that begins with it.
A sequence is an array [M, 3] of actions, one for each level of the tree or for each step of the
simulation. A row whose acceleration is nan holds none.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats, Indices
from sumo_mcts.numerics.kernel import kernel

# Columns of sequences and of tables of actions: acceleration (m/s2, or FOLLOW); lane change (-1
# right, 0 none, 1 left).
ACCEL, SIDE = range(2)
SPEED = 2  # of sequences: the commanded speed, m/s; NO_SPEED: none
LATER = 2  # of tables: 1 where the search tries the action below the root too

FOLLOW = 99.0  # in place of an acceleration: car following. No configured one is as high
NO_SPEED = -1.0
_KEPT_SIDE = 1000.0  # a lane change in the numbers that a planner keeps: beyond any acceleration


class Action(NamedTuple):
    """What the ego does for one level of the tree, or for one step."""

    accel: float  # m/s2, or FOLLOW
    side: int  # of the lane change that begins: -1, 0, 1
    speed: float  # m/s, driven whatever the road allows; NO_SPEED: the acceleration counts


class Lines(NamedTuple):
    """M sequences with an action for each step of the simulation."""

    actions: Floats  # [M, S, 3] rows beyond `steps` hold none
    steps: Indices  # [M] the length of each


@kernel
def action_at(line: Floats, k: int) -> Action:
    """Row k of a sequence; it must hold an action."""
    return Action(line[k, ACCEL], int(line[k, SIDE]), line[k, SPEED])


@kernel
def put_action(line: Floats, k: int, accel: float, side: int) -> None:
    """Write an action into row k of a sequence."""
    line[k, ACCEL], line[k, SIDE], line[k, SPEED] = accel, side, NO_SPEED


@kernel
def clear_line(line: Floats) -> None:
    """Leave no action in a sequence."""
    for k in range(line.shape[0]):
        line[k, ACCEL] = np.nan


@kernel
def copy_line(source: Floats, target: Floats) -> None:
    """Copy a sequence: assigning slices would need an array in between."""
    for k in range(source.shape[0]):
        target[k, ACCEL], target[k, SIDE] = source[k, ACCEL], source[k, SIDE]
        target[k, SPEED] = source[k, SPEED]


def no_actions(*shape: int) -> Floats:
    """Sequences [*shape, 3] without an action."""
    return np.full((*shape, 3), np.nan)


def lasting(accel: float, side: int, steps: int) -> Floats:
    """[steps, 3] one acceleration (m/s2, or FOLLOW) for so many steps of the simulation.

    The lane change begins with the first.
    """
    line = np.tile([accel, 0.0, NO_SPEED], (steps, 1))
    line[:1, SIDE] = side
    return line


def commanded(speeds: Floats, side: int) -> Floats:
    """[M, 3] a profile of speeds [M] (m/s), one for each step of the simulation."""
    line = lasting(FOLLOW, side, len(speeds))
    line[:, SPEED] = speeds
    return line


def lines_of(sequences: Sequence[Floats]) -> Lines:
    """Sequences [., 3] of any length in one array."""
    steps = np.array([len(each) for each in sequences], np.int64)
    actions = no_actions(len(steps), int(steps.max(initial=0)))
    for row, each in zip(actions, sequences, strict=True):
        row[: len(each)] = each
    return Lines(actions, steps)


def to_steps(line: Floats, steps: Indices | int) -> Floats:
    """A sequence with a row for each step of the simulation, from one [P, 3] whose actions last
    `steps` (one number, or [P])."""
    rows = np.repeat(line, steps, axis=0)
    begins = np.zeros(len(rows), np.bool_)
    lasts = np.broadcast_to(steps, len(line))
    begins[np.cumsum(lasts) - lasts] = True
    rows[~begins, SIDE] = 0.0
    return rows


def packed(line: Floats) -> Floats:
    """A sequence [M, 3] without commanded speeds as the numbers [M] that traces hold."""
    return line[:, ACCEL] + _KEPT_SIDE * line[:, SIDE]


def unpacked(numbers: Floats) -> Floats:
    """The sequence [M, 3] that was packed, to the rounding of the numbers."""
    side = np.rint(numbers / _KEPT_SIDE)
    return np.column_stack([numbers - _KEPT_SIDE * side, side, np.full(len(numbers), NO_SPEED)])
