"""Large columns of a trace that are drawn and not computed with: in whole steps, and as what
changes from time to time, which packs into a quarter of the bytes.

Positions are kept to 5 mm, speeds to 5 mm/s, cosines and sines to 0.00005.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sumo_mcts.arrays import Floats

# Columns by the ends of their names, and which axis of their arrays is time. Along an axis before
# it (hypotheses) the arrays are much alike.
TIME_AXIS = {
    "forecast/pose": 1, "forecast/v": 1, "forecast/s": 1, "Plan/pose": 0, "children/poses": 0,
}  # fmt: skip
LENGTH = 0.01  # m, m/s
POSE = (LENGTH, LENGTH, 1e-4, 1e-4)  # x, y, cosine, sine
MOST = 2**52  # steps
NONE = -MOST - 1  # of what is no number

Steps = NDArray[np.int64]


def time_axis(path: str) -> int | None:
    """Which axis of the arrays in this column is time; None: the column is not coarse."""
    return next((axis for end, axis in TIME_AXIS.items() if path.endswith(end)), None)


def to_steps(values: Floats, axis: int) -> Steps:
    """An array of any shape as a row of second differences along `axis`, in steps."""
    scaled = np.rint(values / _step(values.shape))
    steps = np.where(np.isnan(scaled), NONE, np.clip(scaled, -MOST, MOST)).astype(np.int64)
    if _has(steps.shape, axis):
        if axis > 0:
            steps[1:] -= steps[0]
        steps = np.diff(steps, n=2, axis=axis, prepend=_zeros(steps, axis))
    return np.ravel(steps)


def from_steps(row: Steps, shape: Sequence[int], axis: int) -> Floats:
    """The inverse of to_steps, but for rounding."""
    steps = row.astype(np.int64).reshape(shape)
    if _has(steps.shape, axis):
        steps = steps.cumsum(axis).cumsum(axis)
        if axis > 0:
            steps[1:] += steps[0]
    return np.where(steps == NONE, np.nan, steps * _step(steps.shape))


def narrowed(row: Steps) -> NDArray[np.int32] | Steps:
    """The row in 32 bits where all of it fits: half the bytes, and a sixth less when packed."""
    fits = not len(row) or max(row.max(), -row.min()) < 2**31
    return row.astype(np.int32) if fits else row


def _zeros(steps: Steps, axis: int) -> Steps:
    """Two times of nothing, so that the first entries are kept themselves."""
    return np.zeros([2 if k == axis else n for k, n in enumerate(steps.shape)], np.int64)


def _has(shape: Sequence[int], axis: int) -> bool:
    return len(shape) > axis and 0 not in shape


def _step(shape: Sequence[int]) -> Floats:
    """The size of a step in each entry of the last axis."""
    return np.array(POSE if len(shape) > 1 and shape[-1] == len(POSE) else LENGTH)
