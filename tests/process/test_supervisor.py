"""A supervised command ends in one line and a documented status, whatever ends it, and leaves no
file and no process behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(
    not hasattr(signal, "sigtimedwait"),
    reason="commands are supervised where signals can be waited for",
)

PATIENCE_S = 60.0

# A command that leaves a file in its temporary folder, says that it runs, and does {body}.
PROGRAM = """
import ctypes, os, signal, sys, tempfile, time
from sumo_mcts.process import supervisor
from sumo_mcts.process.ending import ended
from sumo_mcts.errors import ConfigError, FailedError

def command():
    tempfile.mkstemp()
    print("runs", flush=True)
    {body}

supervisor.CLOSING_S = 1.0
sys.exit(supervisor.supervised(lambda: ended(command)))
"""
STUCK = "ctypes.PyDLL(None).sleep(60)"  # holds the interpreter's lock, as compiled code may
ENDS = {
    "return": (0, ""),
    "return 2": (2, ""),
    "raise ConfigError('a.yaml: name: a text')": (2, "error: a.yaml: name: a text\n"),
    "raise ConfigError('a\\x1b[1m\\nb')": (2, "error: a\\x1b[1m\\nb\n"),
    "raise FailedError('not now')": (1, "error: not now\n"),
    "raise MemoryError": (1, "error: not enough memory\n"),
    "open('/nowhere/file')": (2, "error: /nowhere/file: No such file or directory\n"),
    "raise OSError(28, 'No space left on device', 'rows')": (
        1,
        "error: rows: No space left on device\n",
    ),
    "raise OSError(28, 'No space left on device')": (
        1,
        "error: standard output: No space left on device\n",
    ),
    "raise SystemExit(3)": (3, ""),
    "{}['key']": (
        1,
        (
            "error: a fault of sumo-mcts: KeyError: 'key' (<string>, line 10); SUMO_MCTS_DEBUG=1 shows "
            "the traceback\n"
        ),
    ),
    "os.abort()": (1, "error: the process was ended by SIGABRT\n"),
    "os.kill(os.getpid(), signal.SIGKILL)": (
        1,
        "error: the process was ended by SIGKILL, as the system does for want of memory\n",
    ),
    "supervisor.doing('SUMO, reading a.net.xml,'); os.abort()": (
        1,
        "error: SUMO, reading a.net.xml, was ended by SIGABRT\n",
    ),
    "os._exit(1)": (1, ""),
    "supervisor.results_are_out(0); ctypes.PyDLL(None).sleep(60)": (0, ""),
    "supervisor.results_are_out(1); os.abort()": (1, ""),
}


def start(body: str, folder: Path, **environment: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", PROGRAM.replace("{body}", body)]
    return subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(folder), **environment},
        start_new_session=True,
    )


def processes_of(session: int) -> list[int]:
    """The processes of a session that are not dead."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(folder.name))
    return found


def end_of(process: subprocess.Popen[str]) -> tuple[int, str]:
    _, err = process.communicate(timeout=PATIENCE_S)
    return process.returncode, err


@pytest.mark.slow
@pytest.mark.parametrize("body", ENDS)
def test_ends(body: str, tmp_path: Path) -> None:
    process = start(body, tmp_path)
    assert end_of(process) == ENDS[body]
    assert list(tmp_path.iterdir()) == []
    assert processes_of(process.pid) == []


SIGNALS = {
    signal.SIGINT: (130, "interrupted\n"),
    signal.SIGTERM: (143, "terminated\n"),
    signal.SIGHUP: (129, "hung up\n"),
}
BUSY = {
    "in Python": "time.sleep(60)",
    "in compiled code": STUCK,
    "while it cleans up": "try: time.sleep(60)\n    finally: time.sleep(1)",
}


CASES = [
    *((number, "in Python", whole_group) for number in SIGNALS for whole_group in (False, True)),
    (signal.SIGINT, "in compiled code", False), (signal.SIGHUP, "in compiled code", True),
    (signal.SIGTERM, "while it cleans up", True),
]  # fmt: skip


@pytest.mark.parametrize(("number", "busy", "whole_group"), CASES)
def test_signals(number: signal.Signals, busy: str, whole_group: bool, tmp_path: Path) -> None:
    """A terminal sends them to every process of the group, `kill` to one."""
    process = start(BUSY[busy], tmp_path)
    assert process.stdout is not None
    assert process.stdout.readline() == "runs\n"
    began = time.monotonic()
    os.killpg(process.pid, number) if whole_group else process.send_signal(number)
    assert end_of(process) == SIGNALS[number]
    assert time.monotonic() - began < 8.0
    assert list(tmp_path.iterdir()) == []
    assert processes_of(process.pid) == []


@pytest.mark.slow
@pytest.mark.parametrize("whole_group", [False, True])
def test_asked_twice_it_ends_at_once(whole_group: bool, tmp_path: Path) -> None:
    """In one line, although the child ends for the second signal too, or is killed meanwhile."""
    process = start("try: time.sleep(60)\n    finally: time.sleep(60)", tmp_path)
    assert process.stdout is not None
    process.stdout.readline()
    began = time.monotonic()
    for pause in (1.0, 0.0):
        if whole_group:
            os.killpg(process.pid, signal.SIGINT)
        else:
            process.send_signal(signal.SIGINT)
        time.sleep(pause)
    assert end_of(process) == (130, "interrupted\n")
    assert time.monotonic() - began < 8.0


