"""Wrong scenario files: what is no YAML, and what is no scenario."""

import base64
import itertools
from collections.abc import Iterator
from typing import Any

from ..case import ANY, ONLY_REFUSED, Case, scenario_case
from ..good import SCENARIO, dumped, with_key

GOOD = dumped(SCENARIO)
DEEP = 100_000


def bomb(levels: int = 9, width: int = 10) -> str:
    """A flow mapping of aliases: `width` to the power of `levels` texts."""
    names = "abcdefghijklmnop"[:levels]
    first = f"a: &a [{', '.join(['x'] * width)}]"
    return (
        "{"
        + ", ".join(
            [
                first,
                *(
                    f"{b}: &{b} [{', '.join([f'*{a}'] * width)}]"
                    for a, b in itertools.pairwise(names)
                ),
            ]
        )
        + "}"
    )


def ending(text: str) -> str:
    """The good scenario and one more line."""
    return f"{GOOD}{text}\n"


# --- YAML ---

NOT_YAML: dict[str, str | bytes] = {
    "nothing": "",
    "spaces": "   \n\n",
    "a comment": "# nothing\n",
    "null": "null\n",
    "a number": "42\n",
    "a text": "scenario\n",
    "true": "true\n",
    "a list": "- name: good\n",
    "a set": "!!set {a, b}\n",
    "two documents": f"{GOOD}---\n{GOOD}",
    "a tab": "name: good\nsumo:\n\tnet: net.net.xml\n",
    "an open bracket": ending("egos: [{id: ego"),
    "an open quote": ending('description: "to the end'),
    "a bad escape": ending('description: "\\q"'),
    "an alias to nothing": ending("description: *nowhere"),
    "a list that holds itself": ending("planner: &p {options: {a: [*p]}}"),
    "a merge of a number": ending("traffic: {<<: 3}"),
    "a merge of itself": ending("cost: &c {<<: *c}"),
    "a tag that runs code": ending("description: !!python/object/apply:os.system [id]"),
    "a tag that names code": ending("description: !!python/name:os.system"),
    "a tag of nobody": ending("description: !tank x"),
    "a tag of a number on a text": ending("description: !!float fast"),
    "a tag of a whole number on a text": ending("description: !!int ''"),
    "a tag of a truth on a text": ending("description: !!bool maybe"),
    "a tag of a time on a text": ending("description: !!timestamp soon"),
    "a tag of a mapping on a text": ending("cost: !!map x"),
    "a tag of pairs on a text": ending("cost: !!omap x"),
    "an impossible day": ending("description: 2001-99-99"),
    "an impossible hour": ending("description: 2001-01-01 99:99:99"),
    "an impossible zone": ending("description: 2001-01-01 00:00:00 +99:99"),
    "a day as a key": ending("2001-99-99: x"),
    "a day as the name": "name: 2001-01-01\n",
    "deep lists": ending("description: " + "[" * DEEP + "]" * DEEP),
    "deep lists, a thousand": ending("description: " + "[" * 1000 + "]" * 1000),
    "deep lists, open": "[" * DEEP,
    "deep mappings": ending("cost: " + "{a: " * DEEP + "1" + "}" * DEEP),
    "deep blocks": "".join(f"{' ' * k}a:\n" for k in range(1500)),
    "deep sequences": "- " * DEEP + "x\n",
    "deep in options": GOOD.replace("name: constant",
    f"name: constant\n  options: {{a: {'[' * 600 + ']' * 600}}}"),
    "a bomb of aliases in options": GOOD.replace("name: constant",
    f"name: constant\n  options: {bomb()}"),
    "a bomb of aliases as a text": ending(f"description: {bomb()}"),
    "a bomb of aliases under an unknown key": ending(f"bomb: {bomb()}"),
    "a bomb of merges": ending("a: &a {x: 1}\n" + "\n".join(f"b{k}: &b{k} {{<<: "
                                                            f"[{', '.join(['*a' if k == 0 else f'*b{k - 1}'] * 10)}]}}" for k in range(9))),
    "a long text": ending(f"description: {'x' * 5_000_000}"),
    "a long list": ending(f"egos: [{', '.join(['{id: a}'] * 100_000)}]"),
    "many keys": ending("\n".join(f"k{k}: 1" for k in range(200_000))),
    "many anchors": ending("\n".join(f"k{k}: &a{k} 1" for k in range(50_000))),
    "a key twice": ending("name: other"),
    "a section twice": ending("planner: {name: idm}"),
    "a key twice inside": GOOD.replace("time_limit_s: 3", "time_limit_s: 3\n  time_limit_s: 4"),
    "a key twice in braces": ending("cost: {jerk: 1, jerk: 2}"),
    "a key twice, once in quotes": ending('"name": other'),
    "a key twice in an actor": GOOD.replace("vtype: ego", "vtype: ego\n    vtype: car"),
    "UTF-32": GOOD.encode("utf-32"),
    "UTF-16 without a mark": GOOD.encode("utf-16-le"),
    "Latin-1": ending("description: Straße").encode("latin-1"),
    "zero bytes": b"\0" * 100,
    "a zero byte": ending("description: x").encode().replace(b"x\n", b"x\0\n"),
    "a control character": ending("description: \x1b[31mred"),
    "a bell in a key": ending('"a\\ab": 1'),
    "an escape in a key": ending('"\\e[31mred": 1'),
    "a new line in a key": ending('"a\\nb": 1'),
    "a separator of lines in a key": ending('"a\\u2028b": 1'),
    "random bytes": bytes(range(256)) * 40,
    "a picture": base64.b64decode("R0lGODlhAQABAIAAAAAAAP///yH5BAEAAAAALAAAAAABAAEAAAIBRAA7"),
    "XML": "<configuration/>",
    "JSON cut off": '{"name": "good", "sumo": {',
    "a list as a key": ending("? [a, b]\n: 1"),
    "a mapping as a key": ending("? {a: b}\n: 1"),
    "null as a key": ending("null: 1"),
    "true as a key": ending("true: 1"),
    "a number as a key": ending("3: 1"),
    "not a number as a key": ending(".nan: 1"),
    "a number of a million digits as a number": ending("cost: {jerk: " + "9" * 1_000_000 + "}"),
    "an octal number without digits": ending("cost: {jerk: 0o9}"),
}  # fmt: skip

