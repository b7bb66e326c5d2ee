"""A batch leaves the rows that single episodes would, whatever happens on the way: none lost, none
twice."""

import errno
import hashlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from concurrent.futures import wait as real
from pathlib import Path
from typing import Any

import pytest
from helpers_batch import (
    SMALL,
    crash_or_drive,
    die_for_want_of_memory_or_drive,
    exhaust_or_drive,
    hang_or_drive,
    timeless,
    write,
)

from sumo_mcts import cli, config, records, run_batch
from sumo_mcts.config import builtin, digest, plugins
from sumo_mcts.episode import run_episode
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments import folder, workers
from sumo_mcts.experiments.batch import BatchError, Progress, _asked, _Batch, _kind, listed
from sumo_mcts.experiments.experiment import TRAFFIC, Egos, Episode, episodes, load
from sumo_mcts.experiments.tasks import choose, drive, failed, rehearse
from sumo_mcts.experiments.workers import DeadWorkerError, LocalPool, SilentWorkerError, here, local
from sumo_mcts.records.highlights import Highlight
from sumo_mcts.records.statistics import Pair, pairs
from sumo_mcts.reporting.results import gather

GOOD = Path(__file__).parent.parent / "bad_inputs" / "good.sumocfg"
NET = GOOD.parent.parent.parent / "networks" / "crossing" / "crossing.net.xml"
SLOW = (
    SMALL.replace("name: small", "name: slow").replace("0..1", "0..14")
    + "set: {sumo.step_length_s: 0.02}\n"
)

Reference = tuple[Path, list[records.Row]]
Command = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Reference:
    """An experiment that ran undisturbed, with one worker: its folder and rows."""
    folder = tmp_path_factory.mktemp("whole")
    return folder / "out", run_batch(
        write(folder), folder / "out", jobs=1, command=("batch", "small.yaml")
    )


def on_disk(out: Path) -> list[dict[str, Any]]:
    """Every line of episodes.jsonl; raises where one is torn."""
    return [json.loads(line) for line in (out / records.ROWS).read_text().splitlines()]


def start(experiment: Path, out: Path, jobs: int, **more: Any) -> subprocess.Popen[str]:
    """The command in a group of processes of its own, with its temporary files beside the
    experiment."""
    words = [
        sys.executable,
        "-m",
        "sumo_mcts",
        "batch",
        str(experiment),
        "--out",
        str(out),
        "--jobs",
        str(jobs),
    ]
    environment = {**os.environ, "TMPDIR": str(experiment.parent)}
    return subprocess.Popen(
        words,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=environment,
        **more,
    )


def wait_for(there: Callable[[], bool], process: subprocess.Popen[str] | None) -> None:
    """Fails where the process ends before, or patience does."""
    until = time.monotonic() + 60.0
    while not there():
        assert time.monotonic() < until
        assert process is None or process.poll() is None, process.communicate()
        time.sleep(0.02)


