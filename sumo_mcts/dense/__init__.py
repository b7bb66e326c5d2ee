"""Dense situations: kinds of networks with traffic, drawn by the seed.

kind.py        what a kind is: ranges of parameters, the two halves of each, the draw
situation.py   what a kind builds: nodes, edges, links, streams, the ego's route
junctions.py   kinds at signals
priority.py    kinds at junctions without signals
lanes.py       kinds on one road: merging, weaving, lanes that end
table.py       the kinds by name
families.py    families of drivers, as vehicle types
texts.py       a situation as the files of SUMO
docs.py        the table of kinds in docs/dense.md

Nothing here knows SUMO: texts alone are made. world/generated.py turns them into a network.
"""

from sumo_mcts.dense.families import FAMILIES, SUBLANE, Family
from sumo_mcts.dense.kind import HALVES, Half, Kind, drawn
from sumo_mcts.dense.situation import Situation
from sumo_mcts.dense.table import KINDS
from sumo_mcts.dense.texts import plain_files, routes

__all__ = [
    "FAMILIES",
    "HALVES",
    "KINDS",
    "SUBLANE",
    "Family",
    "Half",
    "Kind",
    "Situation",
    "drawn",
    "plain_files",
    "routes",
]