# May be read as what they most likely mean.
ODD_YAML: dict[str, str | bytes] = {
    "a mark at the beginning": b"\xef\xbb\xbf" + GOOD.encode(),
    "lines of Windows": GOOD.replace("\n", "\r\n"),
    "a surrogate pair": ending('description: "\\ud83d\\ude97"'),
    "an escape in a text": ending('description: "\\e[31mred"'),
    "a document end": GOOD + "...\n",
    "aliases": ending("cost: {jerk: &j 1, headway: *j}"),
    "UTF-16": GOOD.encode("utf-16"),
    "a mapping that holds itself": ending("description: &d {d: *d}"),
    "a tag of binary on a text": ending("description: !!binary é"),
    "a long file of comments": "# nothing\n" * 500_000 + GOOD,
    "half a surrogate": ending('description: "\\ud800"'),
    "a number of a million digits": ending("description: " + "9" * 1_000_000),
    "a number in base 60 of many parts": ending("description: " + ":".join(["59"] * 20_000)),
    "a directive of nobody": "%TANK 1\n---\n" + GOOD,
    "another version": "%YAML 9.9\n---\n" + GOOD,
    "the value key": ending("description: ="),
    "a description of a kilobyte": ending(f"description: {'x' * 1000}"),
}


def yaml_cases() -> Iterator[Case]:
    """Files that are no YAML, or more YAML than a scenario needs."""
    for name, text in NOT_YAML.items():
        yield scenario_case("yaml", name, text)
    for name, text in ODD_YAML.items():
        yield scenario_case("yaml", name, text, ANY)


# --- keys ---

