"""A batch leaves the rows that single episodes would, none lost and none twice; and its command."""

import json
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pytest
from helpers_batch import (
    Reference,
    begun,
    driven_alone,
    network,
    on_disk,
    timeless,
    write,
)

from sumo_mcts import cli, records, run_batch
from sumo_mcts.config import digest
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments import workers
from sumo_mcts.experiments.batch import listed
from sumo_mcts.experiments.experiment import TRAFFIC, episodes, load
from sumo_mcts.experiments.progress import Progress
from sumo_mcts.experiments.tasks import failed
from sumo_mcts.records.highlights import TraceSelection
from sumo_mcts.records.statistics import Pair, pairs
from sumo_mcts.reporting.results import gather

Command = Callable[..., tuple[int, str, str]]


# --- undisturbed ---


@pytest.mark.slow
def test_rows_are_those_of_single_episodes(whole: Reference) -> None:
    _, rows = whole
    assert [row["key"] for row in rows[:4]] == [
        f"{scene}--{v}--0"
        for scene in ("unprotected-left-turn", "highway-exit")
        for v in ("constant", "sumo")
    ]
    # in a process of its own: SUMO measures surrogates for the first ego of a process only
    with ProcessPoolExecutor(1, get_context("spawn")) as process:
        alone = list(process.map(driven_alone, rows))
    assert timeless(rows) == timeless(alone)


@pytest.mark.slow
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
    worth = TraceSelection("worth")
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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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
