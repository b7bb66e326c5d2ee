"""`make attack`: wrong inputs through the real command, and a table of kinds, cases and failures.

    python -m attack [KIND ...] [--share 0.1] [--jobs 2] [--out out/attack] [--list]

Writes table.md and failures.md into the folder; exit status 1 where an answer was wrong.
"""

import argparse
import random
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from .case import Case
from .corpus import KINDS, cases
from .judge import Verdict, command_line, judge, slowness

_SEED = 24


def main() -> int:
    """Judge the cases that the command line names."""
    asked = _parsed()
    chosen = sampled([case for kind in asked.kinds or KINDS for case in cases(kind)], asked.share)
    if asked.name:
        chosen = [case for case in chosen if asked.name in case.title]
    if asked.list:
        print("\n".join(f"{case.title:60s} {command_line(case)}" for case in chosen))
        return 0
    begun = time.monotonic()
    slow = slowness()
    print(
        f"{len(chosen)} cases, {asked.jobs} at a time; this machine takes {slow:.1f} times as long "
        "as an idle one",
        flush=True,
    )
    verdicts = list(_judged(chosen, asked.jobs, slow, asked.out))
    asked.out.mkdir(parents=True, exist_ok=True)
    (asked.out / "table.md").write_text(f"{table(verdicts)}\n", encoding="utf-8")
    failed = _write_failures(verdicts, asked.out)
    print(
        f"\n{table(verdicts)}\n\n{time.monotonic() - begun:.0f} s; table and failures lie in "
        f"{asked.out}"
    )
    return 1 if failed else 0


def sampled(all_cases: Sequence[Case], share: float) -> list[Case]:
    """The same share of the cases every time, of every kind one at least, in their order."""
    chance = random.Random(_SEED)
    kept, seen = [], set()
    for case in all_cases:
        drawn = chance.random() < share
        if drawn or case.kind not in seen:
            kept.append(case)
        seen.add(case.kind)
    return kept


def table(verdicts: Sequence[Verdict]) -> str:
    """Kinds, cases and failures, as Markdown."""
    counts = Counter(verdict.case.kind for verdict in verdicts)
    wrong = Counter(verdict.case.kind for verdict in verdicts if verdict.faults)
    lines = [f"| {kind} | {count} | {wrong[kind]} |" for kind, count in counts.items()]
    return "\n".join(
        [
            "| kind | cases | failures |",
            "|---|---|---|",
            *lines,
            f"| all | {counts.total()} | {wrong.total()} |",
        ]
    )


def failure_text(verdict: Verdict) -> str:
    """A failure for a reader: what is wrong, the command, and what it answered."""
    said = verdict.answer.err.decode(errors="backslashreplace").strip().split("\n")
    shown = said if len(said) <= 6 else [*said[:2], f"... {len(said) - 5} lines ...", *said[-3:]]
    answer = "\n".join(f"    | {line[:300]!r}"[:320] for line in shown if line)
    head = (
        f"{verdict.case.title}\n    {'; '.join(verdict.faults)}\n    $ "
        f"{command_line(verdict.case)[:400]}"
    )
    return (
        f"{head}\n    status {verdict.answer.status}, {verdict.answer.seconds:.1f} s, "
        f"{verdict.answer.most_bytes / 1e6:.0f} MB\n{answer}\n"
    )


def _judged(chosen: Sequence[Case], jobs: int, slow: float, out: Path) -> Iterator[Verdict]:
    """The verdicts in the order of the cases; each failure is printed when it is found."""
    found: dict[str, Verdict] = {}
    bad = 0
    with ThreadPoolExecutor(jobs) as pool:
        for number, future in enumerate(
            as_completed([pool.submit(judge, case, slow) for case in chosen]), 1
        ):
            verdict = future.result()
            found[verdict.case.title] = verdict
            bad += bool(verdict.faults)
            if verdict.faults:
                print(failure_text(verdict), flush=True)
            if number % 25 == 0 or number == len(chosen):
                print(f"{number}/{len(chosen)} cases, {bad} failures", file=sys.stderr, flush=True)
                _write_failures(list(found.values()), out)
    yield from (found[case.title] for case in chosen)


def _write_failures(verdicts: Sequence[Verdict], out: Path) -> list[Verdict]:
    """failures.md; the verdicts that it tells of."""
    failed = [verdict for verdict in verdicts if verdict.faults]
    out.mkdir(parents=True, exist_ok=True)
    (out / "failures.md").write_text("\n".join(map(failure_text, failed)), encoding="utf-8")
    return failed


def _parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="attack", description="Wrong inputs through the real command."
    )
    parser.add_argument(
        "kinds",
        nargs="*",
        metavar="KIND",
        choices=[*KINDS, []],
        help=f"default: all of {', '.join(KINDS)}",
    )
    parser.add_argument(
        "--share", type=float, default=1.0, help="of the cases, the same ones every time"
    )
    parser.add_argument("--name", default="", help="only cases with this in their title")
    parser.add_argument("--jobs", type=int, default=2, help="commands at a time")
    parser.add_argument(
        "--out", type=Path, default=Path("out/attack"), help="folder for table.md and failures.md"
    )
    parser.add_argument("--list", action="store_true", help="print the cases and run none")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
