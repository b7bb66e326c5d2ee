"""Runs a case with the real command in a process of its own, and tells what is wrong with the
answer."""

import json
import os
import re
import resource
import shlex
import shutil
import signal
import subprocess
import tempfile
import time
import unicodedata
import uuid
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from .case import DRIVEN, REFUSED, Case
from .good import COMMAND, FILES, recorded, write

MARK = "SUMO_MCTS_ATTACK"  # in the environment of the command and of all that it starts
MOST_BYTES = 1_500_000_000  # resident, of one process
GOOD_S = 2.0  # what the good scenario takes where nothing else runs
_GUARD_BYTES = (
    8_000_000_000  # of addresses: what asks for more is stopped before the machine suffers
)
_GRACE_S = 3.0  # for processes that end with the command
_OUTCOMES = (
    "arrived",
    "collision",
    "off_route",
    "timeout",
    "teleported",
)  # of an episode with status 0; docs/measures.md
_PROGRESS = re.compile(r".* \.\.\.|\d+/\d+ episodes.*|note: .*|warning: .*")
_EPISODE = re.compile(
    r"error: [^:]+: ego [^:]+: .|error: \d+ of \d+ rows "
)  # an outcome names scenario and ego
_TRACEBACK = re.compile(r"Traceback \(most recent call last\)|Fatal Python error")


class Answer(NamedTuple):
    """What came of a case."""

    status: int  # negative: the signal that ended the process
    out: bytes
    err: bytes
    seconds: float
    most_bytes: int  # resident, of the largest process
    hung: bool
    orphans: tuple[str, ...]  # command lines of processes that outlived the command
    leftovers: tuple[str, ...]  # in the temporary folder, or unfinished in the working folder


class Verdict(NamedTuple):
    """A case with its answer."""

    case: Case
    answer: Answer
    faults: tuple[str, ...]  # none: the answer is right


def judge(case: Case, slow: float = 1.0) -> Verdict:
    """Run a case in temporary folders and compare its answer with what is allowed; a machine that
    is `slow` times slower has so much more time."""
    if case.interruption is not None:  # at the same point of its work
        case = case._replace(
            interruption=case.interruption._replace(after_s=case.interruption.after_s * slow)
        )
    top = Path(tempfile.mkdtemp(prefix="attack-"))
    try:
        work, scratch = top / "work", top / "tmp"
        scratch.mkdir()
        write(work, {**FILES, **(recorded() if case.recorded else {}), **case.files})
        case.prepare(work)
        answer = run(case, work, scratch, slow)
    finally:
        shutil.rmtree(top, ignore_errors=True)
    return Verdict(case, answer, tuple(faults(case, answer)))


def slowness() -> float:
    """How many times longer than on an idle machine commands take now; at least 1.

    Raises RuntimeError where the good input is not answered rightly.
    """
    good = Case(
        "good",
        "the good scenario",
        ("run", "good.yaml", "--json"),
        allowed=frozenset({DRIVEN}),
        patience_s=600.0,
    )
    verdict = judge(good)
    if verdict.faults:
        raise RuntimeError(f"{command_line(good)}: {'; '.join(verdict.faults)}")
    return max(1.0, verdict.answer.seconds / GOOD_S)


def command_line(case: Case) -> str:
    """The case for a shell, in a folder with its files."""
    variables = [
        f"{key}={shlex.quote(value)}"
        for key, value in case.environment.items()
        if value is not None
    ]
    return " ".join(
        [*variables, *(shlex.quote(word) for word in (*case.prefix, "sumo-mcts", *case.words))]
    )


# --- running ---


def run(case: Case, work: Path, scratch: Path, slow: float = 1.0) -> Answer:
    """The answer to a case whose files lie in `work`; temporary files belong into `scratch`."""
    mark = uuid.uuid4().hex
    changed = {"TMPDIR": str(scratch), "DISPLAY": None, **case.environment, MARK: mark}
    environment = {
        key: value for key, value in {**os.environ, **changed}.items() if value is not None
    }
    before = names_in(work)
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        begun = time.monotonic()
        process = subprocess.Popen(
            [*case.prefix, *COMMAND, *case.words], cwd=work, env=environment,
            stdin=subprocess.DEVNULL, stdout=out, stderr=err,
            start_new_session=True,
        )  # fmt: skip
        resource.prlimit(process.pid, resource.RLIMIT_AS, (_GUARD_BYTES, _GUARD_BYTES))
        resource.prlimit(process.pid, resource.RLIMIT_CORE, (0, 0))
        status, usage, hung = _ended(process, case, begun, slow)
        seconds = time.monotonic() - begun
        orphans = _end_all(mark)
        out.seek(0)
        err.seek(0)
        said, told = out.read(), err.read()
    unfinished = [
        name for name in names_in(work) - before if name.endswith(".tmp") or name.startswith("core")
    ]
    kept = {f"sumo_mcts-{os.getuid()}"}  # compiled kernels, where the cache folder is no good
    leftovers = tuple(sorted([*names_in(scratch) - kept, *unfinished])) if not hung else ()
    return Answer(status, said, told, seconds, usage.ru_maxrss * 1024, hung, orphans, leftovers)


def _ended(
    process: "subprocess.Popen[bytes]", case: Case, begun: float, slow: float
) -> tuple[int, resource.struct_rusage, bool]:
    """Exit status, resources, and whether the process had to be killed since its time was over."""
    interruption, hung = case.interruption, False
    while True:
        pid, status, usage = os.wait4(process.pid, os.WNOHANG)
        if pid:
            process.returncode = os.waitstatus_to_exitcode(status)
            return process.returncode, usage, hung
        passed = time.monotonic() - begun
        if interruption is not None and passed >= interruption.after_s:
            (os.killpg if interruption.whole_group else os.kill)(process.pid, interruption.number)
            interruption = None
        if passed >= case.patience_s * max(slow, _crowding()) and not hung:
            hung = True
            os.killpg(process.pid, signal.SIGKILL)
        time.sleep(0.02)


