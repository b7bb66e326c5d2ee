"""What interrupts a batch costs no rows: signals, full disks, workers that die or hang."""

import json
import os
import resource
import signal
import time
from concurrent.futures import wait as real
from pathlib import Path

import pytest
from helpers_batch import (
    SLOW,
    SMALL,
    Reference,
    begun,
    count,
    crash_or_drive,
    exhaust_or_drive,
    hang_or_drive,
    is_gone,
    on_disk,
    out_of_memory_or_drive,
    start,
    timeless,
    wait_for,
    write,
)

from sumo_mcts import records, run_batch
from sumo_mcts.experiments.batch import listed
from sumo_mcts.experiments.dispatch import Dispatch
from sumo_mcts.experiments.experiment import episodes, load
from sumo_mcts.experiments.problems import BatchError
from sumo_mcts.experiments.progress import Progress
from sumo_mcts.experiments.workers import LocalPool, local


@pytest.mark.slow
def test_killed_and_resumed(whole: Reference, tmp_path: Path) -> None:
    small, out = begun(whole, tmp_path)
    process = start(small, out, 2)
    wait_for(lambda: count(out) >= 3, process)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    wait_for(lambda: is_gone(process.pid), None)  # the workers leave by themselves
    survived = on_disk(out)
    assert 3 <= len(survived) < 8
    # what a loss of power may leave: a torn line, a row twice, a trace whose row is lost
    lost = next(
        row["key"] for row in whole[1] if row["key"] not in {found["key"] for found in survived}
    )
    with (out / records.ROWS).open("ab") as file:
        file.write(
            json.dumps(survived[0]).encode()
            + b"\n"
            + json.dumps({"key": lost, "outcome": "arrived"}).encode()[:-3]
            + b"\0\0\0"
        )
    (out / "traces").mkdir(exist_ok=True)
    (out / "traces" / f".{lost}.npz.1.tmp").touch()
    process = start(small, out, 1)
    printed, told = process.communicate()
    assert process.returncode == 0, told
    assert printed.splitlines()[0].split() == [
        "unprotected-left-turn",
        "constant",
        "2",
        "collision",
    ]
    assert printed.splitlines()[-1] == f"{out}: 8 rows"
    assert told.splitlines()[-1].startswith("8/8 episodes, ")
    rows = on_disk(out)
    assert timeless(rows) == timeless(whole[1])
    kept = {row["key"]: row["wall_s"] for row in rows}
    assert all(kept[row["key"]] == row["wall_s"] for row in survived)  # these were not driven again
    assert {path.name for path in (out / "traces").iterdir()} == {
        path.name for path in (whole[0] / "traces").iterdir()
    }


@pytest.mark.slow
def test_interrupted(whole: Reference, tmp_path: Path) -> None:
    slow, out = begun(whole, tmp_path, SLOW)
    process = start(slow, out, 2)
    wait_for(lambda: count(out) >= 2, process)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: workers too
    began = time.monotonic()
    printed, told = process.communicate(timeout=30)
    assert time.monotonic() - began < 5.0
    assert (process.returncode, printed) == (130, "")
    assert told.splitlines()[-1] == "interrupted"
    assert "Traceback" not in told
    wait_for(lambda: is_gone(process.pid), None)
    assert not list(tmp_path.glob("sumo_mcts-*"))
    rows = on_disk(out)
    assert 2 <= len(rows) < 60
    assert (out / records.TABLE).read_text().count("\n") == 1 + len(rows)
    assert sum(item.done for item in listed(slow, out)) == len(rows)


@pytest.mark.slow
def test_an_interrupt_between_two_steps_loses_nothing(
    whole: Reference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small, out = begun(whole, tmp_path)
    append = records.append_row

    def interrupted(place: Path, row: records.Row) -> None:
        append(place, row)
        if count(place) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(records, "append_row", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_batch(small, out, jobs=1)
    assert len(on_disk(out)) == 3


@pytest.mark.slow
def test_a_full_disk(whole: Reference, tmp_path: Path) -> None:
    small, out = begun(
        whole, tmp_path, SMALL + "traces: none\n"
    )  # which would be the first to be refused

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))  # room for two rows

    process = start(small, out, 1, preexec_fn=limit)
    _, told = process.communicate(timeout=60)
    assert process.returncode == 1
    last = told.splitlines()[-1]
    assert last.startswith(
        f"error: --out {out}: File too large; what is done is kept, and the same command goes on"
    )
    assert "Traceback" not in told
    survived = records.read_rows(out)
    assert len(survived) == 2
    rows = run_batch(small, out, jobs=1)
    assert timeless(rows) == timeless(whole[1])
    assert {row["key"]: row["wall_s"] for row in rows}.items() >= {
        row["key"]: row["wall_s"] for row in survived
    }.items()


@pytest.mark.slow
def test_a_killed_worker_costs_nothing(whole: Reference, tmp_path: Path) -> None:
    plan = load(write(tmp_path))
    killed = []
    with local(2) as crew:
        pool = crew.executor
        assert isinstance(pool, LocalPool)

        def kill_once(at: Progress) -> None:
            if at.done >= 2 and not killed:
                killed.append(pool.pids()[0])
                os.kill(killed[0], signal.SIGKILL)

        rows = Dispatch(tmp_path / "out", episodes(plan, {}), "worth", kill_once).run(crew)
    assert len(killed) == 1
    assert timeless(rows) == timeless(whole[1])


