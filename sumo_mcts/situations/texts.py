"""A situation as the files of netconvert and SUMO."""

from collections.abc import Iterable, Iterator, Mapping, Set
from random import Random
from xml.etree import ElementTree

from sumo_mcts.situations.families import DEVICES, Family, types
from sumo_mcts.situations.situation import Companion, Edge, LaneStop, Parked, Situation, Stream

WARM_UP_S = (100.0, 160.0)  # the ego departs between; a cycle of signals apart
TRAFFIC_S = 480.0  # vehicles depart until then
SPREAD = 0.4  # of regular gaps around their mean
EGO = "ego"


def plain_files(situation: Situation) -> dict[str, str]:
    """Option of netconvert -> the text of the file that it names."""
    nodes = [_element("node", node._asdict()) for node in situation.nodes]
    edges = [_edge(edge) for edge in situation.edges]
    rings = [
        _element("roundabout", {"nodes": nodes, "edges": edges}) for nodes, edges in situation.rings
    ]
    links = [
        _element("connection", {"from": link.start, "to": link.end, "fromLane": link.from_lane,
         "toLane": link.to_lane})
        for link in situation.links
    ]  # fmt: skip
    return {
        "node-files": _file("nodes", nodes),
        "edge-files": _file("edges", [*edges, *rings]),
        "connection-files": _file("connections", links),
    }


def routes(situation: Situation, family: Family, trucks: float, random: Random) -> str:
    """The route file: vehicle types, the others in the order in which they depart, the ego.

    trucks: their share
    """
    parked = [_parked(each, k) for k, each in enumerate(situation.parked)]
    moving = [
        entry
        for k, stream in enumerate(situation.streams)
        for entry in _departures(stream, f"{k}", trucks, random)
    ]
    departs = random.uniform(*WARM_UP_S)
    moving.append((departs, _ego(situation)))
    moving += [
        (departs - each.before, _companion(each, f"with.{k}", situation.ego_route))
        for k, each in enumerate(situation.companions)
    ]
    root = ElementTree.Element("routes")
    used = {stream.vtype for stream in situation.streams}
    used |= {each.vtype for each in situation.companions}
    root.extend(_types(family, used))
    root.extend(parked)
    for time, element in sorted(moving, key=lambda each: each[0]):
        element.set("depart", f"{time:.2f}")
        root.append(element)
    return _text(root)


def _departures(
    stream: Stream, name: str, trucks: float, random: Random
) -> Iterator[tuple[float, ElementTree.Element]]:
    """Time of departure, and the vehicle or pedestrian, one after the other."""
    mean = 3600.0 / stream.per_hour
    time, number = random.uniform(0.0, mean), 0
    while time < TRAFFIC_S:
        vtype = stream.vtype or ("truck" if random.random() < trucks else "car")
        traveller = _traveller(f"{name}.{number}", vtype, stream.route, stream.lane)
        traveller.extend(_stop(stop) for stop in stream.stops)
        yield time, traveller
        time += (
            mean * random.uniform(1.0 - SPREAD, 1.0 + SPREAD)
            if stream.regular
            else random.expovariate(1.0 / mean)
        )
        number += 1


def _traveller(name: str, vtype: str, route: str, lane: str) -> ElementTree.Element:
    if vtype == "pedestrian":
        person = ElementTree.Element("person", {"id": name, "type": vtype, "depart": ""})
        ElementTree.SubElement(person, "walk", {"edges": route})
        return person
    vehicle = ElementTree.Element(
        "vehicle",
        {"id": name, "type": vtype, "depart": "", "departLane": lane, "departSpeed": "max"},
    )
    ElementTree.SubElement(vehicle, "route", {"edges": route})
    return vehicle


def _ego(situation: Situation) -> ElementTree.Element:
    return _traveller(EGO, EGO, situation.ego_route, situation.ego_lane)


def _companion(each: Companion, name: str, route: str) -> ElementTree.Element:
    vehicle = _traveller(name, each.vtype, route, "best")
    if each.share != 1.0:
        vehicle.set("speedFactor", f"{each.share:.2f}")
    return vehicle


def _parked(van: Parked, number: int) -> ElementTree.Element:
    vehicle = _traveller(f"van.{number}", "van", van.edge, str(van.lane))
    vehicle.attrib |= {"depart": "0.00", "departPos": f"{van.position:.2f}", "departSpeed": "0"}
    stop = _stop(LaneStop(van.edge, van.lane, van.position, 86400.0))
    if van.aside:
        vehicle.set("departPosLat", f"{van.aside:.2f}")
        stop.set("posLat", f"{van.aside:.2f}")
    vehicle.append(stop)
    return vehicle


def _stop(stop: LaneStop) -> ElementTree.Element:
    return ElementTree.Element(
        "stop",
        {"lane": f"{stop.edge}_{stop.lane}", "endPos": f"{stop.position:.2f}",
         "duration": f"{stop.duration:.0f}"},
    )  # fmt: skip


def _types(family: Family, used: Set[str]) -> Iterator[ElementTree.Element]:
    """The vehicle types that every file has, and of the others those that are used."""
    for name, attributes in types(family, used).items():
        element = ElementTree.Element("vType", {"id": name, **attributes})
        for key, value in DEVICES.get(name, {}).items():
            ElementTree.SubElement(element, "param", {"key": key, "value": value})
        yield element


def _edge(edge: Edge) -> ElementTree.Element:
    shape = " ".join(f"{x:.2f},{y:.2f}" for x, y in edge.shape)
    attributes = {
        "id": edge.id, "from": edge.start, "to": edge.end, "numLanes": edge.lanes,
        "speed": edge.speed, "priority": edge.priority, **({"shape": shape} if shape else {}),
        **({"width": edge.width} if edge.width else {}),
    }  # fmt: skip
    element = _element("edge", attributes)
    element.extend(_element("lane", {"index": lane, "allow": only}) for lane, only in edge.only)
    return element


def _element(tag: str, attributes: Mapping[str, object]) -> ElementTree.Element:
    return ElementTree.Element(tag, {key: _word(each) for key, each in attributes.items()})


def _file(root: str, elements: Iterable[ElementTree.Element]) -> str:
    top = ElementTree.Element(root)
    top.extend(elements)
    return _text(top)


def _word(value: object) -> str:
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def _text(root: ElementTree.Element) -> str:
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"
