"""Connections between lanes: direction, right of way, signal; and which junctions are one."""

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from sumo_mcts.arrays import Bools, Floats, Ints
from sumo_mcts.road import (
    ALLWAY,
    LEFT,
    PEOPLE_FIRST,
    PEOPLE_WAIT,
    PRIORITY,
    RIGHT,
    STOP,
    STRAIGHT,
    TURN,
    VEHICLE_CLASSES,
    YIELD,
    ZIPPER,
)
from sumo_mcts.world.net_file import CROSSING, ON_FOOT

CLUSTER = 25.0  # m: junctions with shorter lanes between them are one cluster
MOST_IN_CHAIN = 20  # internal lanes of one connection
# SUMO's letters for the direction and the state of a connection.
_DIRECTIONS = {"s": STRAIGHT, "l": LEFT, "L": LEFT, "r": RIGHT, "R": RIGHT, "t": TURN, "T": TURN}
_RULES = {"m": YIELD, "=": YIELD, "o": YIELD, "s": STOP, "w": ALLWAY, "Z": ZIPPER}


class Link(NamedTuple):
    """One connection across a junction, from ordinary lane `origin` to ordinary lane `exit` along
    the internal lanes of `chain`."""

    origin: int  # lane
    exit: int  # lane
    chain: tuple[int, ...]  # empty where the network has none and vehicles jump
    edges: tuple[str, str]  # those of origin and exit
    junction: int  # index
    yields_to: int  # bit k set: it has to let link k of the junction pass
    foes: int  # bit k set: SUMO holds that it meets link k
    number: int  # its own bit in `yields_to` and `foes` of the others, -1 unknown
    direction: int  # STRAIGHT .. TURN
    rule: int  # PRIORITY .. ALLWAY
    signal: int  # index, -1: none
    signal_link: int  # index in that signal's state, -1: none
    classes: int  # bit mask over VEHICLE_CLASSES


def has_bit(bits: int, link: Link) -> bool:
    """Whether the bit of a link is set, in `yields_to` or `foes` of another one of its junction; an
    unknown link (-1) has none."""
    return link.number >= 0 and bool(bits >> link.number & 1)


def read_links(
    net: Any, number: dict[str, int], junction_number: dict[str, int]
) -> tuple[tuple[str, ...], list[Link]]:
    """Signal ids in the order of their first link, and every connection across a junction.

    `number`: lane id -> index; `junction_number`: junction id -> index. Raises ValueError.
    """
    signals: dict[str, int] = {}
    links: list[Link] = []
    for edge in net.getEdges(withInternal=False):
        node = edge.getToNode()
        # intLanes names the last internal lane of each link, in the order of the right-of-way
        # matrix
        place = {lane: i for i, lane in enumerate(node.getInternal() or ())}
        # bit strings are read from the right, which is what int() does; sumolib keeps them private
        yields_to = {i: int(bits, 2) for i, bits in node._prohibits.items()}
        foes = {i: int(bits, 2) for i, bits in node._foes.items()}
        for connection in (
            connection for lane in edge.getLanes() for connection in _connections(lane)
        ):
            chain = _chain(net, connection)
            own = next((place[lane] for lane in reversed(chain) if lane in place), -1)
            if not chain:
                own = connection.getJunctionIndex()
            signal = connection.getTLSID()
            links.append(
                Link(
                    origin=number[connection.getFromLane().getID()],
                    exit=number[connection.getToLane().getID()],
                    chain=tuple(number[lane] for lane in chain),
                    edges=(edge.getID(), connection.getTo().getID()),
                    junction=junction_number[node.getID()],
                    yields_to=yields_to.get(own, 0),
                    foes=foes.get(own, 0),
                    number=own,
                    direction=_DIRECTIONS.get(connection.getDirection(), STRAIGHT),
                    rule=_rule(connection, yields_to.get(own, 0)),
                    signal=signals.setdefault(signal, len(signals)) if signal else -1,
                    signal_link=connection.getTLLinkIndex() if signal else -1,
                    classes=mask_of(frozenset(connection._allowed)),
                )
            )
    return tuple(signals), links


