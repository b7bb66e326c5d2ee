"""Files that are no files, files that may not be read, and odd names of files."""

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from ..case import ANY, DRIVING_S, NOT_DRIVEN, Case
from ..good import BATCH, OUT, ROUTES, RUN, SCENARIO, SUMOCFG, dumped, with_key

Prepare = Callable[[Path], None]


def _remove(path: Path) -> None:
    if path.exists() or path.is_symlink():
        path.unlink()


def pipe(name: str) -> Prepare:
    """Puts a pipe that nothing writes into in place of a file."""

    def prepare(folder: Path) -> None:
        _remove(folder / name)
        os.mkfifo(folder / name)

    return prepare


def link(name: str, target: str) -> Prepare:
    """Puts a link in place of a file."""

    def prepare(folder: Path) -> None:
        _remove(folder / name)
        (folder / name).symlink_to(target)

    return prepare


def directory(name: str) -> Prepare:
    """Puts a folder in place of a file."""

    def prepare(folder: Path) -> None:
        _remove(folder / name)
        (folder / name).mkdir()

    return prepare


def closed(name: str, mode: int = 0) -> Prepare:
    """Takes the right to read or write away from a file or folder."""
    return lambda folder: (folder / name).chmod(mode)


REPLACED: dict[str, Callable[[str], Prepare]] = {
    "a pipe": pipe,
    "a folder": directory,
    "a link to itself": lambda name: link(name, name),
    "a link to nowhere": lambda name: link(name, "nowhere"),
    "/dev/zero": lambda name: link(name, "/dev/zero"),
    "/dev/full": lambda name: link(name, "/dev/full"),
    "/dev/null": lambda name: link(name, "/dev/null"),
    "/dev/urandom": lambda name: link(name, "/dev/urandom"),
    "/proc/self/mem": lambda name: link(name, "/proc/self/mem"),
    "no right to read": closed,
}
NAMES = (
    "a\nb", "\x1b[31mred", "a\u202eb", "a\u2028b", "\x7f", "a b", "ä🚗", "x" * 240, "-x", "--help",
    "a%sb", "{0}", "$(id)",
    "a\\b", "a;b", "a&b", "a<b", "a:b", "a=b", "a,b", "*", "~", "#x", "'", '"',
)  # fmt: skip
# Root reads everything unless it gives that up.
_AS_OWNER = (
    ("setpriv", "--bounding-set=-dac_override,-dac_read_search", "--inh-caps=-all", "--")
    if os.geteuid() == 0
    else ()
)
_CAN_CLOSE = not _AS_OWNER or shutil.which("setpriv") is not None


def cases() -> Iterator[Case]:
    """Files that are no files, and files with odd names."""
    sumo = (
        "run",
        "good.sumocfg",
        "--ego",
        "ego",
        "--planner",
        "constant",
        "--time-limit",
        "3",
        "--json",
    )
    based = {"s.yaml": b"base: good.yaml\n"}
    read = {
        "scenario": ("good.yaml", RUN),
        "validated scenario": ("good.yaml", ("validate", "good.yaml")),
        "base": ("good.yaml", ("run", "s.yaml", "--json")), "network": ("net.net.xml", RUN),
        "types": ("types.rou.xml", RUN), "configuration": ("good.sumocfg", sumo),
        "listed configuration": ("good.sumocfg", ("run", "good.sumocfg", "--json")),
        "network of a configuration": ("net.net.xml", sumo),
        "routes of a configuration": ("ego.rou.xml", sumo), "experiment": ("one.yaml", BATCH),
        "scenario of an experiment": ("good.yaml", BATCH),
    }  # fmt: skip
    for what, (name, words) in read.items():
        for by, prepare in REPLACED.items():
            if prepare is closed and not _CAN_CLOSE:
                continue
            prefix = _AS_OWNER if prepare is closed else ()
            empty = by == "/dev/null" and what == "types"
            yield Case(
                "special-file",
                f"{what} is {by}",
                words,
                based,
                prepare=prepare(name),
                prefix=prefix,
                allowed=NOT_DRIVEN if not empty else ANY,
                patience_s=DRIVING_S,
            )
    yield from _odd_names()
    yield from _outputs()


def _odd_names() -> Iterator[Case]:
    scenario = dumped(SCENARIO)
    for name in NAMES:
        yield Case(
            "special-file",
            f"scenario named {name!r:.30}",
            ("run", "--json", "--", f"{name}.yaml"),
            {f"{name}.yaml": scenario.encode()},
            allowed=ANY,
            patience_s=DRIVING_S,
        )
        yield Case(
            "special-file",
            f"scenario named {name!r:.30}, wrong",
            ("run", "--json", f"./{name}.yaml"),
            {f"{name}.yaml": b"name: x\n"},
        )
        yield Case(
            "special-file", f"scenario missing, {name!r:.30}", ("run", "--json", f"./{name}.yaml")
        )
        named = with_key(SCENARIO, "sumo.routes", [f"{name}.xml"])
        files = {"s.yaml": dumped(named).encode(), f"{name}.xml": ROUTES.encode()}
        yield Case(
            "special-file",
            f"routes named {name!r:.30}",
            ("run", "s.yaml", "--json"),
            files,
            allowed=ANY,
            patience_s=DRIVING_S,
        )
        sumo = (
            "run",
            f"./{name}.sumocfg",
            "--ego",
            "ego",
            "--planner",
            "constant",
            "--time-limit",
            "3",
            "--json",
        )
        yield Case(
            "special-file",
            f"configuration named {name!r:.30}",
            sumo,
            {f"{name}.sumocfg": SUMOCFG.encode()},
            allowed=ANY,
            patience_s=DRIVING_S,
        )
        words = ("run", "good.yaml", "--json", f"--out=./{name}")
        yield Case(
            "special-file", f"output named {name!r:.30}", words, allowed=ANY, patience_s=DRIVING_S
        )
    yield Case("special-file", "a name that is too long", ("run", "x" * 300 + ".yaml", "--json"))


def _outputs() -> Iterator[Case]:
    """Where results cannot be written."""
    for words in (OUT, BATCH):
        what = words[0]
        for name, prepare in (
            ("a file", link("out", "good.yaml")),
            ("a pipe", pipe("out")),
            ("a link to itself", link("out", "out")),
            ("a device", link("out", "/dev/full")),
        ):
            yield Case(
                "special-file", f"{what} into {name}", words, prepare=prepare, naming=("out",)
            )
        for inner in (
            "episodes.jsonl",
            "episodes.csv",
            "manifest.json",
            "traces",
            "maps",
            "figures",
        ):
            for by, replaced in (
                ("a folder", directory),
                ("a pipe", pipe),
                ("/dev/full", lambda name: link(name, "/dev/full")),
                ("a link to itself", lambda name: link(name, name)),
            ):
                if (by == "a folder") == (inner in ("traces", "maps", "figures")):
                    continue
                prepare = _inside("out", replaced(f"out/{inner}"))
                yield Case(
                    "special-file",
                    f"{what} where {inner} is {by}",
                    words,
                    prepare=prepare,
                    allowed=ANY,
                    patience_s=DRIVING_S,
                )
        for right, mode in (("write", 0o500), ("enter", 0)) if _CAN_CLOSE else ():
            prepare = _inside("out", closed("out", mode))
            yield Case(
                "special-file",
                f"{what} without the right to {right}",
                words,
                prepare=prepare,
                prefix=_AS_OWNER,
                naming=("out",),
            )


def _inside(name: str, prepare: Prepare) -> Prepare:
    def both(folder: Path) -> None:
        (folder / name).mkdir()
        prepare(folder)

    return both
