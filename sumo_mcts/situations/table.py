"""The kinds by name: those of dense traffic, and one for each rule of the road."""

from collections.abc import Mapping

from sumo_mcts.situations import control, junctions, lanes, priority, sharing
from sumo_mcts.situations.kind import Kind

DENSE: Mapping[str, Kind] = {
    kind.name: kind for kind in (*junctions.KINDS, *priority.KINDS, *lanes.KINDS)
}
RULES: Mapping[str, Kind] = {kind.name: kind for kind in (*control.KINDS, *sharing.KINDS)}