def nobody(group: int) -> bool:
    """Whether no process of a group is left."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return True
    return False


def count(out: Path) -> int:
    return (out / records.ROWS).read_bytes().count(b"\n") if (out / records.ROWS).exists() else 0


def begun(whole: Reference, folder: Path, text: str = SMALL) -> tuple[Path, Path]:
    """An experiment, and a folder in which it was begun and no episode has ended."""
    manifest = json.loads((whole[0] / records.MANIFEST).read_text())
    path = write(folder, text)
    records.write_manifest(folder / "out", {**manifest, "experiment_digest": load(path).digest})
    return path, folder / "out"


# --- undisturbed ---


def test_rows_are_those_of_single_episodes(whole: Reference) -> None:
    _, rows = whole
    assert [row["key"] for row in rows[:4]] == [
        f"{scene}--{v}--0"
        for scene in ("unprotected-left-turn", "highway-exit")
        for v in ("constant", "sumo")
    ]
    alone = []
    for row in rows:
        scenario = config.load(
            builtin.scenario_path(row["scenario"]), (f"planner.name={row['planner']}",)
        )
        result = run_episode(scenario, row["seed"], variant=row["variant"])
        alone.append({**result.rows[0], "redrawn": result.manifest["redrawn"]})
    assert timeless(rows) == timeless(alone)


def test_what_lies_in_the_folder(whole: Reference) -> None:
    out, rows = whole
    assert on_disk(out) == rows
    assert (out / records.TABLE).read_text().count("\n") == 1 + len(rows) == 9
    manifest = json.loads((out / records.MANIFEST).read_text())
    assert manifest["experiment"]["name"] == "small"
    assert len(manifest["experiment_digest"]) == 64
    assert manifest["command"] == ["sumo-mcts", "batch", "small.yaml"]
    assert list(manifest["scenarios"]) == ["unprotected-left-turn", "highway-exit"]
    assert manifest["variants"] == {
        "constant": {"planner.name": "constant"},
        "sumo": {"planner.name": "sumo"},
    }
    assert manifest["versions"]["sumo_mcts"] is not None
    worth = Highlight("worth")
    keys = {row["key"] for row in rows}
    for row in rows:
        keys -= worth.add(row)
    assert {path.stem for path in (out / "traces").iterdir()} == keys
    collided = next(row for row in rows if row["outcome"] == "collision")
    trace = records.load_trace(out / "traces" / f"{collided['key']}.npz")
    assert (trace.key, trace.outcome, len(trace.cycles)) == (
        collided["key"],
        "collision",
        collided["cycles"],
    )


def test_nothing_is_done_again(whole: Reference, tmp_path: Path) -> None:
    out, rows = whole
    before = {path: path.stat().st_mtime_ns for path in (out / "traces").iterdir()}
    began = time.monotonic()
    assert run_batch(write(tmp_path), out, jobs=2) == rows == on_disk(out)
    assert time.monotonic() - began < 1.0
    assert {path: path.stat().st_mtime_ns for path in (out / "traces").iterdir()} == before


def test_two_workers_and_two_shards_give_the_same(whole: Reference, tmp_path: Path) -> None:
    out, rows = whole
    found, manifests, told = [], [], list[list[Progress]]()
    for k in (1, 2):
        told.append([])
        found += run_batch(
            write(tmp_path), tmp_path / str(k), jobs=3 - k, shard=(k, 2), watch=told[-1].append
        )
        manifests.append(json.loads((tmp_path / str(k) / records.MANIFEST).read_text()))
    assert sorted(timeless(found), key=lambda row: row["key"]) == sorted(
        timeless(rows), key=lambda row: row["key"]
    )
    assert [manifest["shard"] for manifest in manifests] == ["1/2", "2/2"]
    assert {manifest["experiment_digest"] for manifest in manifests} == {
        json.loads((out / records.MANIFEST).read_text())["experiment_digest"]
    }
    for part in told:
        assert part[0].doing and not part[-1].doing
        assert part[-1].done == part[-1].total
        assert [at.done for at in part] == sorted(at.done for at in part)
    assert sum(part[-1].total for part in told) == len(rows)
    assert (
        sum(part[-1].collisions for part in told)
        == sum(row["outcome"] == "collision" for row in rows)
        > 0
    )
    with pytest.raises(
        ConfigError, match="holds shard 1/2, not 2/2; each shard has a folder of its own"
    ):
        run_batch(write(tmp_path), tmp_path / "1", shard=(2, 2))


def test_pairs_are_made_in_the_same_traffic(whole: Reference, tmp_path: Path) -> None:
    out, rows = whole
    pair = [Pair(row, twin) for row, twin in zip(rows[::2], rows[1::2], strict=True)]
    assert pairs(rows[::2], rows[1::2]) == pair
    assert {row["traffic_digest"] for row in rows} == {
        digest(case.base, TRAFFIC) for case in load(write(tmp_path)).cases
    }
    other = (
        "name: x\nscenarios: [highway-exit]\nvariants: {constant: {planner.name: constant}, "
        "sumo: {planner.name: sumo, episode.time_limit_s: 50.0}}\n"
    )
    driven = run_batch(write(tmp_path, other), tmp_path / "out", jobs=1)
    assert [row["planner"] for row in driven] == ["constant", "sumo"]
    assert pairs(driven[:1], driven[1:]) == []
    assert (
        failed(episodes(load(write(tmp_path)), {})[0], "a reason")[0]["traffic_digest"]
        == rows[0]["traffic_digest"]
    )
    assert {row["key"]: row["traffic_digest"] for row in gather([out]).rows} == {
        row["key"]: row["traffic_digest"] for row in rows
    }  # as a report reads them


@pytest.mark.parametrize("part", [(0, 2), (3, 2), (-1, 2), (1, 0)])
def test_a_shard_that_there_is_not(part: tuple[int, int], tmp_path: Path) -> None:
    """Its episodes would be none, or without a word those of another."""
    for attempt in (
        lambda: run_batch(write(tmp_path), tmp_path / "out", shard=part),
        lambda: listed(write(tmp_path), shard=part),
    ):
        with pytest.raises(
            ConfigError, match=f"--shard {part[0]}/{part[1]}: i/n with i from 1 to n, as in 2/8"
        ):
            attempt()
    assert not (tmp_path / "out").exists()


# --- interrupted ---


def test_killed_and_resumed(whole: Reference, tmp_path: Path) -> None:
    small, out = begun(whole, tmp_path)
    process = start(small, out, 2)
    wait_for(lambda: count(out) >= 3, process)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    wait_for(lambda: nobody(process.pid), None)  # the workers leave by themselves
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
    wait_for(lambda: nobody(process.pid), None)
    assert not list(tmp_path.glob("sumo_mcts-*"))
    rows = on_disk(out)
    assert 2 <= len(rows) < 60
    assert (out / records.TABLE).read_text().count("\n") == 1 + len(rows)
    assert sum(item.done for item in listed(slow, out)) == len(rows)


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

        rows = _Batch(tmp_path / "out", episodes(plan, {}), "worth", kill_once).run(crew)
    assert len(killed) == 1
    assert timeless(rows) == timeless(whole[1])


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
        rows = _Batch(tmp_path / "out", found, "worth", lambda _: None, crash_or_drive).run(crew)
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


def test_an_episode_without_an_end_is_ended_and_recorded(
    whole: Reference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HANG", "highway-exit--constant--0")
    found, out = episodes(load(write(tmp_path)), {}), tmp_path / "out"
    with local(2, 15.0) as crew:
        rows = _Batch(out, found, "worth", lambda _: None, hang_or_drive).run(crew)
    (row,) = [row for row in rows if row["outcome"] == "error"]
    assert (row["key"], row["error"]) == (
        "highway-exit--constant--0",
        "no end within 15 s (--episode-timeout)",
    )
    others = [row for row in whole[1] if row["key"] != "highway-exit--constant--0"]
    assert timeless([row for row in rows if row["outcome"] != "error"]) == timeless(others)


def test_an_episode_that_the_system_killed_is_driven_again_by_the_next_call(
    whole: Reference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STARVE", "highway-exit--constant--0")
    found, out = episodes(load(write(tmp_path)), {}), tmp_path / "out"
    with local(1) as crew:
        rows = _Batch(out, found, "worth", lambda _: None, die_for_want_of_memory_or_drive).run(
            crew
        )
    (row,) = [row for row in rows if row["outcome"] == "error"]
    assert (
        row["error"]
        == "shortage of the machine: the worker died (SIGKILL), in each of 2 tries; the same "
        "command drives it again"
    )
    assert len(on_disk(out)) == len(whole[1])
    with local(1) as crew:
        rows = _Batch(out, found, "worth", lambda _: None).run(crew)
    assert timeless(rows) == timeless(whole[1]) == timeless(on_disk(out))


@pytest.mark.parametrize(
    ("error", "raised"),
    [
        (DeadWorkerError("the worker died (SIGSEGV)"), ConfigError),  # of this input
        (DeadWorkerError("the worker died (SIGKILL)", shortage=True), BatchError),
        (SilentWorkerError("no end within 5 s (--episode-timeout)"), BatchError),
        (MemoryError(), BatchError),
    ],
)
def test_what_ends_a_worker_before_the_first_episode(
    error: Exception, raised: type[Exception], tmp_path: Path
) -> None:
    answer: Future[None] = Future()
    answer.set_exception(error)
    with here() as crew, pytest.raises(raised):
        _asked(load(write(tmp_path)), "highway-exit", answer, crew, lambda _: None)


def test_a_worker_without_room_ends_the_batch_and_no_row_is_spoilt(
    whole: Reference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("EXHAUST", "highway-exit--constant--0")
    found, out = episodes(load(write(tmp_path)), {}), tmp_path / "out"
    said = (
        r"episode highway-exit--constant--0: Too many open files; what is done is kept, and the "
        r""
        r""
        r""
        r""
        r""
        r""
        r""
        r"same command goes on when that is mended"
    )
    with local(1) as crew, pytest.raises(BatchError, match=said):
        _Batch(out, found, "worth", lambda _: None, exhaust_or_drive).run(crew)
    assert timeless(on_disk(out)) == timeless(whole[1][:2])
    with local(1) as crew:
        rows = _Batch(out, found, "worth", lambda _: None).run(crew)
    assert timeless(rows) == timeless(whole[1])


def test_what_is_done_is_kept_before_a_failure_ends_the_batch(
    whole: Reference, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where several futures are done at a time, the failed one first among them."""
    monkeypatch.setattr(
        "sumo_mcts.experiments.batch.wait",
        lambda futures, *_: (
            sorted(real(futures).done, key=lambda f: f.exception() is None),
            set(),
        ),
    )
    monkeypatch.setenv("EXHAUST", "highway-exit--constant--0")
    found, out = episodes(load(write(tmp_path)), {}), tmp_path / "out"
    with local(1) as crew, pytest.raises(BatchError, match="Too many open files"):
        _Batch(out, found, "worth", lambda _: None, exhaust_or_drive).run(
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
        _Batch(out, found, "worth", lambda _: None).run(crew._replace(most=gone))


# --- folders ---


def test_the_folder_of_something_else(whole: Reference, tmp_path: Path) -> None:
    out, rows = whole
    state = [path.read_bytes() for path in sorted(out.glob("*.*"))]
    for text, what in (
        (SMALL.replace("0..1", "0..3"), "another state of small"),
        (SMALL.replace("small", "other"), "another experiment"),
    ):
        with pytest.raises(ConfigError, match=f"holds {what}; take another --out, or --fresh"):
            run_batch(write(tmp_path, text), out)
    assert [path.read_bytes() for path in sorted(out.glob("*.*"))] == state
    other = tmp_path / "run"
    records.append_row(other, rows[0])
    with pytest.raises(ConfigError, match=r"holds rows without manifest\.json"):
        run_batch(write(tmp_path), other)
    records.write_manifest(other, {"scenario": {"name": "x"}})
    with pytest.raises(ConfigError, match="holds something else than a batch"):
        run_batch(write(tmp_path), other)


def test_versions_do_not_mix(whole: Reference, tmp_path: Path) -> None:
    manifest = json.loads((whole[0] / records.MANIFEST).read_text())
    records.write_manifest(
        tmp_path / "out", {**manifest, "versions": {**manifest["versions"], "sumo": "1.27.0"}}
    )
    with pytest.raises(ConfigError, match=r"was begun with sumo 1\.27\.0, this is 1\."):
        run_batch(write(tmp_path), tmp_path / "out")


def test_files_and_plugins_do_not_mix(tmp_path: Path) -> None:
    """The scenario says the same before and after: what has changed is only in what it names."""
    (tmp_path / "net").mkdir()
    for file, name in ((NET, "net/mine.net.xml"), (GOOD.with_name("one.rou.xml"), "mine.rou.xml")):
        shutil.copy(file, tmp_path / name)
    named = "<net-file value='net/mine.net.xml'/><route-files value='mine.rou.xml'/>"
    (tmp_path / "mine.sumocfg").write_text(f"<configuration>{named}</configuration>")
    experiment, out = (
        write(tmp_path, network("[ego]").replace(str(GOOD), "mine.sumocfg")),
        tmp_path / "out",
    )
    rows = run_batch(experiment, out, jobs=1)
    manifest = json.loads((out / records.MANIFEST).read_text())
    assert list(manifest["files"]) == ["mine.net.xml", "mine.rou.xml", "mine.sumocfg"]
    for name in manifest["files"]:
        (path,) = tmp_path.rglob(name)
        before = path.read_bytes()
        assert manifest["files"][name] == [hashlib.sha256(before).hexdigest()]
        path.write_bytes(before + b"<!-- -->")
        with pytest.raises(
            ConfigError,
            match=f"{name} has changed since the batch was begun; take another --out, or --fresh",
        ):
            run_batch(experiment, out, jobs=1)
        path.write_bytes(before)
    assert run_batch(experiment, out, jobs=1) == rows
    plugin = {
        "key": "planner.name",
        "name": "mine",
        "code": "mine:Mine",
        "package": {"name": "mine", "version": "1"},
    }
    now = {**manifest, "plugins": [{**plugin, "package": {"name": "mine", "version": "2"}}]}
    records.write_manifest(out, {**manifest, "plugins": [plugin]})
    with pytest.raises(ConfigError, match="plugin mine has changed since the batch was begun"):
        folder.begun(out, now)


SLEEPER = """
from sumo_mcts.scene import Decision, Release

class Sleeper:
    needs_forecast = False
    def __init__(self, options, scenario): pass
    def start(self, task, seed): pass
    def plan(self, situation): return Decision(Release(), None, (), -1, "", 0, 0)
"""


def test_a_plugin_whose_file_has_changed_does_not_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    module = tmp_path / "sleeper_of_mine.py"
    module.write_text(SLEEPER)
    text = (
        "name: x\nscenarios: [straight-line]\nvariants: {asleep: {planner.name: "
        "'sleeper_of_mine:Sleeper', episode.stop_time_s: 1}}\n"
    )
    experiment, out = write(tmp_path, text), tmp_path / "out"
    rows = run_batch(experiment, out, jobs=1, allow_plugins=True)
    (plugin,) = json.loads((out / records.MANIFEST).read_text())["plugins"]
    assert plugin["file_digest"] == hashlib.sha256(SLEEPER.encode()).hexdigest()
    module.write_text(SLEEPER + "# to come\n")
    with pytest.raises(
        ConfigError,
        match="plugin sleeper_of_mine:Sleeper has changed since the batch was begun; take another "
        "--out, or --fresh",
    ):
        run_batch(experiment, out, jobs=1, allow_plugins=True)
    module.write_text(SLEEPER)
    assert run_batch(experiment, out, jobs=1, allow_plugins=True) == rows
    monkeypatch.setitem(sys.modules, "sleeper_of_mine", None)
    assert (
        plugins.described(load(experiment, allow_plugins=True).cases[0].configs["asleep"])[0][
            "file_digest"
        ]
        is None
    )


def test_fresh_removes_what_a_batch_leaves_and_nothing_else(
    whole: Reference, tmp_path: Path
) -> None:
    small, out = begun(whole, tmp_path)
    records.append_row(out, whole[1][0])
    for name in ("traces/a.npz", "tables/b.csv", "report.html", "mine.txt", "figures/c.png"):
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).touch()
    assert sum(item.done for item in listed(small, out)) == 1
    assert sum(item.done for item in listed(small, out, fresh=True)) == 0
    folder.clear(out)
    assert {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()} == {
        "mine.txt",
        "figures/c.png",
    }
    assert folder.begun(out, {}) is None


