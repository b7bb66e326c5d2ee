"""The kinds by name."""

from collections.abc import Mapping

from sumo_mcts.dense import junctions, lanes, priority
from sumo_mcts.dense.kind import Kind

KINDS: Mapping[str, Kind] = {
    kind.name: kind for kind in (*junctions.KINDS, *priority.KINDS, *lanes.KINDS)
}
