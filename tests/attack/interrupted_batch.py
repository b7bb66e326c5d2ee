"""`make interruptions`: a batch that is interrupted at random moments in every way, and gone on
with, until nothing is left to do. No row may be lost or doubled, and digests equal those of a batch
that was left alone.

    python -m attack.interrupted_batch [--count 60] [--seed 24] [--jobs 2]
"""

import argparse
import csv
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from .good import COMMAND, FILES, dumped, write
from .judge import MARK, names_in, running

EXPERIMENT = {
    "name": "interrupted",
    "scenarios": ["good.yaml"],
    "variants": {
        "constant": {},
        "idm": {"planner.name": "idm"},
        "mcts": {"planner.name": "mcts", "planner.iterations": 50},
    },
    "seeds": "0..9",
    "twins": True,
    "traces": "all",
}
PATIENCE_S = 300.0  # for a batch that is left alone
ENDING_S = 20.0  # from the signal to the end of all processes
EARLY_S = 1.0  # by then Python has started, on a busy machine too
STOPPED_S = 5.0  # --episode-timeout where a worker is stopped

Row = dict[str, Any]


class Blow(NamedTuple):
    """A way to interrupt a batch."""

    number: signal.Signals
    target: str  # "command", "group" (as a terminal does) or "worker"

    @property
    def ends(self) -> bool:
        """Whether the batch is over then; a worker that is killed or stopped is replaced."""
        return self.target != "worker"

    @property
    def status(self) -> int:
        """Exit status of the command that it ends."""
        return -self.number if self.number == signal.SIGKILL else 128 + self.number


ENDING = [
    Blow(number, target)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    for target in ("command", "group")
]
BLOWS = [
    *ENDING,
    Blow(signal.SIGKILL, "command"),
    Blow(signal.SIGKILL, "group"),
    Blow(signal.SIGKILL, "worker"),
    Blow(signal.SIGSTOP, "worker"),
]


class Tally(NamedTuple):
    """What came of all interruptions."""

    blows: Counter[str]
    rounds: int  # batches that were finished
    problems: tuple[str, ...]


class Batch(NamedTuple):
    """A batch under attack."""

    folder: Path  # with the good files and the experiment
    out: str  # where its rows go, in the folder
    jobs: int


def interrupt(count: int, seed: int, jobs: int, folder: Path) -> Tally:
    """Interrupt batches in a folder at `count` moments; each is gone on with until it is done, and
    compared with one that was left alone."""
    write(folder, FILES)
    (folder / "exp.yaml").write_text(dumped(EXPERIMENT), encoding="utf-8")
    begun = time.monotonic()
    expected = _digests(_finished(Batch(folder, "whole", jobs)))
    longest_s = 0.6 * (time.monotonic() - begun)  # later there may be nothing left to interrupt
    ways = [blow for blow in BLOWS if blow.number != signal.SIGSTOP or _has_timeout()]
    chance, blows, problems, rounds = random.Random(seed), list[Blow](), list[str](), 0
    while len(blows) < count:
        batch, before, done = Batch(folder, f"round{rounds}", jobs), len(blows), False
        while not done and len(blows) < count:
            blow, moment = ways[len(blows) % len(ways)], chance.uniform(0.1, longest_s)
            landed, done, found = _interrupted(batch, blow, moment, chance)
            blows += [blow] if landed else []
            found += _row_problems(_rows(batch), set(expected))
            problems += [
                f"{batch.out}: {blow.number.name} to the {blow.target} after {moment:.1f} s: "
                f"{problem}"
                for problem in found
            ]
        stopped = sum(blow.number == signal.SIGSTOP for blow in blows[before:])
        problems += [
            f"{batch.out}: {problem}"
            for problem in _differences(_finished(batch), expected, stopped, folder / batch.out)
        ]
        rounds += 1
        print(
            f"{len(blows)}/{count} interruptions, {rounds} batches, {len(problems)} problems",
            file=sys.stderr,
            flush=True,
        )
    return Tally(
        Counter(f"{blow.number.name} to the {blow.target}" for blow in blows),
        rounds,
        tuple(problems),
    )


def _words(batch: Batch) -> list[str]:
    limit = ["--episode-timeout", str(STOPPED_S)] if _has_timeout() else []
    return [
        *COMMAND,
        "batch",
        "exp.yaml",
        "--out",
        batch.out,
        "--jobs",
        str(batch.jobs),
        "--quiet",
        *limit,
    ]


def _has_timeout() -> bool:
    """Whether a worker that hangs is ended: without, one that is stopped would hang the batch."""
    from .kinds.options import commands, options

    return any(option.name == "--episode-timeout" for option in options(commands()["batch"]))


def _finished(batch: Batch) -> list[Row]:
    """The rows, once what is left of the batch was driven undisturbed."""
    done = subprocess.run(
        _words(batch),
        cwd=batch.folder,
        check=False,
        timeout=PATIENCE_S,
        capture_output=True,
        text=True,
    )
    if done.returncode not in (
        0,
        1,
    ):  # 1: there is a row with outcome error, which the comparison of rows tells
        raise RuntimeError(f"{batch.out}: the batch cannot be gone on with: {done.stderr}")
    return _rows(batch)


