"""Where the predicted paths of vehicles meet, and which rule each vehicle has to follow there."""

from typing import NamedTuple

import numpy as np

from sumo_mcts.arrays import Floats, Ints
from sumo_mcts.numerics.kernel import entry, kernel
from sumo_mcts.numerics.lanes import Areas, areas_of
from sumo_mcts.prediction.paths import Paths
from sumo_mcts.road import RoadMap

# Conflicts checked for each vehicle. The most that were seen are 59, with a car every 20 m of
# lane.
FOES = 64

# The rule for a vehicle where its path meets that of a foe (Conflicts.kind).
NOTHING = 0
YIELDS = 1  # it has to let the foe pass
MERGES = 2  # both have equal right: the nearer one goes first, the other follows it
MUTUAL = 3  # each has to let the other pass: the earlier one goes
IN_TURN = 4  # an all-way stop: the one that came to a stand first goes

# Columns of Conflicts.place: the shared stretch on the vehicle's own path and on the foe's.
OWN_BEGIN, OWN_END, FOE_BEGIN, FOE_END = range(4)


class Conflicts(NamedTuple):
    """The foes of each of N vehicles: the others whose paths meet its own where it must yield, or
    where lanes merge."""

    foe: Ints  # [N, FOES] index of the other vehicle, -1 beyond the end
    kind: Ints  # [N, FOES] YIELDS .. IN_TURN
    place: Floats  # [N, FOES, 4] columns OWN_BEGIN .. FOE_END, m from the start of the path
    # [N, N] the others that drive on a lane of its path, in rising order, -1 beyond the end
    along: Ints


def conflicts_of(road: RoadMap, paths: Paths) -> Conflicts:
    """Where the paths of N vehicles meet."""
    n = len(paths.lane)
    found = Conflicts(
        foe=np.full((n, FOES), -1, np.int32),
        kind=np.zeros((n, FOES), np.int32),
        place=np.zeros((n, FOES, 4)),
        along=np.full((n, n), -1, np.int32),
    )
    mark, used = np.full(len(road.lane_ids), -1, np.int32), np.zeros((2, n), np.int32)
    _find_conflicts(found, paths, areas_of(road), mark, used)
    return found


@entry
def _find_conflicts(found: Conflicts, paths: Paths, areas: Areas, mark: Ints, used: Ints) -> None:
    """Fill `found`.

    Work space: `mark` [lanes of the road], all -1, and `used` [2, N], all 0.
    """
    n, foes, others = len(paths.lane), used[0], used[1]
    for j in range(n):
        # a path may come to a lane twice, in a roundabout: the first time counts
        for k in range(paths.count[j] - 1, -1, -1):
            mark[paths.lane[j, k]] = k
        for i in range(n):
            shares = False
            for m in range(paths.count[i] if i != j else 0):
                lane = paths.lane[i, m]
                shares = shares or mark[lane] >= 0
                for e in range(areas.first[lane], areas.first[lane + 1]):
                    k, u = mark[areas.other[e]], foes[i]
                    kind = _kind(areas, lane, e) if k >= 0 and u < found.foe.shape[1] else NOTHING
                    if kind == NOTHING:
                        continue
                    own, foe = paths.offset[i, m], paths.offset[j, k]
                    found.foe[i, u], found.kind[i, u] = j, kind
                    found.place[i, u, OWN_BEGIN] = own + areas.begin[e]
                    found.place[i, u, OWN_END] = own + areas.end[e]
                    found.place[i, u, FOE_BEGIN] = foe + areas.other_begin[e]
                    found.place[i, u, FOE_END] = foe + areas.other_end[e]
                    foes[i] += 1
            if shares:
                found.along[i, others[i]] = j
                others[i] += 1
        for k in range(paths.count[j]):
            mark[paths.lane[j, k]] = -1


@kernel
def _kind(areas: Areas, lane: int, e: int) -> int:
    """The rule for a vehicle on `lane` in its conflict area `e`: NOTHING .. IN_TURN."""
    back = False  # the other lane has to yield too
    for r in range(areas.first[areas.other[e]], areas.first[areas.other[e] + 1]):
        back = back or (areas.other[r] == lane and areas.yields[r])
    if areas.zipper[lane] and areas.merge[e]:
        return MERGES
    if areas.yields[e]:
        return IN_TURN if areas.allway[lane] else MUTUAL if back else YIELDS
    return MERGES if areas.merge[e] and not back else NOTHING