@pytest.mark.slow
def test_an_episode_that_takes_its_worker_along(
    whole: Reference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    crashing = "highway-exit--constant--1"
    starts = tmp_path / "starts"
    starts.mkdir()
    for name, value in (("STARTS", str(starts)), ("CRASH", crashing)):
        monkeypatch.setenv(name, value)
    found = [
        episode
        for episode in episodes(load(write(tmp_path)), {})
        if episode.config.name == "highway-exit"
    ]
    with local(2) as crew:
        rows = Dispatch(tmp_path / "out", found, "worth", lambda _: None, crash_or_drive).run(crew)
    known = [row for row in whole[1] if row["scenario"] == "highway-exit"]
    assert [row["key"] for row in rows] == [row["key"] for row in known]
    same = [k for k, row in enumerate(rows) if row["key"] != crashing]
    assert timeless([rows[k] for k in same]) == timeless([known[k] for k in same])
    row = next(row for row in rows if row["key"] == crashing)
    assert (row["outcome"], row["error"]) == (
        "error",
        "the worker died (SIGSEGV), in each of 2 tries",
    )
    assert (row["seed"], row["ego"], row["scenario"], row["planner"]) == (
        1,
        "ego",
        "highway-exit",
        "constant",
    )
    assert row["config_digest"] == next(
        found["config_digest"] for found in whole[1] if found["key"] == crashing
    )
    tries = {episode.keys[0]: len(list(starts.glob(f"{episode.keys[0]}.*"))) for episode in found}
    assert tries == {
        key: 2 if key == crashing else 1 for key in tries
    }  # who was in flight beside it was not disturbed
    assert len(on_disk(tmp_path / "out")) == 4


@pytest.mark.slow
def test_an_episode_without_an_end_is_ended_and_recorded(
    whole: Reference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HANG", "highway-exit--constant--0")
    found, out = episodes(load(write(tmp_path)), {}), tmp_path / "out"
    with local(2, 15.0) as crew:
        rows = Dispatch(out, found, "worth", lambda _: None, hang_or_drive).run(crew)
    (row,) = [row for row in rows if row["outcome"] == "error"]
    assert (row["key"], row["error"]) == (
        "highway-exit--constant--0",
        "no end within 15 s (--episode-timeout)",
    )
    others = [row for row in whole[1] if row["key"] != "highway-exit--constant--0"]
    assert timeless([row for row in rows if row["outcome"] != "error"]) == timeless(others)


@pytest.mark.slow
def test_an_episode_that_the_system_killed_is_driven_again_by_the_next_call(
    whole: Reference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STARVE", "highway-exit--constant--0")
    found, out = episodes(load(write(tmp_path)), {}), tmp_path / "out"
    with local(1) as crew:
        rows = Dispatch(out, found, "worth", lambda _: None, out_of_memory_or_drive).run(crew)
    (row,) = [row for row in rows if row["outcome"] == "error"]
    assert (
        row["error"]
        == "shortage of the machine: the worker died (SIGKILL), in each of 2 tries; the same "
        "command drives it again"
    )
    assert len(on_disk(out)) == len(whole[1])
    with local(1) as crew:
        rows = Dispatch(out, found, "worth", lambda _: None).run(crew)
    assert timeless(rows) == timeless(whole[1]) == timeless(on_disk(out))


@pytest.mark.slow
def test_a_worker_without_room_ends_the_batch_and_no_row_is_spoilt(
    whole: Reference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("EXHAUST", "highway-exit--constant--0")
    found, out = episodes(load(write(tmp_path)), {}), tmp_path / "out"
    said = (
        r"episode highway-exit--constant--0: Too many open files; what is done is kept, and the "
        r"same command goes on when that is mended"
    )
    with local(1) as crew, pytest.raises(BatchError, match=said):
        Dispatch(out, found, "worth", lambda _: None, exhaust_or_drive).run(crew)
    assert timeless(on_disk(out)) == timeless(whole[1][:2])
    with local(1) as crew:
        rows = Dispatch(out, found, "worth", lambda _: None).run(crew)
    assert timeless(rows) == timeless(whole[1])


@pytest.mark.slow
def test_what_is_done_is_kept_before_a_failure_ends_the_batch(
    whole: Reference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where several futures are done at a time, the failed one first among them."""
    monkeypatch.setattr(
        "sumo_mcts.experiments.dispatch.wait",
        lambda futures, *_: (
            sorted(real(futures).done, key=lambda f: f.exception() is None),
            set(),
        ),
    )
    monkeypatch.setenv("EXHAUST", "highway-exit--constant--0")
    found, out = episodes(load(write(tmp_path)), {}), tmp_path / "out"
    with local(1) as crew, pytest.raises(BatchError, match="Too many open files"):
        Dispatch(out, found, "worth", lambda _: None, exhaust_or_drive).run(
            crew._replace(most=lambda: 3)
        )
    assert timeless(on_disk(out)) == timeless(whole[1][:2])


def test_a_crew_that_cannot_be_asked_any_more_is_lost(whole: Reference, tmp_path: Path) -> None:
    def gone() -> int:
        raise OSError("the scheduler does not answer")

    found, out = episodes(load(write(tmp_path)), {}), tmp_path / "out"
    with (
        local(1) as crew,
        pytest.raises(
            BatchError,
            match=r"the workers are lost \(OSError the scheduler does not answer\); what is done "
            r"is kept",
        ),
    ):
        Dispatch(out, found, "worth", lambda _: None).run(crew._replace(most=gone))
