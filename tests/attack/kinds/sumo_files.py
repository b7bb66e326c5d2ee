"""Wrong files of SUMO: configurations, networks, routes and additional files."""

import gzip
import re
from collections.abc import Iterator

from ..case import ANY, DRIVING_S, NOT_DRIVEN, Case
from ..good import NET, ROUTES, SUMOCFG

ENTITIES = "<!DOCTYPE x [<!ENTITY a0 'aaaaaaaaaa'>{}]>".format(
    "".join(f"<!ENTITY a{k} '{f'&a{k - 1};' * 10}'>" for k in range(1, 10))
)
OUTSIDE = "<!DOCTYPE x [<!ENTITY a SYSTEM 'file:///etc/passwd'>]>"
RUN = ("run", "n.sumocfg", "--ego", "ego", "--planner", "constant", "--time-limit", "3", "--json")
NET_FILES = ("n.sumocfg", "net.xml")


def damages(text: str, root: str) -> Iterator[tuple[str, bytes]]:
    """What may happen to any XML file."""
    content = text.encode()
    zipped = gzip.compress(content)
    yield "nothing", b""
    yield "spaces", b" \n"
    yield "zero bytes", b"\0" * 4096
    yield "random bytes", bytes(range(256)) * 20
    for share in (10, 35, 60, 90, 99):
        yield f"cut off at {share} %", content[: len(content) * share // 100]
    yield "no XML", b"name: good\n"
    yield "another root", b"<tank/>"
    yield "two roots", f"<{root}/><{root}/>".encode()
    yield "an empty root", f"<{root}/>".encode()
    yield "an unknown encoding", b'<?xml version="1.0" encoding="tank"?>' + _body(content)
    yield "a wrong encoding", b'<?xml version="1.0" encoding="UTF-16"?>' + _body(content)
    yield "UTF-16", _body(content).decode().encode("utf-16")
    yield (
        "bytes that are no UTF-8",
        content.replace(b"<", b"<!-- \xff\xfe -->\n<", 1)
        if not content.startswith(b"<?xml")
        else content.replace(b"?>", b"?><!-- \xff\xfe -->", 1),
    )
    yield "a bomb of entities", f"{ENTITIES}<{root} a='&a9;'/>".encode()
    yield "a file of others as an entity", f"{OUTSIDE}<{root}>&a;</{root}>".encode()
    yield (
        "deep elements",
        (f"<{root}>" + "<a>" * 100_000 + "</a>" * 100_000 + f"</{root}>").encode(),
    )
    yield "an attribute twice", f"<{root} a='1' a='2'/>".encode()
    yield "a long attribute", f"<{root} a='{'x' * 5_000_000}'/>".encode()
    yield "an open comment", content + b"<!-- "
    yield "words behind the end", content + b"tank"
    yield "zipped", zipped
    yield "zipped, cut off", zipped[: len(zipped) // 2]
    yield "zipped, the head only", zipped[:12]


def _body(content: bytes) -> bytes:
    return re.sub(rb"^<\?xml.*?\?>\s*", b"", content)


SOUND = (
    "zipped",
    "bytes that are no UTF-8",
    "UTF-16",
    "a file of others as an entity",
    "a long attribute",
    "an open comment",
    "words behind the end",
    "a wrong encoding",
)


def _allowed(name: str) -> frozenset[int]:
    return ANY if name in SOUND else NOT_DRIVEN


# --- .sumocfg ---

CONFIGURATIONS: dict[str, str] = {
    "no network": SUMOCFG.replace('<net-file value="net.net.xml"/>', ""),
    "an empty network": SUMOCFG.replace("net.net.xml", ""),
    "two networks": SUMOCFG.replace("net.net.xml", "net.net.xml,net.net.xml"),
    "a network that is missing": SUMOCFG.replace("net.net.xml", "nowhere.net.xml"),
    "a network that is a folder": SUMOCFG.replace("net.net.xml", "."),
    "a network that is a device": SUMOCFG.replace("net.net.xml", "/dev/zero"),
    "a network that is itself": SUMOCFG.replace("net.net.xml", "n.sumocfg"),
    "a network with a new line in its name": SUMOCFG.replace("net.net.xml", "a&#10;b"),
    "a network with an escape in its name": SUMOCFG.replace("net.net.xml", "&#27;[31m"),
    "a network twice": SUMOCFG.replace("<net-file", '<net-file value="nowhere"/><net-file'),
    "routes that are missing": SUMOCFG.replace("ego.rou.xml", "nowhere.rou.xml"),
    "routes that are a folder": SUMOCFG.replace("ego.rou.xml", "."),
    "routes that are a device": SUMOCFG.replace("ego.rou.xml", "/dev/zero"),
    "routes that are the network": SUMOCFG.replace("ego.rou.xml", "net.net.xml"),
    "routes that are empty words": SUMOCFG.replace("ego.rou.xml", ", ,"),
    "no routes": SUMOCFG.replace('<route-files value="ego.rou.xml"/>', ""),
    "a key of nobody": SUMOCFG.replace("<end", "<tank value='1'/><end"),
    "a key with an escape in its value": SUMOCFG.replace('"0.1"', '"&#27;[31m"'),
    "a key with a new line in its value": SUMOCFG.replace('"0.1"', '"a&#10;b"'),
    **{
        f"a step of {value!r}": SUMOCFG.replace('"0.1"', f'"{value}"')
        for value in ("", "x", "0", "-1", "nan", "inf", "1e9", "1e-9", "0.001", "99999999999",
        "0:0:1")
    },
    **{
        f"an end of {value!r}": SUMOCFG.replace('"60"', f'"{value}"')
        for value in ("x", "0", "-5", "nan", "1e300", "1e-9")
    },
    **{
        f"{key} of {value!r}": SUMOCFG.replace("<end", f'<{key} value="{value}"/><end')
        for key, value in (
            ("remote-port", "9393"), ("num-clients", "2"), ("help", "true"), ("version", "true"),
            ("save-configuration", "x"), ("save-template", "x"),
            ("configuration-file", "n.sumocfg"),
            ("begin", "x"), ("begin", "1e300"), ("begin", "-9"), ("begin", "9999"),
            ("load-state", "nowhere"), ("load-state", "net.net.xml"), ("threads", "99999"),
            ("mesosim", "true"),
            ("lateral-resolution", "0.0001"), ("lateral-resolution", "-1"), ("scale", "-1"),
            ("scale", "nan"), ("collision.action", "remove"), ("xml-validation", "always"),
            ("random", "true"),
            ("log", "/dev/full"), ("error-log", "/nowhere/x"), ("fcd-output", "/nowhere/x"),
            ("fcd-output", "/dev/full"), ("additional-files", "nowhere"),
            ("additional-files", "net.net.xml"),
            ("weight-files", "nowhere"), ("gui-settings-file", "nowhere"), ("language", "xx"),
            ("verbose", "true"), ("print-options", "true"), ("step-method.ballistic", "maybe"),
            ("default.action-step-length", "1e9"), ("time-to-teleport", "0.0001"),
            ("max-num-vehicles", "0"), ("device.rerouting.probability", "1"),
            ("python-script", "x"), ("output-prefix", "/nowhere/"),
        )
    },
}  # fmt: skip


def configuration_cases() -> Iterator[Case]:
    """Configurations that are damaged, name wrong files, or ask SUMO for something else than to
    simulate."""
    for words in (RUN, ("run", "n.sumocfg", "--json")):
        what = "driven" if words is RUN else "listed"
        for name, content in damages(SUMOCFG, "configuration"):
            yield Case(
                "sumocfg",
                f"{name}, {what}",
                words,
                {"n.sumocfg": content},
                allowed=_allowed(name),
                naming=("n.sumocfg",),
                patience_s=DRIVING_S if words is RUN else 20.0,
            )
        for name, text in CONFIGURATIONS.items():
            yield Case(
                "sumocfg",
                f"{name}, {what}",
                words,
                {"n.sumocfg": text.encode()},
                allowed=ANY,
                naming=("n.sumocfg",),
                patience_s=DRIVING_S,
            )


# --- networks ---

VALUES = ("", "x", "-1", "0", "nan", "inf", "1e300", "99999999999999999999", "&#10;", "nowhere")
CONFIGURATION = SUMOCFG.replace("net.net.xml", "net.xml").encode()
SHAPES = (
    "",
    "0,0",
    "0,0 0,0",
    "nan,nan nan,nan",
    "1e300,0 -1e300,0",
    "0,0 x,y",
    "0 0",
    "0,0,0 1,1,1",
    "inf,0 0,0",
)


def network_cases() -> Iterator[Case]:
    """A good network, damaged as any file, and with each kind of attribute and element replaced or
    removed."""
    for name, content in damages(NET, "net"):
        yield _network(f"as a file: {name}", content, _allowed(name))
    for tag, attribute in sorted(set(_attributes(NET))):
        values = SHAPES if attribute in ("shape", "convBoundary", "origBoundary") else VALUES
        yield _network(f"{tag} without {attribute}", _first(NET, tag, attribute, None), ANY)
        for value in values:
            yield _network(
                f"{tag} with {attribute} {value!r}", _first(NET, tag, attribute, value), ANY
            )
    for tag in ("location", "edge", "lane", "junction", "connection", "request"):
        yield _network(
            f"without any {tag}",
            re.sub(rf"<{tag}\b[^>]*/>|<{tag}\b.*?</{tag}>", "", NET, flags=re.DOTALL),
            ANY,
        )
        yield _network(
            f"{tag} twice",
            re.sub(
                rf"(<{tag}\b[^>]*/>|<{tag}\b.*?</{tag}>)", r"\1\1", NET, count=1, flags=re.DOTALL
            ),
            ANY,
        )


def _network(name: str, content: str | bytes, allowed: frozenset[int]) -> Case:
    data = content.encode() if isinstance(content, str) else content
    # The line may name the network or the configuration that names it.
    return Case(
        "network",
        name,
        RUN,
        {"n.sumocfg": CONFIGURATION, "net.xml": data},
        allowed=allowed,
        naming=("n",),
        patience_s=DRIVING_S,
    )


def _attributes(text: str) -> Iterator[tuple[str, str]]:
    """The kinds of elements in an XML text and the attributes that they have."""
    for element in re.finditer(r"<(\w+)((?:\s+[\w:]+=\"[^\"]*\")*)\s*/?>", text):
        for attribute in re.finditer(r"([\w:]+)=", re.sub(r"\"[^\"]*\"", "", element[2])):
            yield element[1], attribute[1]


def _first(text: str, tag: str, attribute: str, value: str | None) -> str:
    """The text with an attribute of another value, None: without it, in every element of the kind
    where that can be told apart from ids, else in the first."""
    pattern = re.compile(rf"(<{tag}\b[^>]*?)\s{attribute}=\"[^\"]*\"")

    def replacement(found: re.Match[str]) -> str:
        return found[1] if value is None else f'{found[1]} {attribute}="{value}"'

    return pattern.sub(
        replacement, text, count=0 if attribute in ("speed", "length", "width", "shape") else 1
    )


# --- routes and additional files ---

VEHICLE = '<vehicle id="ego" depart="0" departLane="1" departPos="100" departSpeed="5">'
TRIPS = {
    "no edges": ROUTES.replace("road beyond", "", 1),
    "an edge of nobody": ROUTES.replace("road beyond", "nowhere", 1),
    "an edge inside a junction": ROUTES.replace("road beyond", ":goal_0", 1),
    "edges that are not connected": ROUTES.replace("road beyond", "beyond road", 1),
    "an edge with an escape": ROUTES.replace("road beyond", "&#27;[31mred", 1),
    "an edge with a new line": ROUTES.replace("road beyond", "a&#10;b", 1),
    "an edge ten thousand times": ROUTES.replace("road beyond", "road " * 10_000, 1),
    "an id twice": ROUTES.replace('"other"', '"ego"'),
    "no id": ROUTES.replace('id="ego" ', ""),
    "an empty id": ROUTES.replace('id="ego"', 'id=""'),
    "an id with an escape": ROUTES.replace('id="other"', 'id="&#27;[31mred"'),
    "an id with a new line": ROUTES.replace('id="other"', 'id="a&#10;b"'),
    "an id with a separator of lines": ROUTES.replace('id="other"', 'id="a&#x2028;b"'),
    "an id of a formula": ROUTES.replace('id="other"', 'id="=1+1"'),
    "an id of markup": ROUTES.replace('id="other"', 'id="&lt;script>"'),
    "an id of a path": ROUTES.replace('id="other"', 'id="../../x"'),
    "a long id": ROUTES.replace('id="other"', f'id="{"x" * 100_000}"'),
    "no route": ROUTES.replace('<route edges="road beyond"/>', "", 1),
    "a type of nobody": ROUTES.replace(VEHICLE,
    VEHICLE.replace("<vehicle", '<vehicle type="tank"')),
    "a flow without end": ROUTES.replace("</routes>",
    '<flow id="f" begin="0" end="1e300" period="0.01" from="road" to="beyond"/></routes>'),
    "a flow of nothing": ROUTES.replace("</routes>",
    '<flow id="f" begin="0" end="10" period="0" from="road" to="beyond"/></routes>'),
    "a flow of infinitely many": ROUTES.replace("</routes>",
    '<flow id="f" begin="0" end="10" number="99999999999" from="road" to="beyond"/></routes>'),
    "a probability of 9": ROUTES.replace("</routes>",
    '<flow id="f" begin="0" end="10" probability="9" from="road" to="beyond"/></routes>'),
    "a person": ROUTES.replace("</routes>",
    '<person id="p" depart="0"><walk edges="road"/></person></routes>'),
    "a container": ROUTES.replace("</routes>",
    '<container id="c" depart="0"><tranship edges="road" speed="1"/></container></routes>'),
    "a person named like the ego": ROUTES.replace("</routes>",
    '<person id="ego" depart="0"><walk edges="road"/></person></routes>'),
    "an include": ROUTES.replace("</routes>", '<include href="nowhere.xml"/></routes>'),
    "an include of itself": ROUTES.replace("</routes>", '<include href="r.xml"/></routes>'),
    **{
        f"{attribute} {value!r}": ROUTES.replace(VEHICLE,
        re.sub(rf' {attribute}="[^"]*"', "", VEHICLE).replace(">", f' {attribute}="{value}">'))
        for attribute, values in {
            "depart": ("", "x", "-5", "nan", "inf", "1e300", "triggered", "split", "99999"),
            "departLane": ("", "x", "-1", "3", "99", "nan"),
            "departPos": ("x", "nan", "1e9", "-1e9", "inf"),
            "departSpeed": ("x", "-1", "nan", "1e9", "inf"),
            "arrivalPos": ("x", "nan", "-1e9", "1e9"), "arrivalLane": ("9", "x"),
            "arrivalSpeed": ("x", "-1", "nan"), "color": ("x", "nan,nan,nan", ""),
            "insertionChecks": ("none", "x"), "departEdge": ("9", "x"), "line": ("x",),
            "speedFactor": ("0", "-1", "nan", "1e9"), "via": ("nowhere",), "reroute": ("x",),
            "personNumber": ("9999999",),
        }.items()
        for value in values
    },
}  # fmt: skip

TYPE_ATTRIBUTES: dict[str, tuple[str, ...]] = {
    "length": ("0", "-1", "nan", "inf", "1e9", "x", "1e-9"),
    "width": ("0", "-1", "nan", "inf", "1e9"), "minGap": ("-9", "nan", "1e9"),
    "accel": ("0", "-1", "nan", "inf", "1e9"), "decel": ("0", "-1", "nan", "1e9"),
    "emergencyDecel": ("0", "-1", "nan", "inf", "1e9"), "apparentDecel": ("0", "nan", "-1"),
    "maxSpeed": ("0", "-1", "nan", "inf", "1e9", "1e-9"),
    "speedFactor": ("0", "-1", "nan", "norm(1,9)", "1e9", "x"), "sigma": ("-1", "nan", "9"),
    "tau": ("0", "-1", "nan", "1e9"), "actionStepLength": ("0", "-1", "nan", "1e9", "0.05"),
    "vClass": ("tank", "", "pedestrian", "rail", "bicycle", "ship", "ignoring"),
    "carFollowModel": ("x", "IDM", "Rail", "EIDM", "CACC"),
    "laneChangeModel": ("x", "SL2015", "DK2008"), "guiShape": ("x",),
    "latAlignment": ("x", "nan", "1e9"), "maxSpeedLat": ("0", "-1", "nan", "1e9"),
    "startupDelay": ("-1", "nan", "1e9"), "speedDev": ("-1", "nan", "9"),
    "impatience": ("x", "9", "nan"), "boardingDuration": ("x",), "mass": ("nan", "-1"),
    "emissionClass": ("x",), "jmIgnoreFoeProb": ("9", "nan"), "lcStrategic": ("nan", "-9"),
}  # fmt: skip

ADDITIONAL = {
    "a stop on no lane": '<busStop id="b" lane="nowhere_0"/>',
    "a stop backwards": '<busStop id="b" lane="road_0" startPos="90" endPos="10"/>',
    "a detector without a file": '<inductionLoop id="d" lane="road_0" pos="10" period="10"/>',
    "a detector that writes nowhere": '<inductionLoop id="d" lane="road_0" pos="10" period="10" '
                                      'file="/nowhere/x.xml"/>',
    "a detector that writes on a full disk": '<inductionLoop id="d" lane="road_0" pos="10" '
                                             'period="1" file="/dev/full"/>',
    "a speed sign of nan": '<variableSpeedSign id="v" lanes="road_0 road_1"><step time="0" '
                           'speed="nan"/></variableSpeedSign>',
    "a speed sign of -1": '<variableSpeedSign id="v" lanes="road_0 road_1 road_2"><step time="0" '
                          'speed="-1"/></variableSpeedSign>',
    "a speed sign of 0": '<variableSpeedSign id="v" lanes="road_0 road_1 road_2"><step time="0" '
                         'speed="0"/></variableSpeedSign>',
    "a rerouter that closes the road": '<rerouter id="r" edges="road"><interval begin="0" '
                                       'end="99"><closingReroute '
                                       'id="beyond"/></interval></rerouter>',
    "a rerouter to nowhere": '<rerouter id="r" edges="nowhere"><interval begin="0" '
                             'end="99"><destProbReroute id="x"/></interval></rerouter>',
    "a signal of nobody": '<tlLogic id="t" type="static" programID="1" offset="0"><phase '
                          'duration="0" state=""/></tlLogic>',
    "a polygon without a shape": '<poly id="p" shape="" color="x"/>',
    "a calibrator of nan": '<calibrator id="c" lane="road_0" pos="nan" period="1"><flow begin="0" '
                           'end="9" vehsPerHour="nan"/></calibrator>',
    "an unknown element": "<tank/>",
}  # fmt: skip


def traffic_cases() -> Iterator[Case]:
    """Route files, vehicle types and additional files."""
    for name, content in damages(ROUTES, "routes"):
        yield _traffic(f"routes as a file: {name}", {"r.xml": content}, _allowed(name))
        if name in (
            "zipped, cut off",
            "zipped, the head only",
            "nothing",
            "cut off at 60 %",
            "zero bytes",
        ):
            files = {
                "n.sumocfg": SUMOCFG.replace("ego.rou.xml", "r.xml.gz").encode(),
                "r.xml.gz": content,
            }
            yield Case(
                "traffic",
                f"routes as an archive: {name}",
                RUN,
                files,
                allowed=NOT_DRIVEN,
                naming=("n.sumocfg",),
                patience_s=DRIVING_S,
            )
    for name, text in TRIPS.items():
        yield _traffic(name, {"r.xml": text.encode()}, ANY)
    for attribute, values in TYPE_ATTRIBUTES.items():
        for value in values:
            text = ROUTES.replace(
                "<routes>", f'<routes><vType id="t" {attribute}="{value}"/>'
            ).replace('id="ego"', 'id="ego" type="t"')
            yield _traffic(f"a type with {attribute} {value!r}", {"r.xml": text.encode()}, ANY)
    for name, element in ADDITIONAL.items():
        files = {
            "n.sumocfg": SUMOCFG.replace("<end", '<additional-files value="a.xml"/><end').encode(),
            "a.xml": f"<additional>{element}</additional>".encode(),
        }
        yield Case(
            "traffic",
            f"additional: {name}",
            RUN,
            files,
            allowed=ANY,
            naming=("n.sumocfg",),
            patience_s=DRIVING_S,
        )
    for name, content in damages("<additional/>", "additional"):
        files = {
            "n.sumocfg": SUMOCFG.replace("<end", '<additional-files value="a.xml"/><end').encode(),
            "a.xml": content,
        }
        yield Case(
            "traffic",
            f"additional as a file: {name}",
            RUN,
            files,
            allowed=ANY,
            naming=("n.sumocfg",),
            patience_s=DRIVING_S,
        )


def _traffic(name: str, files: dict[str, bytes], allowed: frozenset[int]) -> Case:
    configuration = {"n.sumocfg": SUMOCFG.replace("ego.rou.xml", "r.xml").encode()}
    return Case(
        "traffic",
        name,
        RUN,
        {**configuration, **files},
        allowed=allowed,
        naming=("n.sumocfg",),
        patience_s=DRIVING_S,
    )