def _interrupted(
    batch: Batch, blow: Blow, moment: float, chance: random.Random
) -> tuple[bool, bool, list[str]]:
    """Start the batch and strike at a moment; whether it struck before the end, whether the batch
    is done, and what is wrong."""
    mark = f"interrupted-{os.getpid()}-{chance.getrandbits(64):x}"
    with tempfile.TemporaryDirectory() as scratch, tempfile.TemporaryFile() as err:
        environment = {**os.environ, MARK: mark, "TMPDIR": scratch}
        process = subprocess.Popen(
            _words(batch),
            cwd=batch.folder,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=err,
            start_new_session=True,
        )
        landed = _strike(process, blow, moment, chance)
        if not landed:
            process.wait(PATIENCE_S)
            return False, True, []
        struck = time.monotonic()
        try:
            status = process.wait(ENDING_S if blow.ends else PATIENCE_S)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            return True, False, ["the command does not end"]
        allowed = _statuses(blow, moment)
        problems = [f"status {status}, allowed {sorted(allowed)}"] if status not in allowed else []
        problems += _end_problems(blow, mark, struck, scratch)
        err.seek(0)
        said = err.read().decode(errors="replace")
        if "Traceback" in said:
            problems.append(f"traceback: {said.strip().splitlines()[-1]:.200}")
        return True, not blow.ends, problems


def _strike(
    process: "subprocess.Popen[bytes]", blow: Blow, moment: float, chance: random.Random
) -> bool:
    """Wait for the moment, or the first worker after it, and send the signal.

    False where the batch was over before.
    """
    with suppress(subprocess.TimeoutExpired):
        process.wait(moment)
    while process.poll() is None:
        targets = _workers(process.pid) if blow.target == "worker" else [process.pid]
        if targets:
            (os.killpg if blow.target == "group" else os.kill)(chance.choice(targets), blow.number)
            return True
        time.sleep(0.05)
    return False


def _workers(command: int) -> list[int]:
    """Worker processes, which multiprocessing has spawned below the command."""
    found = []
    with suppress(OSError):  # one of them has just ended
        for pid in _children(command):
            is_worker = b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
            found += [pid] if is_worker else _workers(pid)
    return found


def _children(process: int) -> list[int]:
    return [
        int(pid)
        for path in Path(f"/proc/{process}/task").glob("*/children")
        for pid in path.read_text(encoding="ascii").split()
    ]


def _statuses(blow: Blow, moment: float) -> set[int]:
    """Right exit statuses: a signal before Python has installed its handlers ends the process by
    itself; a worker that was struck may leave an error."""
    if not blow.ends:
        return {0, 1}
    return {blow.status, -blow.number} if moment < EARLY_S else {blow.status}


def _end_problems(blow: Blow, mark: str, struck: float, scratch: str) -> Iterator[str]:
    """What a batch that was struck has left, beside its rows."""
    while running(mark) and time.monotonic() - struck < ENDING_S:
        time.sleep(0.1)
    if alive := running(mark):
        yield f"{len(alive)} processes are left: {next(iter(alive.values())):.80}"
        for pid in alive:
            os.kill(pid, signal.SIGKILL)
    left = names_in(Path(scratch))
    if left and blow.ends and blow.number != signal.SIGKILL:
        yield f"files are left in the temporary folder: {sorted(left)[:3]}"


# --- rows ---


def _rows(batch: Batch) -> list[Row]:
    """The rows on the disk; a line that is not whole is none, as after a kill."""
    path = batch.folder / batch.out / "episodes.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return [row for row in map(_parsed, lines) if row is not None]


def _parsed(line: str) -> Row | None:
    try:
        found: Row = json.loads(line)
    except ValueError:
        return None
    return found


def _digests(rows: list[Row]) -> dict[str, tuple[str, str]]:
    return {row["key"]: (row["outcome"], row["trace_digest"]) for row in rows}


def _row_problems(rows: list[Row], expected: set[str]) -> Iterator[str]:
    """What is wrong with the rows of a batch at any moment."""
    yield from (
        f"{key} stands {count} times"
        for key, count in Counter(row["key"] for row in rows).items()
        if count > 1
    )
    yield from (f"{row['key']} was not asked for" for row in rows if row["key"] not in expected)


def _differences(
    rows: list[Row], expected: dict[str, tuple[str, str]], stopped: int, out: Path
) -> Iterator[str]:
    """What is wrong with the rows of a batch that is done.

    A worker that was stopped may have left its episode as an error.
    """
    yield from _row_problems(rows, set(expected))
    found = _digests(rows)
    yield from (f"{key} is lost" for key in expected if key not in found)
    wrong = [key for key in expected if key in found and found[key] != expected[key]]
    yield from (
        f"{key} is {found[key]}, not {expected[key]}" for key in wrong if found[key][0] != "error"
    )
    errors = [key for key in wrong if found[key][0] == "error"]
    if len(errors) > stopped:
        yield f"{len(errors)} rows are errors, {stopped} workers were stopped"
    with (out / "episodes.csv").open(encoding="utf-8", newline="") as file:
        if sorted(row["key"] for row in csv.DictReader(file)) != sorted(found):
            yield "episodes.csv has other rows than episodes.jsonl"
    unfinished = [path.name for path in out.rglob("*.tmp")]
    if unfinished:
        yield f"unfinished files: {unfinished[:3]}"


def main() -> int:
    """Interrupt, and print what came of it as Markdown."""
    parser = argparse.ArgumentParser(
        description="Interrupt a batch at random moments, in every way."
    )
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=24)
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="interruptions-") as folder:
        tally = interrupt(asked.count, asked.seed, asked.jobs, Path(folder))
    lines = [f"| {blow} | {count} |" for blow, count in sorted(tally.blows.items())]
    print(
        "\n".join(
            [
                "| interruption | times |",
                "|---|---|",
                *lines,
                "",
                f"{tally.rounds} batches finished, {len(tally.problems)} problems",
                *tally.problems,
            ]
        )
    )
    return 1 if tally.problems else 0


if __name__ == "__main__":
    sys.exit(main())
