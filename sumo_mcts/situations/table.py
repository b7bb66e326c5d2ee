"""The kinds by name: those of dense traffic, one for each rule of the road, those of passing."""

from collections.abc import Mapping

from sumo_mcts.situations import control, junctions, lanes, passing, priority, sharing
from sumo_mcts.situations.kind import Kind

DENSE: Mapping[str, Kind] = {
    kind.name: kind for kind in (*junctions.KINDS, *priority.KINDS, *lanes.KINDS)
}
RULES: Mapping[str, Kind] = {kind.name: kind for kind in (*control.KINDS, *sharing.KINDS)}
PASSING: Mapping[str, Kind] = {kind.name: kind for kind in passing.KINDS}