@pytest.mark.parametrize("manifest", [{"scenario": {"name": "x"}}, None])
def test_fresh_leaves_alone_what_no_batch_wrote(
    manifest: dict[str, Any] | None, whole: Reference, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    records.append_row(out, whole[1][0])
    if manifest is not None:
        records.write_manifest(out, manifest)
    for name in ("figures/a.png", "report.html", "tables/b.csv", "traces/c.npz"):
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).touch()
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    what = (
        r"holds rows without manifest\.json"
        if manifest is None
        else "holds something else than a batch"
    )
    for attempt in (
        lambda: run_batch(write(tmp_path), out, fresh=True),
        lambda: listed(write(tmp_path), out, fresh=True),
        lambda: folder.clear(out),
    ):
        with pytest.raises(ConfigError, match=f"{what}; take another --out$"):
            attempt()
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


def test_fresh_takes_nothing_from_a_folder_without_a_batch(tmp_path: Path) -> None:
    (tmp_path / "report.html").touch()  # of `sumo-mcts report --out`
    folder.clear(tmp_path)
    assert (tmp_path / "report.html").exists()


def test_one_batch_at_a_time(whole: Reference, tmp_path: Path) -> None:
    def again(_: Progress) -> None:
        with pytest.raises(ConfigError, match="another run or batch is at work there"):
            run_batch(write(tmp_path), whole[0])

    run_batch(write(tmp_path), whole[0], watch=again)


