"""Situations: kinds of networks with traffic, drawn by the seed.

kind.py        what a kind is: ranges of parameters, the two halves of each, the draw
situation.py   what a kind builds: nodes, edges, links, streams, the ego's route
junctions.py   dense traffic at signals
priority.py    dense traffic at junctions without signals
lanes.py       dense traffic on one road: merging, weaving, lanes that end
control.py     rules at signals, signs and rails
sharing.py     rules of a road shared with buses, trams, bicycles, people
passing.py     passing slow traffic, through the lane of the oncoming or within the own lane
table.py       the kinds by name
families.py    families of drivers, as vehicle types
texts.py       a situation as the files of SUMO
docs.py        the tables of kinds in docs/dense.md, docs/rules.md and docs/passing.md

Nothing here knows SUMO: texts alone are made. world/generated.py turns them into a network.
"""

from sumo_mcts.situations.families import FAMILIES, SUBLANE, Family
from sumo_mcts.situations.kind import HALVES, Half, Kind, drawn
from sumo_mcts.situations.situation import Situation
from sumo_mcts.situations.table import DENSE, PASSING, RULES
from sumo_mcts.situations.texts import plain_files, routes

__all__ = [
    "DENSE",
    "FAMILIES",
    "HALVES",
    "PASSING",
    "RULES",
    "SUBLANE",
    "Family",
    "Half",
    "Kind",
    "Situation",
    "drawn",
    "plain_files",
    "routes",
]