def _chain(net: Any, connection: Any) -> tuple[str, ...]:
    """Ids of the internal lanes that a connection leads over; two where a left turn may wait inside
    the junction."""
    chain: list[str] = []
    while connection.getViaLaneID():
        chain.append(connection.getViaLaneID())
        onward = net.getLane(chain[-1]).getOutgoing()
        if len(onward) != 1 or len(chain) > MOST_IN_CHAIN:
            raise ValueError(
                f"lane {chain[-1]}, inside a junction, does not lead to one lane outside"
            )
        connection = onward[0]
    return tuple(chain)


def _rule(connection: Any, yields_to: int) -> int:
    """How the connection is entered.

    Under a signal its letter says little: what counts is whether it has to let any other pass.
    """
    if connection.getTLSID():
        return YIELD if yields_to else PRIORITY
    return _RULES.get(connection.getState(), PRIORITY)


class Entry(NamedTuple):
    """How people enter a crossing."""

    rule: int  # PEOPLE_FIRST or PEOPLE_WAIT
    signal: int  # index, -1: none
    signal_link: int  # index in that signal's state, -1: none


def crossing_entries(
    edges: Iterable[Any], number: dict[str, int], signal_ids: Sequence[str]
) -> dict[int, Entry]:
    """The crossings, as lanes, and how people enter them.

    `number`: lane id -> index; `signal_ids`: of the signals that vehicles have.
    """
    return {
        number[connection.getToLane().getID()]: _entry(connection, signal_ids)
        for edge in edges
        if edge.getFunction() == CROSSING
        for connections in edge.getIncoming().values()
        for connection in connections
    }


def _entry(connection: Any, signal_ids: Sequence[str]) -> Entry:
    """How people enter a crossing by a connection."""
    signal = connection.getTLSID()
    if signal in signal_ids:
        return Entry(PEOPLE_FIRST, signal_ids.index(signal), connection.getTLLinkIndex())
    waits = _RULES.get(connection.getState()) == YIELD
    return Entry(PEOPLE_WAIT if waits else PEOPLE_FIRST, -1, -1)


# --- lanes and their connections ---


def following_lane(lane: Any, number: dict[str, int]) -> list[int]:
    """The lanes driven next from a lane; `number`: lane id -> index."""
    return [number[_next_id(connection)] for connection in _connections(lane)]


def _connections(lane: Any) -> list[Any]:
    """The connections from a lane that vehicles may take."""
    if lane.getEdge().getFunction() in ON_FOOT:
        return []
    return [
        connection
        for connection in lane.getOutgoing()
        if connection.getTo().getFunction() not in ON_FOOT
    ]


def _next_id(connection: Any) -> str:
    """The lane driven next: the internal one where there is one."""
    return str(connection.getViaLaneID() or connection.getToLane().getID())


@cache
def mask_of(allowed: frozenset[str]) -> int:
    """Bit mask over VEHICLE_CLASSES of the classes named."""
    return sum(
        1 << i for i, name in enumerate(VEHICLE_CLASSES) if name in allowed or "all" in allowed
    )


# --- junction clusters ---


def junction_clusters(internal: Bools, length: Floats, begins: Ints, ends: Ints) -> dict[str, Ints]:
    """RoadMap.knot, begins and ends: the junction clusters in which each lane [L] lies, begins and
    ends; -1: none.

    `begins` and `ends` [L]: the junctions; of internal lanes both are that which they lie in.
    """
    inside = internal | (length < CLUSTER)
    # the last name stands for "no junction"
    name = np.arange(max(begins.max(initial=-1), ends.max(initial=-1)) + 2)
    joins = np.unique(
        np.column_stack([begins, ends])[inside & (begins >= 0) & (ends >= 0) & (begins != ends)],
        axis=0,
    )
    for a, b in joins:  # once for an edge, not for each of its lanes
        name[name == name[b]] = name[a]
    name[-1] = -1
    return {
        key: values.astype(np.int32)
        for key, values in (
            ("knot", np.where(inside, name[begins], -1)),
            ("begins", name[begins]),
            ("ends", name[ends]),
        )
    }