# --- several egos in one episode ---


@pytest.fixture
def two(tmp_path: Path) -> Episode:
    """One episode of two egos."""
    (tmp_path / "two.yaml").write_text(
        f"base: {builtin.scenario_path('highway-exit')}\nname: two\negos: [{{id: ego}}, {{id: "
        "left_lane}}]\n"
    )
    (episode,) = episodes(
        load(
            write(
                tmp_path,
                "name: x\nscenarios: [two.yaml]\nvariants: {constant: {planner.name: constant}}\n",
            )
        ),
        {},
    )
    return episode


def test_two_egos_leave_two_rows(two: Episode) -> None:
    driven = drive(two, Highlight("all").bar("two", "constant"))
    assert [(row["key"], row["ego"]) for row in driven.rows] == [
        ("two--constant--0--ego", "ego"),
        ("two--constant--0--left_lane", "left_lane"),
    ]
    assert set(driven.traces) == {row["key"] for row in driven.rows}


def test_a_part_of_an_episode_does_not_count(two: Episode, tmp_path: Path) -> None:
    first, second = failed(two, "a reason")
    records.append_row(tmp_path, first)
    assert folder.done(tmp_path, [two]) == []
    records.append_row(tmp_path, second)
    records.append_row(tmp_path, {**first, "error": "the later one"})
    assert [row["error"] for row in folder.done(tmp_path, [two])] == ["the later one", "a reason"]


