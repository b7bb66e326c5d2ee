"""`make mutants`: which small wrong changes to the package does no test notice?

    python -m mutants [PART ...] [--count 200] [--seed 1] [--jobs 2] [--tests FILE ...]

PART: planners, cost, referee, command, or a file such as model/cost.py. One line for each change.
Exit status 1 where fewer than 95 % were noticed. The folder `--out` keeps what the tests reach.
"""

import argparse
import hashlib
import json
import os
import random
import re
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from .changes import PACKAGE, TOP, Mutant, mutants
from .trial import Functions, Job, Outcome, in_copies, with_tests

PARTS = {
    "planners": ("planners/*.py",),
    "cost": tuple(
        f"model/{name}.py"
        for name in (
            "cost", "cost_to_go", "interaction", "gaps", "occupancy", "passing", "kerbs", "leaving",
            "least_cost", "obligations", "completing", "reactions",
        )
    ),
    "referee": ("evaluation/*.py",),
    "command": ("world/command.py",),
}  # fmt: skip
TESTS = {
    "planners": ("tests/planners", "tests/model/test_cost_params.py"),
    "model": ("tests/model", "tests/planners"),
    "evaluation": ("tests/evaluation",),
    "world": ("tests/world/test_command.py", "tests/world/test_commander.py"),
}
# They compare recorded numbers, and would notice everything; nobody can say whether the record is
# right.
RECORDED = (
    "test_the_golden_trees_grow_again",
    "test_without_compilation_the_tree_is_the_same_to_the_bit",
)
LIMIT = 1.5  # s of computing: a test that takes longer without compilation is left out
ALL_TESTS = 10.0  # s of computing for the tests of one change; the fastest come first
TARGET = 0.95
EQUIVALENT = Path(__file__).with_name("equivalent.yaml")


class Test(NamedTuple):
    """A test that passes without any change."""

    item: Any
    seconds: float
    reached: frozenset[str]  # "path::function"


def main() -> int:
    """Try the changes that the command line asks for."""
    os.environ["NUMBA_DISABLE_JIT"] = "1"  # before anything imports numba
    asked = _parsed()
    paths = [path for part in asked.parts or PARTS for path in _paths(part)]
    chosen = sampled([each for path in paths for each in mutants(path)], asked.count, asked.seed)
    known = equivalents()
    chosen = [each for each in chosen if each.key not in known]
    places = asked.tests or {place for path in paths for place in TESTS[path.split("/")[0]]}
    left: list[Mutant] = []
    tried: list[Mutant] = []

    def use(items: Sequence[Any]) -> None:
        functions = Functions()
        tests = passing(items, functions, asked.jobs, asked.out / "tests.json")
        here = [each for each in chosen if functions.has(each)]
        tried.extend(here)
        left.extend(survivors(here, tests, functions, asked.jobs))

    with_tests(sorted(places), RECORDED, use)
    return _reported(tried, left, known)


def sampled(every: Sequence[Mutant], count: int, seed: int) -> list[Mutant]:
    """So many of the changes, the same ones for the same seed; 0: all."""
    if not 0 < count < len(every):
        return list(every)
    order = random.Random(seed).sample(range(len(every)), count)
    return [every[k] for k in sorted(order)]


def equivalents() -> dict[str, str]:
    """Changes after which the package does the same, with the reason, by their key."""
    listed = yaml.safe_load(EQUIVALENT.read_text(encoding="utf-8")) or []
    return {key: each["why"] for each in listed for key in each["changes"]}


def passing(items: Sequence[Any], functions: Functions, jobs: int, file: Path) -> list[Test]:
    """The tests that pass without compilation and in time, with what they reach.

    What the `file` knows of a test from earlier runs is used again, if neither the test nor the
    package has changed.
    """
    digests = {str(item.path): _digest(Path(item.path)) for item in items}
    known = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    fresh = [k for k in items if f"{k.nodeid} {digests[str(k.path)]}" not in known]
    asked = [Job([item], LIMIT, lambda: None, functions.watched) for item in fresh]
    for n, (number, outcome) in enumerate(in_copies(asked, jobs)):
        item = fresh[number]
        known[f"{item.nodeid} {digests[str(item.path)]}"] = outcome
        if n % 20 == 19 or n + 1 == len(fresh):  # what is known is kept if the run is stopped
            _say(f"looked at {n + 1} of {len(fresh)} tests")
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(json.dumps(known), encoding="utf-8")
    tests = []
    for item in items:
        failed, seconds, reached = known[f"{item.nodeid} {digests[str(item.path)]}"]
        if not failed and reached:
            tests.append(Test(item, seconds, frozenset(reached)))
    _say(f"{len(tests)} of {len(items)} tests reach the package and pass uncompiled in {LIMIT:g} s")
    return sorted(tests, key=lambda each: each.seconds)


