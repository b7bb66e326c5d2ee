"""Large columns of a trace that no decision depends on, only what is drawn and explained: in whole
steps, and as what changes from time to time, which packs into a quarter of the bytes.

Positions are kept to 5 mm, speeds to 5 mm/s, cosines and sines to 0.00005.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Floats

LENGTH = (0.01,)  # m, m/s
POSE = (0.01, 0.01, 1e-4, 1e-4)  # x, y, cosine, sine


class Layout(NamedTuple):
    """How the arrays of a column lie: which axis is time, and the step of the last axis' entries.

    Along an axis before it (hypotheses) the arrays are much alike.
    """

    axis: int
    step: tuple[float, ...]


# by the ends of the columns' names
LAYOUTS = {
    "forecast/pose": Layout(1, POSE), "forecast/v": Layout(1, LENGTH),
    "forecast/s": Layout(1, LENGTH), "Plan/pose": Layout(0, POSE),
    "children/poses": Layout(0, POSE),
}  # fmt: skip
MOST = 2**52  # steps
NONE = -MOST - 1  # of what is no number

Steps = NDArray[np.int64]


def layout_of(path: str) -> Layout | None:
    """How the arrays in this column lie; None: the column is not coarse."""
    return next((layout for end, layout in LAYOUTS.items() if path.endswith(end)), None)


def to_steps(values: Floats, layout: Layout) -> Steps:
    """An array as a row of second differences along time, in steps."""
    axis = layout.axis
    scaled = np.rint(values / _step(values.shape, layout))
    steps = np.where(np.isnan(scaled), NONE, np.clip(scaled, -MOST, MOST)).astype(np.int64)
    if _has(steps.shape, axis):
        if axis > 0:
            steps[1:] -= steps[0]
        steps = np.diff(steps, n=2, axis=axis, prepend=_zeros(steps, axis))
    return np.ravel(steps)


def from_steps(row: Steps, shape: Sequence[int], layout: Layout) -> Floats:
    """The inverse of to_steps, but for rounding."""
    steps, axis = row.astype(np.int64).reshape(shape), layout.axis
    if _has(steps.shape, axis):
        steps = steps.cumsum(axis).cumsum(axis)
        if axis > 0:
            steps[1:] += steps[0]
    return np.where(steps == NONE, np.nan, steps * _step(steps.shape, layout))


def narrowed(row: Steps) -> NDArray[np.int32] | Steps:
    """The row in 32 bits where all of it fits: half the bytes, and a sixth less when packed."""
    fits = not len(row) or max(row.max(), -row.min()) < 2**31
    return row.astype(np.int32) if fits else row


def _zeros(steps: Steps, axis: int) -> Steps:
    """Two times of nothing, so that the first entries are kept themselves."""
    return np.zeros([2 if k == axis else n for k, n in enumerate(steps.shape)], np.int64)


def _has(shape: Sequence[int], axis: int) -> bool:
    return len(shape) > axis and 0 not in shape


def _step(shape: Sequence[int], layout: Layout) -> Floats:
    """The size of a step in each entry of the last axis; arrays of another size (in damaged files)
    have that of lengths."""
    fits = len(shape) > 0 and shape[-1] == len(layout.step)
    return np.array(layout.step if fits else LENGTH)