def test_an_exception_is_the_outcome(two: Episode, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("as asked")

    monkeypatch.setattr("sumo_mcts.experiments.tasks.run_episode", broken)
    driven = drive(two, Highlight("all").bar("two", "constant"))
    assert [(row["outcome"], row["error"]) for row in driven.rows] == [
        ("error", "RuntimeError: as asked")
    ] * 2
    assert driven.traces == {}


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        *(
            OSError(getattr(errno, name), name)
            for name in ("ENOSPC", "EDQUOT", "ENFILE", "ENOMEM", "EIO")
        ),
    ],
)
def test_what_the_machine_lacks_is_no_outcome(
    error: Exception, two: Episode, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("sumo_mcts.experiments.tasks.run_episode", broken)
    monkeypatch.setattr("sumo_mcts.experiments.tasks.warm_up", broken)
    with pytest.raises(type(error)):
        drive(two, Highlight("all").bar("two", "constant"))
    with pytest.raises(type(error)):
        rehearse(two.config, 0)


# --- networks of the user ---


def network(egos: str, more: str = "") -> str:
    return (
        f"name: x\nscenarios: [{{sumocfg: {GOOD}, egos: {egos}{more}}}]\nvariants: {{constant: "
        f"{{planner.name: constant}}}}\ntwins: true\n"
    )


def test_egos_of_a_network(tmp_path: Path) -> None:
    rows = run_batch(write(tmp_path, network("{random: 2}")), tmp_path / "out", jobs=1)
    assert [(row["key"], row["ego"], row["seed"]) for row in rows] == [
        (f"good--{variant}--own--{ego}", ego, None)
        for ego in ("ego", "other")
        for variant in ("constant", "sumo")
    ]
    assert {row["outcome"] for row in rows} == {"arrived"}
    manifest = json.loads((tmp_path / "out" / records.MANIFEST).read_text())
    assert manifest["egos"] == {"good": ["ego", "other"]}
    trace = next(iter(sorted((tmp_path / "out" / "traces").iterdir())))
    assert records.load_trace(trace).key == trace.stem
    # what was drawn is kept, so a draw that came out otherwise would not be followed
    records.write_manifest(tmp_path / "out", {**manifest, "egos": {"good": ["other"]}})
    assert [
        row["ego"]
        for row in run_batch(write(tmp_path, network("{random: 2}")), tmp_path / "out", jobs=1)
    ] == ["other", "other"]


def test_a_draw_of_egos() -> None:
    scenario = config.build(
        {"name": "x", "sumo": {"sumocfg": str(GOOD)}, "egos": [{"id": "any"}]}, "x"
    )
    drawn = [choose(scenario, Egos(random=1, seed=seed)) for seed in range(8)]
    assert set(drawn) == {("ego",), ("other",)}
    assert [choose(scenario, Egos(random=1, seed=seed)) for seed in range(8)] == drawn
    assert choose(scenario, Egos(ids=("other",))) == ("other",)


MEASURED = """
import sys
import libsumo
from sumo_mcts import config
from sumo_mcts.episode.loop import Loop
for ego in ("ego", "other"):
    scene = config.build({"name": "x", "sumo": {"sumocfg": sys.argv[1]}, "egos": [{"id": ego}]}, "x")
    loop = Loop(scene, None, measured=sys.argv[2:])
    loop.start()
    loop.scenes()
    print(libsumo.vehicle.getParameter(ego, "has.ssm.device"))
    loop.close()
"""


@pytest.mark.parametrize(
    ("measured", "found"), [((), ["true", "false"]), (("ego", "other"), ["true", "true"])]
)
def test_sumo_measures_whom_it_was_told_first_in_a_process(
    measured: tuple[str, ...], found: list[str]
) -> None:
    """So every episode of a batch names the egos of all; should the first row ever be true, true,
    that is not needed any more."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, str(GOOD), *measured],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == found


def test_wrong_input_that_only_sumo_knows(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as refused:
        run_batch(write(tmp_path, network("[ego, nobody]")), tmp_path / "out", jobs=1)
    assert (
        str(refused.value)
        == f"{tmp_path / 'small.yaml'}: scenarios: good: egos: nobody: no such vehicle departs "
        "within 3600 s; the first that do: ego, other"
    )
    assert not (tmp_path / "out").exists()
    scenario = config.build(
        {"name": "x", "sumo": {"sumocfg": str(GOOD)}, "egos": [{"id": "any"}]}, "x"
    )
    with pytest.raises(
        ConfigError, match="egos: random: asks for 3, 2 suitable vehicles depart within 3600 s"
    ):
        choose(scenario, Egos(random=3))
    for wrong, said in (
        ("sumo.options={warp-speed: 9}", "SUMO does not start"),
        ("egos=[{id: ego, until: nowhere}]", "the network has no edge nowhere"),
    ):
        assert said in rehearse(
            config.load(builtin.scenario_path("highway-exit"), ("planner.name=constant", wrong)), 0
        )
    assert (
        rehearse(config.load(builtin.scenario_path("highway-exit"), ("planner.name=constant",)), 0)
        == ""
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            SMALL + "set: {sumo.options: {warp-speed: 9}}\n",
            "scenarios: unprotected-left-turn: SUMO does not start: ",
        ),
        (
            SMALL + "set: {episode.success_edge: nowhere}\n",
            (
                "scenarios: unprotected-left-turn: episode.success_edge: the network has no edge "
                "nowhere; among"
            ),
        ),
        (
            SMALL.replace(
                "variants: {",
                "variants: {bad: {planner.name: constant, episode.success_edge: nowhere}, ",
            ).replace("twins: true", ""),
            "scenarios: unprotected-left-turn: episode.success_edge: the network",
        ),
        (
            SMALL.replace(
                "highway-exit", "{scenario: highway-exit, set: {egos: [{id: ego, until: nowhere}]}}"
            ),
            "scenarios: highway-exit: egos: ego: until: the",
        ),
        (
            SMALL.replace("highway-exit", "{scenario: highway-exit, set: {egos: [{id: nobody}]}}"),
            "scenarios: highway-exit: egos: nobody: no file of the simul",
        ),
        (
            SMALL.replace(", highway-exit", "") + "set: {episode.success_edge: to_south}\n",
            "episode.success_edge: the route of ego does not pass edge to_south",
        ),
        (
            network("[ego]", ", until: to_nort"),
            (
                "scenarios: good: egos: any: until: the network has no edge to_nort; among its 8 "
                "edges: to_north"
            ),
        ),
        (
            network("[ego]", ", until: to_south"),
            "scenarios: good: egos: ego: until: its route does not pass edge to_south",
        ),
        (
            network("{random: 1}", ", until: to_south"),
            (
                "scenarios: good: egos: random: asks for 1, 0 suitable vehicles depart within 3600 s "
                "and pass edge to_south"
            ),
        ),
    ],
)
def test_a_dry_run_refuses_what_cannot_be(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as refused:
        listed(write(tmp_path, text), tmp_path / "out")
    assert said in str(refused.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("refused", "said"),
    [
        (
            "planner.options: {number: 2}",
            (
                "planner.name: helpers_batch:Picky: does not take planner.options {'number': 2}: "
                "ValueError: number: 1 and nothing else"
            ),
        ),
        ("cost.term: 'helpers_batch:rate'", "cost.term: helpers_batch:rate: cannot be compiled: "),
    ],
)
def test_what_a_plugin_refuses_in_a_later_variant(refused: str, said: str, tmp_path: Path) -> None:
    """Both variants have the same planner and predictor; one of them is fine."""
    picky = "planner.name: 'helpers_batch:Picky', planner.options: {number: 1}"
    text = (
        f"name: x\nscenarios: [highway-exit]\nset: {{{picky}}}\nvariants: {{good: {{}}, bad: "
        f"{{{refused}}}}}\n"
    )
    with pytest.raises(ConfigError) as problem:
        run_batch(write(tmp_path, text), tmp_path / "out", jobs=1, allow_plugins=True)
    assert str(problem.value).startswith(
        f"{tmp_path / 'small.yaml'}: scenarios: highway-exit: {said}"
    )
    assert not (tmp_path / "out").exists()


def test_what_makes_no_difference_to_the_start_is_rehearsed_once(tmp_path: Path) -> None:
    text = (
        "name: x\nscenarios: [highway-exit]\nvariants: {a: {}, b: {planner.iterations: 7}, c: "
        "{cost.jerk: 1.0}, d: {sensor.range_m: 50}}\n"
    )
    kinds = {
        variant: _kind(config)
        for variant, config in load(write(tmp_path, text)).cases[0].configs.items()
    }
    assert kinds["a"] == kinds["b"] == kinds["c"] != kinds["d"]


# --- the command ---


@pytest.fixture
def command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Iterator[Command]:
    """sumo-mcts batch in this process: its status, and what it prints."""
    before = signal.getsignal(signal.SIGINT)

    def run(*words: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["sumo-mcts", "batch", *words])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return int(end.value.code or 0), *capsys.readouterr()

    yield run
    signal.signal(signal.SIGINT, before)


def test_a_dry_run_lists_and_writes_nothing(
    whole: Reference, command: Command, tmp_path: Path
) -> None:
    small, out = begun(whole, tmp_path)
    records.append_row(out, whole[1][3])
    before = {path: path.read_bytes() for path in out.iterdir()}
    status, printed, told = command(str(small), "--out", str(out), "--dry-run")
    assert (status, told) == (0, "")
    lines = [f"{'done ' if k == 3 else 'to do'}  {row['key']}" for k, row in enumerate(whole[1])]
    assert printed.splitlines() == [*lines, "8 rows, 1 done, 7 to do"]
    assert {path: path.read_bytes() for path in out.iterdir()} == before
    assert (
        command(str(small), "--out", str(tmp_path / "none"), "--dry-run", "--shard", "2/2")[0] == 0
    )
    assert not (tmp_path / "none").exists()
    status, printed, _ = command(str(small), "--dry-run")
    assert status == 0 and printed.splitlines()[-1] == "8 rows, 0 done, 8 to do"


def test_a_row_with_an_error_is_status_1(
    whole: Reference, command: Command, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    shutil.copytree(whole[0], out)
    rows = [
        {**row, "outcome": "error", "error": "a reason"} if k == 2 else row
        for k, row in enumerate(whole[1])
    ]
    (out / records.ROWS).write_text("".join(json.dumps(row) + "\n" for row in rows))
    status, printed, told = command(str(write(tmp_path)), "--out", str(out))
    assert status == 1
    assert printed.splitlines()[-1] == f"{out}: 8 rows"
    assert (
        told.splitlines()[-1]
        == f"error: 1 of 8 rows have outcome error, the first: {rows[2]['key']}: a reason"
    )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ("nowhere", "--out", "{out}"),
            "nowhere: no such experiment; give a .yaml, or one of: ablation",
        ),
        (("quick",), "--out: a folder for rows and traces has to be given"),
        (
            ("quick", "--out", "{out}", "--shard", "3/2"),
            "--shard 3/2: i/n with i from 1 to n, as in 2/8",
        ),
        (("quick", "--out", "{out}", "--shard", "half"), "--shard half: i/n"),
        (("quick", "--out", "{out}", "--jobs", "0"), "'--jobs'"),
        (("quick", "--out", "{out}/file/further"), "file is a file, not a folder"),
        (
            ("small.yaml", "--out", "{whole}", "--scheduler", "tcp://127.0.0.1:9"),
            "--scheduler tcp://127.0.0.1:9: no scheduler answers",
        ),
    ],
)
def test_wrong_usage(
    words: tuple[str, ...],
    said: str,
    whole: Reference,
    command: Command,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(write(tmp_path).parent)
    monkeypatch.setattr(workers, "ANSWER_S", 0.5)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "file").touch()
    status, printed, told = command(
        *(word.format(out=tmp_path / "out", whole=whole[0]) for word in words)
    )
    assert (status, printed) == (2, "")
    (line,) = told.splitlines()
    assert said in line


ORPHAN = """
import sys, time
from sumo_mcts.experiments.workers import LocalPool
if __name__ == "__main__":
    pool = LocalPool(1)
    pool.submit(abs, 1).result()
    print(*pool.pids(), flush=True)
    pool.submit(time.sleep, 60).result()
"""


@pytest.mark.skipif(
    sys.platform != "linux", reason="elsewhere a worker notices when its task is done"
)
def test_a_worker_at_work_does_not_outlive_a_parent_that_is_killed(tmp_path: Path) -> None:
    (tmp_path / "parent.py").write_text(ORPHAN)
    with subprocess.Popen(
        [sys.executable, tmp_path / "parent.py"], stdout=subprocess.PIPE, text=True
    ) as parent:
        assert parent.stdout is not None
        worker = Path("/proc") / parent.stdout.readline().strip()
        assert worker.exists()
        time.sleep(0.2)  # until it sleeps
        parent.kill()
    end = time.monotonic() + 5.0
    while worker.exists() and "\nState:\tZ" not in (worker / "status").read_text():
        assert time.monotonic() < end, "still there"
        time.sleep(0.05)