WRONG_KEYS: list[tuple[str, Any]] = [
    ("name", None), ("name", ""), ("name", "../up"), ("name", "a/b"), ("name", "a b"),
    ("name", "ä"), ("name", "-a"), ("name", "a\n"), ("name", "x" * 5000),
    ("name", ["good"]), ("name", {"a": 1}), ("description", ["x"]), ("description", {"x": 1}),
    ("sumo", None), ("sumo", []), ("sumo", "net.net.xml"), ("sumo", {}),
    ("sumo.net", ""), ("sumo.net", ["net.net.xml"]), ("sumo.net", "."), ("sumo.net", "/dev/null"),
    ("sumo.net", "nowhere"), ("sumo.net", "a\0b"),
    ("sumo.net", "x" * 5000), ("sumo.net", "a\nb"), ("sumo.net", "types.rou.xml"),
    ("sumo.net", "good.yaml"), ("sumo.net", True), ("sumo.net", 3),
    ("sumo.sumocfg", "good.sumocfg"), ("sumo.sumocfg", 3), ("sumo.routes", "types.rou.xml"),
    ("sumo.routes", [None]), ("sumo.routes", [[]]), ("sumo.routes", [{}]),
    ("sumo.routes", ["."]), ("sumo.routes", [""]), ("sumo.routes", ["a,b"]),
    ("sumo.routes", ["net.net.xml"]), ("sumo.routes", ["a\nb.xml"]),
    ("sumo.routes", ["good.yaml"]),
    ("sumo.additional", "x"), ("sumo.additional", ["nowhere"]), ("sumo.additional", [3]),
    ("sumo.additional", ["good.yaml"]), ("sumo.options", []), ("sumo.options", {"": 1}),
    ("sumo.options", {"a b": 1}), ("sumo.options", {"--step-length": 1}),
    ("sumo.options", {"help": True}), ("sumo.options", {"version": True}),
    ("sumo.options", {"save-configuration": "x.sumocfg"}),
    ("sumo.options", {"save-template": "x"}), ("sumo.options", {"save-schema": "x"}),
    ("sumo.options", {"remote-port": 9393}), ("sumo.options", {"num-clients": 2}),
    ("sumo.options", {"configuration-file": "good.sumocfg"}),
    ("sumo.options", {"net-file": "net.net.xml"}), ("sumo.options", {"collision.action": "none"}),
    ("sumo.options", {"a\nb": 1}), ("sumo.options", {"seed": None}),
    ("sumo.options", {"seed": [1]}), ("sumo.options", {"mesosim": True}), ("sumo.options", {1: 1}),
    ("egos", None), ("egos", []), ("egos", {}), ("egos", "ego"), ("egos", ["ego"]), ("egos", [{}]),
    ("egos", [{"id": None}]), ("egos", [{"id": 3}]), ("egos", [{"id": ""}]),
    ("egos", [{"id": "nobody"}]), ("egos", [{"id": "a\nb"}]), ("egos", [{"id": "\x1b[2J"}]),
    ("egos", [{"id": "ego"}, {"id": "ego"}]), ("egos", [{"id": "ego", "until": "nowhere"}]),
    ("egos", [{"id": "ego", "until": ""}]), ("egos", [{"id": "ego", "until": ["road"]}]),
    ("egos", [{"id": "ego", "extra": 1}]), ("egos", [{"id": "e" * 100_000}]),
    ("traffic", None), ("traffic", []), ("traffic.actors", None), ("traffic.actors", {}),
    ("traffic.actors", ["ego"]), ("traffic.actors", [{}]), ("traffic.actors", [None]),
    ("traffic.actors.0.id", ""), ("traffic.actors.0.id", 3), ("traffic.actors.0.id", "other"),
    ("traffic.actors.1.id", "a b"), ("traffic.actors.1.id", '"<>&'),
    ("traffic.actors.0.route", []), ("traffic.actors.0.route", "road"),
    ("traffic.actors.0.route", ["nowhere"]), ("traffic.actors.0.route", ["beyond", "road"]),
    ("traffic.actors.0.route", [None]), ("traffic.actors.0.route", [""]),
    ("traffic.actors.0.route", ["road beyond"]), ("traffic.actors.0.route", [":goal_0"]),
    ("traffic.actors.0.route", ["road"] * 50_000), ("traffic.actors.0.vtype", "tank"),
    ("traffic.actors.0.vtype", ""), ("traffic.actors.0.vtype", None),
    ("traffic.actors.0.vtype", '"/><x'), ("traffic.actors.0.driver", "me"),
    ("traffic.actors.0.depart", None), ("traffic.actors.0.depart", 3),
    ("traffic.actors.0.depart.lane", 3),
    ("traffic.actors.0.events", [{"at_s": 1}]),
    ("traffic.actors.0.events", [{"at_s": 1, "at_m": 1, "stop_for_s": 1}]),
    ("traffic.actors.0.events", [{"change_lane": "left"}]),
    ("traffic.actors.0.events", [{"at_s": 1, "change_lane": "up"}]),
    ("traffic.actors.0.events", [{"at_s": 1, "stop_for_s": 1, "slow_to_mps": 1}]),
    ("traffic.events", [{"vehicle": "nobody", "at_s": 1, "stop_for_s": 1}]),
    ("traffic.events", [{"at_s": 1, "stop_for_s": 1}]),
    ("traffic.events", [{"vehicle": "", "at_s": 1, "stop_for_s": 1}]),
    ("traffic.crowd", []), ("traffic.crowd.count", 5), ("traffic.crowd.count", [5]),
    ("traffic.crowd.count", [5, 1]), ("traffic.crowd.count", [1, 2, 3]),
    ("traffic.crowd", {"count": [1, 2], "streams": [{"route": ["nowhere"]}]}),
    ("traffic.crowd", {"count": [1, 2], "streams": [{"route": []}]}),
    ("traffic.crowd", {"count": [1, 2], "streams": [{"route": ["road"], "lanes": []}]}),
    ("traffic.crowd", {"count": [1, 2], "streams": [{"route": ["road"], "lanes": [9]}]}),
    ("traffic.drivers", "aggressive"), ("traffic.drivers.kind", 1),
    ("episode.success_edge", "nowhere"), ("episode.success_edge", 3),
    ("episode.success_edge", "a\nb"),
    ("sensor.signals", "all"), ("sensor.occlusion", "maybe"), ("prediction.name", "oracle"),
    ("prediction.name", ""), ("prediction.name", None), ("prediction.name", "os:system"),
    ("planner.name", "alphazero"), ("planner.name", "os:system"), ("planner.name", "a" * 10_000),
    ("planner.name", ["mcts"]), ("planner.name", "os.path:join\n"),
    ("planner.options", []), ("planner.options", {"a": 1}), ("planner.adaptive", "maybe"),
    ("planner.adaptive", 3), ("planner.risk", "averse"), ("planner.accelerations_mps2", []),
    ("planner.accelerations_mps2", "fast"), ("planner.accelerations_mps2", [0.0] * 100_000),
    ("planner.accelerations_mps2", {"a": 1}), ("cost.term", "os:system"), ("cost.term", ""),
    ("failsafe.on", "on fire"), ("base", 3), ("base", []), ("base", {}), ("base", "."),
    ("base", ""), ("base", "s.yaml"), ("base", "/dev/zero"), ("base", "/dev/null"),
    ("base", "nowhere.yaml"), ("base", "a\nb"), ("base", "a\0b"), ("base", "net.net.xml"),
    ("base", "x" * 5000), ("planer", {}), ("planner.iteration", 3), ("__class__", 1),
    ("model_config", {}),
]  # fmt: skip