def _crowding() -> float:
    """How many processes there are for each core: what others do now is no fault of the command."""
    return max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


def _end_all(mark: str) -> tuple[str, ...]:
    """Kill the processes that a command has left, after a moment; their command lines."""
    deadline = time.monotonic() + _GRACE_S
    while (left := running(mark)) and time.monotonic() < deadline:
        time.sleep(0.05)
    for pid in left:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    while left and running(mark):
        time.sleep(0.01)
    return tuple(left.values())


def running(mark: str) -> dict[int, str]:
    """Command lines of the processes with this mark in their environment, by number."""
    wanted, found = f"{MARK}={mark}".encode(), {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with suppress(OSError):  # it has ended, or is not ours
                if wanted in (entry / "environ").read_bytes().split(b"\0"):
                    found[int(entry.name)] = (
                        (entry / "cmdline")
                        .read_bytes()
                        .replace(b"\0", b" ")
                        .decode(errors="replace")
                        .strip()
                    )
    return found


def names_in(folder: Path) -> set[str]:
    """What lies in a folder."""
    return {path.name for path in folder.iterdir()}


# --- judging ---


def faults(case: Case, answer: Answer) -> Iterator[str]:
    """What is wrong with the answer, in words; nothing where it is right."""
    if answer.hung:
        yield f"hangs: not over after {case.patience_s:g} s"
        return
    if answer.status not in case.allowed:
        died = -answer.status if answer.status < 0 else answer.status - 128  # as a shell tells it
        allowed = ", ".join(map(str, sorted(case.allowed)))
        yield (
            f"dies: {_signal_name(died)}"
            if died > 0
            else f"status {answer.status}, allowed {allowed}"
        )
    if answer.most_bytes > MOST_BYTES:
        yield f"takes {answer.most_bytes / 1e9:.1f} GB of memory"
    if answer.orphans:
        yield f"leaves {len(answer.orphans)} processes: {answer.orphans[0]:.80}"
    if answer.leftovers:
        yield f"leaves files: {', '.join(answer.leftovers[:3])}"
    if case.said:
        yield from _faults_of_text(case, answer)


def _faults_of_text(case: Case, answer: Answer) -> Iterator[str]:
    try:
        err, out = answer.err.decode(), answer.out.decode()
    except UnicodeDecodeError:
        yield "prints bytes that are not UTF-8"
        return
    if _TRACEBACK.search(err):
        yield f"traceback: {_raised(err)}"
        return
    for name, text in (("standard error", err), ("standard output", out)):
        if odd := _control_characters(text):
            yield f"control characters on {name}: {odd!r}"
    lines = [line for line in err.split("\n") if line and not _PROGRESS.fullmatch(line)]
    if answer.status == DRIVEN:
        if lines:
            yield f"succeeds, but says: {lines[0]:.200}"
        yield from _faults_of_rows(case, out)
    elif answer.status in case.allowed:
        yield from _faults_of_lines(case, answer.status, lines)
        if answer.status == REFUSED and out:
            yield f"refused, but standard output has: {out[:80]!r}"


def _faults_of_lines(case: Case, status: int, lines: list[str]) -> Iterator[str]:
    """What is wrong with the lines of a command that did not succeed."""
    signalled = status > 128
    many = case.words[:1] == ("validate",)  # reports every mistake
    if not lines:
        yield f"status {status} without a word"
    elif len(lines) > 1 and not many:
        yield f"{len(lines)} lines on standard error: {lines[0]:.80} / {lines[1]:.80}"
    elif not signalled and not many and not lines[0].startswith("error: "):
        yield f"the line does not begin with `error: `: {lines[0]:.120}"
    elif not signalled and not _EPISODE.match(lines[0]):
        missing = [name for name in case.naming if name not in "\n".join(lines)]
        if missing:
            yield f"the line does not name {', '.join(missing)}: {lines[0]:.200}"


def _faults_of_rows(case: Case, out: str) -> Iterator[str]:
    """What is wrong with what a command that succeeded prints as JSON."""
    if "--json" not in case.words:
        return
    try:
        document = json.loads(out, parse_constant=_refuse)
    except ValueError as error:
        yield f"standard output is not one JSON document: {error}"
        return
    rows: list[dict[str, Any]] = (
        document.get("episodes", [])
        if isinstance(document, dict) and case.words[:1] == ("run",)
        else []
    )
    for row in rows:
        if row["outcome"] not in _OUTCOMES:
            yield f"status 0 with outcome {row['outcome']}"


def _refuse(text: str) -> None:
    raise ValueError(f"{text} is no JSON")


def _control_characters(text: str) -> str:
    """Characters that change what a terminal shows: control characters but the end of a line, and
    separators of lines."""
    return "".join(
        sorted({c for c in text if unicodedata.category(c) in ("Cc", "Zl", "Zp") and c != "\n"})
    )


def _raised(text: str) -> str:
    """What a traceback ends with, and the last line of the package that it leads through."""
    last = next((line for line in reversed(text.split("\n")) if line.strip()), "")
    places = re.findall(r"(sumo_mcts/[\w/]+\.py)\", line (\d+), in (\w+)", text)
    place = f" ({places[-1][0]}:{places[-1][1]} {places[-1][2]})" if places else ""
    return f"{last:.160}{place}"


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
