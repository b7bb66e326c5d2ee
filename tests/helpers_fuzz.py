"""Functions for fuzzing: hostile values, damaged XML trees, and error messages."""

import copy
import random
from collections.abc import Callable, Sequence
from xml.etree import ElementTree

from sumo_mcts.errors import ConfigError

# Replacements for a number in a file.
HOSTILE = (
    "nan", "inf", "-inf", "0", "-1", "1e300", "-1e300", "1e-300", "", "x", "999999999",
    "99999999999999999999", "-999999999", ":", "1e", "é", "a b",
    "2147483648", "0x10", "true", ",", "0,0", "nan,nan nan,nan", "0,0 0,0", "1e300,1e300 0,0",
    "0,0 1e9,1e9",
)  # fmt: skip


def refusal(function: Callable[[], object]) -> str:
    """The message of the ConfigError that a function raises; "" where it raises none."""
    try:
        function()
    except ConfigError as error:
        return str(error)
    return ""


def mutated(
    tree: ElementTree.ElementTree, seed: int, changes: int, values: Sequence[str] = HOSTILE
) -> ElementTree.ElementTree:
    """The tree with some of its values replaced, and elements removed, doubled or moved."""
    draw = random.Random(seed)
    for _ in range(changes):
        pairs = [(parent, child) for parent in tree.iter() for child in parent]
        parent, child = draw.choice(pairs)
        kind = draw.random()
        if kind < 0.6 and child.attrib:
            child.set(draw.choice(list(child.attrib)), draw.choice(values))
        elif kind < 0.8:
            parent.remove(child)
        elif kind < 0.9:
            parent.append(copy.deepcopy(child))
        else:
            draw.choice(pairs)[1].append(copy.deepcopy(child))
    return tree
