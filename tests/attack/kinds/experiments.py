"""Wrong experiment files."""

from collections.abc import Iterator
from typing import Any

from ..case import ANY, DRIVING_S, ONLY_REFUSED, Case
from ..good import EXPERIMENT, dumped, with_key
from .scenarios import DEEP, bomb

GOOD = dumped({**EXPERIMENT, "variants": {"constant": {}}})
HUGE = 10**11

WRONG_TEXTS: dict[str, str | bytes] = {
    "nothing": "",
    "a list": "[1]\n",
    "a number": "3\n",
    "an open bracket": "name: [\n",
    "two documents": f"{GOOD}---\n{GOOD}",
    "an impossible day": f"{GOOD}description: 2001-99-99\n",
    "an impossible number": f"{GOOD}description: !!int x\n",
    "a tag that runs code": f"{GOOD}description: !!python/object/apply:os.system [id]\n",
    "a tag of nobody": f"{GOOD}description: !tank x\n",
    "deep lists": f"{GOOD}description: {'[' * DEEP}{']' * DEEP}\n",
    "deep lists, a thousand": f"{GOOD}description: {'[' * 1000}{']' * 1000}\n",
    "deep blocks": "".join(f"{' ' * k}a:\n" for k in range(1500)),
    "a bomb of aliases in set": f"{GOOD}set: {{planner.options: {bomb()}}}\n",
    "a bomb of aliases under an unknown key": f"{GOOD}bomb: {bomb()}\n",
    "a list that holds itself": f"{GOOD}sweep: &s {{planner.name: [*s]}}\n",
    "a variant that holds itself": f"{GOOD}set: &s {{planner.options: *s}}\n",
    "a key twice": f"{GOOD}name: other\n",
    "a variant twice": GOOD.replace("constant: {}", "constant: {}\n  constant: {}"),
    "a list as a key": f"{GOOD}? [a]\n: 1\n",
    "a long list of seeds": f"{GOOD.replace('seeds: 0..1', '')}seeds: "
    f"[{', '.join(['1'] * 300_000)}]\n",
    "a long text": f"{GOOD}description: {'x' * 5_000_000}\n",
    "UTF-16": GOOD.encode("utf-16"),
    "Latin-1": f"{GOOD}description: Straße\n".encode("latin-1"),
    "zero bytes": b"\0" * 100,
    "a new line in a key": f'{GOOD}"a\\nb": 1\n',
    "an escape in a key": f'{GOOD}"\\e[31mred": 1\n',
}
TAKEN_TEXTS = ("a long list of seeds", "UTF-16", "a long text")

_WEIGHTS = ("jerk", "headway", "claim", "braking", "imposed", "progress", "route", "red")
EGOS: tuple[Any, ...] = (
    [], ["nobody"], ["ego", "ego"], [""], [3], "ego", ["a\nb"], ["\x1b[2J"], {}, {"random": 0},
    {"random": -1},
    {"random": HUGE}, {"random": 1.5}, {"random": True}, {"random": 2, "seed": -1},
    {"random": 2, "ids": ["ego"]}, {"random": 2, "seed": HUGE**9},
)  # fmt: skip
WRONG_KEYS: dict[str, tuple[Any, ...]] = {
    "name": (None, "", "a/b", "a\n", 3, [], ".."),
    "description": ([], 3),
    "scenarios": (
        None, [], {}, "good.yaml", [None], [3], [[]], [{}], ["nowhere.yaml"], ["nowhere"], [""],
        ["."], ["exp.yaml"],
        ["net.net.xml"], ["a\nb"], ["/dev/null"], ["x" * 5000], ["good.sumocfg"],
        ["good.yaml", "good.yaml"],
        [{"scenario": "good.yaml", "until": "beyond"}],
        [{"scenario": "good.yaml", "egos": ["ego"]}],
        [{"scenario": "good.yaml", "sumocfg": "good.sumocfg"}],
        [{"sumocfg": "nowhere.sumocfg", "egos": ["ego"]}],
        [{"sumocfg": "net.net.xml", "egos": ["ego"]}],
        [{"sumocfg": "${TANK}/x.sumocfg", "egos": ["ego"]}],
        [{"sumocfg": "${SUMO_HOME}/nowhere.sumocfg", "egos": ["ego"]}],
        [{"sumocfg": "good.sumocfg", "egos": ["ego"], "until": "nowhere"}],
        *([{"sumocfg": "good.sumocfg", "egos": egos}] for egos in EGOS),
    ),
    "seeds": (
        -1, 1.5, True, [], {}, "", "a..b", "5..1", "0..", "..5", "0..1..2", [-1], [None],
        ["0..1", "x"], [True],
        f"0..{HUGE}", [f"0..{HUGE}"], "0..99999999", "0..2147483648", "0.." + "9" * 30, "9" * 5000,
        10**400, [10**30],
        "４..５", " 0 .. 1 ", "0x1..0x3", "1e3", float("nan"), float("inf"),
    ),
    "variants": (
        None, {}, [], "mcts", {"a": None}, {"a": []}, {"a": 3}, {"": {}}, {"a/b": {}},
        {"a\nb": {}}, {"../a": {}},
        {"\x1b[31m": {}}, {"x" * 5000: {}}, {3: {}}, {None: {}}, {True: {}}, {"sumo": {}},
        {"a": {"": 1}}, {"a": {3: 1}},
        {"a": {".": 1}}, {"a": {"planner": 1}}, {"a": {"planner..name": 1}},
        {"a": {"planner.name.x": 1}},
        {"a": {"planer.name": "mcts"}}, {"a": {"planner.name": "tank"}}, {"a": {"name": "b"}},
        {"a": {"egos": []}},
        {"a": {"cost.jerk": float("nan")}}, {"a": {"cost.jerk": -1}},
        {"a": {"sumo.net": "nowhere"}},
    ),
    "sweep": (
        [], "x", {"": [1]}, {3: [1]}, {"planer.x": [1]}, {"planner.iterations": []},
        {"planner.iterations": 3},
        {"planner.iterations": [0]}, {"planner.iterations": [None, {}]},
        {"planner.iterations": [10, 10]},
        {"planner.iterations": list(range(1, 100_000))},
        {f"cost.{name}": list(range(30)) for name in _WEIGHTS},
        {"cost.jerk": [float("nan")]}, {"cost.jerk": ["a\nb"]},
    ),
    "twins": ("maybe", 2, []),
    "traces": ("some", True, []),
    "set": (
        [], {"": 1}, {"a\nb": 1}, {"planer.x": 1}, {"name": "b"}, {"egos": [{"id": "nobody"}]},
        {"planner.iterations": "many"},
    ),
    "planer": (1,),
    "base": ("good.yaml",),
}  # fmt: skip

