"""The folder of a batch: one batch at a time, in one state of it, and what --fresh removes."""

import hashlib
import json
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest
from helpers_batch import (
    GOOD,
    NET,
    SMALL,
    Reference,
    begun,
    network,
    write,
)

from sumo_mcts import records, run_batch
from sumo_mcts.config import plugins
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments import folder
from sumo_mcts.experiments.batch import listed
from sumo_mcts.experiments.experiment import DECIDING, load
from sumo_mcts.experiments.progress import Progress

WANTED: dict[str, Any] = {
    "experiment": {"name": "x"}, "experiment_digest": "d", "shard": "1/1",
    "versions": dict.fromkeys(DECIDING, "1"), "plugins": [], "files": {}, "egos": {},
}  # fmt: skip


def test_what_a_batch_wrote_goes_on(tmp_path: Path) -> None:
    records.write_manifest(tmp_path, WANTED)
    found = folder.begun(tmp_path, WANTED)
    assert found is not None
    assert found["experiment_digest"] == "d"


@pytest.mark.parametrize("key", WANTED)
@pytest.mark.parametrize("value", [None, 3, [3], "text", {"a": []}])
def test_a_damaged_manifest_is_told_by_its_key(key: str, value: object, tmp_path: Path) -> None:
    """Or is that of another batch, or allows the same."""
    records.write_manifest(tmp_path, {**WANTED, key: value})
    try:
        folder.begun(tmp_path, WANTED)
    except ConfigError as error:
        said = str(error)
        assert said.startswith(f"--out {tmp_path}: ")
    else:
        assert isinstance(value, type(WANTED[key]))


@pytest.mark.parametrize("key", [key for key in WANTED if key != "experiment_digest"])
def test_a_manifest_without_a_key_is_told(key: str, tmp_path: Path) -> None:
    records.write_manifest(tmp_path, {name: value for name, value in WANTED.items() if name != key})
    if key == "files":  # which earlier versions did not write
        assert folder.begun(tmp_path, WANTED) is not None
    else:
        with pytest.raises(ConfigError, match=f"manifest.json: {key}: is not what a batch writes"):
            folder.begun(tmp_path, WANTED)


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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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