# What may be taken as it stands: it is unusual, but names nothing wrong.
TAKEN: list[tuple[str, Any]] = [
    ("name", "x" * 5000), ("traffic.actors.1.id", "a b"), ("traffic.actors.1.id", '"<>&'),
    ("planner.options", {"a": 1}), ("sumo.options", {"mesosim": True}),
]  # fmt: skip


def key_cases() -> Iterator[Case]:
    """YAML that is no scenario: each key with what it must not hold; and no scenario at all."""
    for number, (key, value) in enumerate(WRONG_KEYS):
        text = dumped(with_key(SCENARIO, key, value))
        yield scenario_case(
            "scenario",
            f"{number} {key}: {value!r:.50}",
            text,
            ANY if (key, value) in TAKEN else ONLY_REFUSED,
        )
    for section in ("name", "sumo", "egos"):
        yield scenario_case(
            "scenario",
            f"without {section}",
            dumped({key: value for key, value in SCENARIO.items() if key != section}),
        )
    yield from _bases()


def _bases() -> Iterator[Case]:
    long = {f"b{k}.yaml": f"base: b{k + 1}.yaml\n".encode() for k in range(2000)}
    yield Case(
        "scenario",
        "a chain of two thousand bases",
        ("run", "b0.yaml", "--json"),
        {**long, "b2000.yaml": GOOD.encode()},
        allowed=ANY,
        naming=("yaml",),
    )
    circle = {
        "b0.yaml": b"base: b1.yaml\n",
        "b1.yaml": b"base: b2.yaml\n",
        "b2.yaml": b"base: b0.yaml\n",
    }
    yield Case(
        "scenario",
        "a circle of three bases",
        ("run", "b0.yaml", "--json"),
        circle,
        naming=("yaml",),
    )
    for number, text in enumerate(("[1]", "name: [", "sumo: 3", "egos: 3", "", "\0")):
        files = {"s.yaml": b"base: b.yaml\nname: x\n", "b.yaml": text.encode()}
        yield Case(
            "scenario",
            f"a base that is wrong, {number}",
            ("run", "s.yaml", "--json"),
            files,
            naming=("yaml",),
        )
