"""A sample of the wrong inputs that `make attack` tries with the real command; and that the judge
sees what it has to see."""

import json
import random
import resource
import signal
import sys
import uuid
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from attack import interrupted_batch, judge
from attack.case import ANY, ONLY_REFUSED, Case, Interruption
from attack.corpus import cases
from attack.judge import Answer, Verdict

# Those of which a case takes a second or two; what reads records or compiles the search is left to
# `make attack`.
QUICK = (
    "yaml",
    "scenario",
    "experiment",
    "set",
    "option",
    "sumo-option",
    "sumocfg",
    "network",
    "traffic",
    "environment",
    "special-file",
    "stream",
)
EACH = 2
SEED = 24


@pytest.mark.slow
@pytest.mark.parametrize("number", range(EACH))
@pytest.mark.parametrize("kind", QUICK)
def test_sample(kind: str, number: int) -> None:
    """The same cases of each kind every time."""
    case = random.Random(f"{SEED} {kind}").sample(cases(kind), EACH)[number]
    verdict = judge.judge(case, slow=3.0)
    assert verdict.faults == (), (
        f"{case.title}: "
        f"{judge.command_line(case)}\n{verdict.answer.err.decode(errors='replace')[-2000:]}"
    )


@pytest.mark.slow
def test_every_number_and_every_option_is_attacked() -> None:
    """As they stand in the schema and in the commands, so that new ones are too."""
    titles = [case.title for kind in ("number", "option") for case in cases(kind)]
    assert len(set(titles)) == len(titles)
    for part in (
        "cost.jerk: 1e+308",
        "traffic.crowd.streams.0.pos_m.1: -1",
        "batch --jobs 'nan'",
        "run --set ''",
        "report --out ''",
    ):
        assert [title for title in titles if part in title]


# --- the judge ---


def answered(status: int, err: str = "", out: str = "", **further: object) -> Answer:
    """An answer of a command."""
    usual = {"seconds": 1.0, "most_bytes": 10**8, "hung": False, "orphans": (), "leftovers": ()}
    return Answer(status, out.encode(), err.encode(), **{**usual, **further})  # type: ignore[arg-type]


CASE = Case("yaml", "x", ("run", "s.yaml", "--json"), naming=("s.yaml",))
LINE = "error: s.yaml: cost: unknown key\n"
ROW = json.dumps({"episodes": [{"outcome": "arrived"}]})


@pytest.mark.parametrize(
    ("answer", "fault"),
    [
        (answered(2, LINE), ""),
        (answered(2, f"starting SUMO ...\n{LINE}"), ""),
        (answered(0, LINE), "status 0"),
        (answered(1, "error: good: ego ego: SUMO failed\n"), "status 1"),
        (answered(2), "without a word"),
        (answered(2, LINE + LINE), "2 lines"),
        (answered(2, "s.yaml: no\n"), "does not begin"),
        (answered(2, "error: no\n"), "does not name s.yaml"),
        (answered(2, LINE, out="{}"), "standard output"),
        (answered(2, LINE.replace("cost", "\x1b[31m")), "control characters"),
        (answered(2, LINE.replace("cost", "a\u2028b")), "control characters"),
        (answered(2, f"Traceback (most recent call last):\nKeyError: 3\n{LINE}"), "traceback"),
        (answered(-11), "SIGSEGV"),
        (answered(139), "SIGSEGV"),
        (answered(2, LINE, hung=True), "hangs"),
        (answered(2, LINE, most_bytes=2 * 10**9), "memory"),
        (answered(2, LINE, orphans=("sumo",)), "processes"),
        (answered(2, LINE, leftovers=("sumo_mcts_x",)), "leaves files"),
    ],
)
def test_faults(answer: Answer, fault: str) -> None:
    found = list(judge.faults(CASE, answer))
    assert fault in "; ".join(found)
    assert bool(found) == bool(fault)


@pytest.mark.parametrize(
    ("out", "fault"),
    [
        (ROW, ""),
        (ROW.replace("arrived", "error"), "outcome error"),
        ("", "JSON"),
        (ROW.replace('"arrived"', "NaN"), "JSON"),
        (ROW + ROW, "JSON"),
    ],
)
def test_faults_of_rows(out: str, fault: str) -> None:
    found = list(judge.faults(CASE._replace(allowed=ANY), answered(0, out=out)))
    assert fault in "; ".join(found)
    assert bool(found) == bool(fault)


def judged(monkeypatch: pytest.MonkeyPatch, program: str, **case: object) -> Verdict:
    """The verdict on a program of Python in the place of the command."""
    monkeypatch.setattr(judge, "COMMAND", (sys.executable, "-c", program))
    return judge.judge(CASE._replace(**{"patience_s": 20.0, **case}))  # type: ignore[arg-type]


@pytest.mark.slow
def test_what_a_command_leaves_is_seen_and_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    mark = uuid.uuid4().hex
    orphan = (
        "import subprocess, sys; subprocess.Popen([sys.executable, '-c', 'import time; "
        f"time.sleep(99) # {mark}'], start_new_session=True)"
    )
    verdict = judged(monkeypatch, f"import tempfile; tempfile.mkdtemp(); {orphan}; sys.exit(2)")
    assert [fault.split(":")[0] for fault in verdict.faults[:2]] == [
        "leaves 1 processes",
        "leaves files",
    ]
    assert not [line for line in all_command_lines() if mark.encode() in line]


def all_command_lines() -> Iterator[bytes]:
    """Of everything that runs."""
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):  # it has ended
            yield path.read_bytes()


def test_a_hang_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    verdict = judged(monkeypatch, "import time; time.sleep(99)", patience_s=0.5)
    assert verdict.faults == ("hangs: not over after 0.5 s",)
    assert verdict.answer.seconds < 10.0


def test_a_signal_is_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    moment = Interruption(signal.SIGTERM, 0.3, whole_group=False)
    assert (
        judged(monkeypatch, "import time; time.sleep(99)", interruption=moment).answer.status
        == -signal.SIGTERM
    )


@pytest.mark.slow
def test_memory_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024  # a child begins as a copy
    verdict = judged(monkeypatch, "x = bytearray(400_000_000)", allowed=ONLY_REFUSED)
    assert 400_000_000 < verdict.answer.most_bytes < max(900_000_000, own + 1)


# --- a batch that is interrupted ---


@pytest.mark.slow
def test_an_interrupted_batch_loses_and_doubles_nothing(tmp_path: Path) -> None:
    tally = interrupted_batch.interrupt(count=6, seed=SEED, jobs=2, folder=tmp_path)
    assert tally.problems == ()
    assert tally.blows.total() == 6