@pytest.mark.slow
def test_the_line_is_written_once(tmp_path: Path) -> None:
    """The child has ended for a signal when it is killed: the parent alone writes."""
    body = "supervisor.asked_to_end(2); time.sleep(0.2); os.abort()"
    assert end_of(start(body, tmp_path)) == (130, "interrupted\n")


def test_before_anything_is_loaded(tmp_path: Path) -> None:
    """The parent answers from its first moment on; the child has not begun with its command."""
    code = (
        "from sumo_mcts import __main__ as m; m._command = lambda: "
        "__import__('time').sleep(60); m.main()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    until = time.monotonic() + PATIENCE_S
    while not list(tmp_path.iterdir()) and time.monotonic() < until:
        time.sleep(0.001)
    process.send_signal(signal.SIGTERM)
    assert end_of(process) == (143, "terminated\n")
    assert list(tmp_path.iterdir()) == []


def test_a_killed_parent_takes_the_child_along(tmp_path: Path) -> None:
    process = start("time.sleep(60)", tmp_path)
    assert process.stdout is not None
    process.stdout.readline()
    process.kill()
    process.communicate(timeout=PATIENCE_S)
    until = time.monotonic() + 10.0
    while processes_of(process.pid) and time.monotonic() < until:
        time.sleep(0.05)
    assert processes_of(process.pid) == []


@pytest.mark.slow
def test_nohup_stays_what_it_is(tmp_path: Path) -> None:
    program = PROGRAM.replace("{body}", "time.sleep(2)")
    code = f"import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n{program}"
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    assert process.stdout is not None
    process.stdout.readline()
    process.send_signal(signal.SIGHUP)
    assert end_of(process) == (0, "")


@pytest.mark.slow
def test_stopped_and_continued(tmp_path: Path) -> None:
    process = start("time.sleep(1)", tmp_path)
    assert process.stdout is not None
    process.stdout.readline()
    os.killpg(process.pid, signal.SIGSTOP)
    time.sleep(0.5)
    os.killpg(process.pid, signal.SIGCONT)
    assert end_of(process) == (0, "")


def test_a_traceback_where_it_is_wanted(tmp_path: Path) -> None:
    status, err = end_of(start("{}['key']", tmp_path, SUMO_MCTS_DEBUG="1"))
    assert status == 1
    assert err.startswith("Traceback")


# --- the real command ---


def command(words: str, tmp_path: Path) -> tuple[int, str, str]:
    """Exit status, standard output and error of a line for a shell; `sumo-mcts` is the command."""
    line = words.replace("sumo-mcts", f"{sys.executable} -m sumo_mcts")
    done = subprocess.run(
        ["bash", "-c", line],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    assert list(tmp_path.iterdir()) == []
    return done.returncode, done.stdout, done.stderr


@pytest.mark.slow
def test_a_closed_pipe_is_status_1(tmp_path: Path) -> None:
    status, _, err = command("set -o pipefail; sumo-mcts scenarios | true", tmp_path)
    assert (status, err) == (1, "error: standard output: Broken pipe\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device that is full")
def test_a_full_disk_is_status_1(tmp_path: Path) -> None:
    assert command("sumo-mcts schema > /dev/full", tmp_path) == (
        1,
        "",
        "error: standard output: No space left on device\n",
    )


@pytest.mark.slow
@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_standard_files(closed: str, tmp_path: Path) -> None:
    status, _, err = command(
        "sumo-mcts run straight-line --planner constant --quiet --set episode.time_limit_s=1 "
        f"{closed}",
        tmp_path,
    )
    assert (status, err) == (0, "")


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        "scenarios --json",
        "run straight-line --planner constant --json --set episode.time_limit_s=1",
    ],
)
def test_a_closed_standard_output_is_status_1(words: str, tmp_path: Path) -> None:
    assert command(f"sumo-mcts {words} >&-", tmp_path) == (
        1,
        "",
        "error: standard output: Bad file descriptor\n",
    )


@pytest.mark.slow
def test_wrong_input_is_status_2_where_all_is_closed(tmp_path: Path) -> None:
    assert command("sumo-mcts run nowhere.yaml <&- >&- 2>&-", tmp_path) == (2, "", "")


@pytest.mark.slow
def test_a_temporary_folder_that_is_none(tmp_path: Path) -> None:
    status, out, err = command(
        "for k in TMPDIR TEMP TMP; do export $k=/nowhere; done; sumo-mcts scenarios --json > "
        "/dev/null",
        tmp_path,
    )
    assert (status, out, err) == (0, "", "")  # Python falls back to others


def test_what_libraries_warn_of_is_not_shown(tmp_path: Path) -> None:
    warn = (
        "supervisor.silence_libraries(); import logging, warnings; warnings.warn('w'); "
        "logging.getLogger('library').warning('l')"
    )
    assert end_of(start(warn, tmp_path)) == (0, "")
    _, err = end_of(start(warn, tmp_path, SUMO_MCTS_DEBUG="1"))
    assert "UserWarning: w" in err
    assert err.endswith("l\n")