def survivors(
    chosen: Sequence[Mutant], tests: Sequence[Test], functions: Functions, jobs: int
) -> list[Mutant]:
    """The changes that no test notices; a line for each change."""
    work = []
    for mutant in chosen:
        users = functions.users(mutant)
        mine, total = [], 0.0
        for test in tests:
            if users & test.reached and total + test.seconds <= ALL_TESTS:
                mine.append(test.item)
                total += test.seconds
        limit = 3.0 * total + 5.0
        work.append(Job(mine, limit, lambda mutant=mutant: functions.put(mutant)))
    left = []
    for n, (number, outcome) in enumerate(in_copies(work, jobs)):
        mutant = chosen[number]
        _say(f"{n + 1}/{len(chosen)} {_line(mutant, outcome, len(work[number].tests))}")
        if not outcome.failed:
            left.append(mutant)
    return sorted(left)


def _line(mutant: Mutant, outcome: Outcome, tests: int) -> str:
    where = f"{mutant.path}:{mutant.line} {mutant.change}"
    if outcome.failed:
        return f"killed   {where} [{outcome.failed.rpartition('::')[2]}]"
    return f"SURVIVED {where} [{tests} tests]"


def _reported(tried: Sequence[Mutant], left: Sequence[Mutant], known: dict[str, str]) -> int:
    for each in left:
        print(f"{each.path}:{each.line} in {each.function}\n    {each.key}")
    share = 1.0 - len(left) / max(len(tried), 1)
    for path in sorted({each.path for each in tried}):
        here, gone = (sum(each.path == path for each in those) for those in (tried, left))
        print(f"{path:34s} {here - gone:4d} of {here:4d} killed")
    print(
        f"{len(tried) - len(left)} of {len(tried)} killed, {100 * share:.1f} % (wanted: "
        f"{100 * TARGET:g} %); {len(known)} changes are listed as equivalent"
    )
    return 0 if share >= TARGET else 1


def _paths(part: str) -> list[str]:
    """The modules of a part of the package, or one module."""
    found = [
        path.relative_to(PACKAGE).as_posix()
        for pattern in PARTS.get(part, (part,))
        for path in sorted(PACKAGE.glob(pattern))
    ]
    if not found:
        raise SystemExit(f"{part}: no such part; allowed: {', '.join(PARTS)} or a file")
    return found


def _digest(file: Path) -> str:
    """Of a test file, the helpers that it names, and the package."""
    left = {each.stem: each for each in file.parents[1].glob("*.py")}
    those = [file, left.pop("conftest")]
    for each in those:  # grows while it is read
        words = set(re.findall(r"\w+", each.read_text(encoding="utf-8")))
        those += [left.pop(name) for name in sorted(words & left.keys())]
    those += sorted(PACKAGE.rglob("*.py"))
    return hashlib.sha256(b"".join(each.read_bytes() for each in those)).hexdigest()[:12]


_STDOUT = os.dup(1)  # pytest catches what is printed


def _say(line: str) -> None:
    os.write(_STDOUT, f"{line}\n".encode())


def _parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m mutants", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART")
    parser.add_argument("--count", type=int, default=200, help="changes to try; 0: all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--tests", nargs="+", help="only these files")
    parser.add_argument("--out", type=Path, default=TOP / "out" / "mutants")
    parser.add_argument("--jobs", type=int, default=2, help="at the same time")
    return parser.parse_args()


if __name__ == "__main__":
    begun = time.monotonic()
    status = main()
    print(f"{time.monotonic() - begun:.0f} s")
    sys.exit(status)