# One episode or a few: may be taken, or mean what a strict reader refuses.
TAKEN_KEYS: list[tuple[str, Any]] = [
    ("variants", {"x" * 5000: {}}), ("variants", {"a/b": {}}), ("variants", {"../a": {}}),
    ("variants", {"a\nb": {}}), ("variants", {"": {}}), ("variants", {"\x1b[31m": {}}),
    ("seeds", "４..５"), ("seeds", " 0 .. 1 "),
    ("seeds", [10**30]), ("seeds", 10**400), ("seeds", "9" * 5000), ("variants", {"sumo": {}}),
    ("sweep", {"planner.iterations": [10, 10]}), ("set", {"name": "b"}),
    ("scenarios", [{"sumocfg": "good.sumocfg", "egos": {"random": 2, "seed": HUGE**9}}]),
    ("scenarios", [{"sumocfg": "good.sumocfg", "egos": {"random": HUGE}}]), ("seeds", -1),
    ("variants", {"a": None}),
]  # fmt: skip


def cases() -> Iterator[Case]:
    """Files that are no experiment, or ask for more episodes than there may be."""
    for name, text in WRONG_TEXTS.items():
        yield _case(
            name,
            text if isinstance(text, bytes) else text.encode(),
            ANY if name in TAKEN_TEXTS else ONLY_REFUSED,
        )
    pairs = [(key, value) for key, values in WRONG_KEYS.items() for value in values]
    for number, (key, value) in enumerate(pairs):
        text = dumped(with_key({**EXPERIMENT, "variants": {"constant": {}}}, key, value))
        yield _case(
            f"{number} {key}: {value!r:.50}",
            text.encode(),
            ANY if (key, value) in TAKEN_KEYS else ONLY_REFUSED,
        )
    for part in (
        "0/2",
        "3/2",
        "1/0",
        "-1/2",
        "1",
        "a/b",
        "1/2/3",
        "",
        "1/99999999999999999999",
        "９/９",
        "1.5/2",
        "1/-2",
        "٣/٤",
    ):
        allowed = ANY if part in ("1/99999999999999999999", "９/９", "٣/٤") else ONLY_REFUSED
        yield Case(
            "experiment",
            f"shard {part}",
            ("batch", "exp.yaml", "--out", "out", "--shard", part, "--quiet"),
            allowed=allowed,
            patience_s=DRIVING_S,
        )
    for name in ("a bomb of aliases in set", "an impossible day"):
        files = {"x.yaml": str(WRONG_TEXTS[name]).encode()}
        yield Case(
            "experiment",
            f"{name}, listed",
            ("batch", "x.yaml", "--dry-run"),
            files,
            naming=("x.yaml",),
        )


def _case(name: str, content: bytes, allowed: frozenset[int]) -> Case:
    words = ("batch", "x.yaml", "--out", "out", "--jobs", "1", "--quiet")
    return Case(
        "experiment",
        name,
        words,
        {"x.yaml": content},
        allowed=allowed,
        naming=("x.yaml",),
        patience_s=DRIVING_S if 0 in allowed else 20.0,
    )
