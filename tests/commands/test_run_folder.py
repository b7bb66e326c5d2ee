"""Many runs into one folder: each under a key of its own, none lost, none mixed, whatever
interrupts them."""

import csv
import errno
import json
import os
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from helpers_rows import made_row
from helpers_trace import crossing_trace
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from sumo_mcts import records
from sumo_mcts.cli import app
from sumo_mcts.commands import report, run_folder, run_key
from sumo_mcts.config import ScenarioConfig, builtin
from sumo_mcts.episode.run import EpisodeResult
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments.folder import only_here
from sumo_mcts.records.rows import LONGEST_LINE
from sumo_mcts.records.statistics import place
from sumo_mcts.scenarios import load_scenario

LINE = "straight-line"
SUMO = ("--planner", "sumo", "--no-pictures")  # quick: nothing is searched, nothing is drawn


class Answer(NamedTuple):
    status: int
    out: str
    err: str


def run(*words: object) -> Answer:
    """sumo-mcts run."""
    result = CliRunner().invoke(app, ["run", *map(str, words)])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return Answer(result.exit_code, result.stdout, result.stderr)


def keys_of(folder: Path) -> list[str]:
    return [row["key"] for row in records.read_rows(folder)]


def made(key_seed: int = 0, identity: str = "a" * 64, **known: Any) -> EpisodeResult:
    """What a run leaves, without running."""
    row = made_row(seed=key_seed, config_digest="c", trace_digest="t", **known)
    trace = crossing_trace()._replace(key=row["key"], scenario=row["scenario"])
    return EpisodeResult(
        (row,), (trace._replace(cycles=trace.cycles[:2]),), {"identity": identity, "seed": key_seed}
    )


# --- keys ---


def variant(*sets: str, options: tuple[str, ...] = ()) -> str:
    own = load_scenario(LINE)
    return run_key.variant_of(load_scenario(LINE, *sets), own, options)


def test_a_built_in_scenario_as_it_is_keeps_its_plain_key() -> None:
    assert variant() == "mcts-idm-1000"
    assert (
        variant("planner.iterations=50", "prediction.name=constant_velocity")
        == "mcts-constant_velocity-50"
    )
    assert variant("planner.time_budget_ms=20") == "mcts-idm-20ms"
    assert variant("planner.name=sumo") == "sumo"
    assert variant("cost.headway_s=1.2", "description=other words") == "mcts-idm-1000", (
        "that is what it was"
    )


def test_what_was_set_is_read_in_the_key_and_a_digest_stands_for_what_is_no_word() -> None:
    assert variant("cost.headway_s=2.0") == "mcts-idm-1000-cost.headway_s-2.0"
    assert (
        variant("failsafe.on=true", "planner.reactive=3")
        == "mcts-idm-1000-planner.reactive-3-failsafe.on-true"
    )
    assert re.fullmatch(
        r"mcts-idm-1000-planner\.accelerations_mps2\.[0-9a-f]{8}",
        variant("planner.accelerations_mps2=[-1, 0, 1]"),
    )
    assert re.fullmatch(
        r"mcts-idm-1000-options\.[0-9a-f]{8}", variant(options=("--step-length", "0.2"))
    )
    assert variant(options=("--step-length", "0.2")) != variant(options=("--step-length", "0.5"))
    assert variant("egos=[{id: ego, until: beyond}]") == "mcts-idm-1000-until-beyond"


def test_a_time_limit_is_one_setting_in_the_key_and_holds_in_a_scene_with_one_of_its_own(
    tmp_path: Path,
) -> None:
    for scene in (LINE, f"{LINE}-scripted"):  # the second ends after 20 s, its own limit
        assert run(scene, *SUMO, "--time-limit", 2, "--quiet", "--out", tmp_path).status == 0
    rows = records.read_rows(tmp_path)
    assert [row["key"] for row in rows] == [
        f"{LINE}--sumo-episode.stop_time_s-2.0--0",
        f"{LINE}-scripted--sumo-episode.stop_time_s-2.0--0",
    ]
    assert [row["outcome"] for row in rows] == ["timeout", "timeout"]
    assert all(row["cycles"] <= 5 for row in rows)


CHOICES = {
    "cost.headway_s": ("1.2", "2.0", "2", "0.5"), "planner.iterations": ("1000", "50"),
    "planner.name": ("mcts", "sumo"), "failsafe.on": ("true", "false"),
    "planner.accelerations_mps2": ("[-1, 1]", "[-1, 1, 2]"),
    "episode.success_edge": ("a-b", "a", "null"), "sumo.step_length_s": ("0.1", "0.5"),
    "sumo.options": ("{a: 1}", "{a: 2}", "{}"), "traffic.vary": ("0", "1"),
    "planner.most_iterations": ("null", "5000"),
}  # fmt: skip
ASKED = st.fixed_dictionaries(
    {}, optional={key: st.sampled_from(values) for key, values in CHOICES.items()}
)


@pytest.mark.slow
@given(one=ASKED, other=ASKED)
@settings(max_examples=60, deadline=None)
def test_what_differs_has_another_name(one: dict[str, str], other: dict[str, str]) -> None:
    own = load_scenario(LINE)
    both = [
        load_scenario(LINE, *(f"{key}={value}" for key, value in sets.items()))
        for sets in (one, other)
    ]
    names = [run_key.variant_of(each, own) for each in both]
    assert (names[0] == names[1]) == (both[0] == both[1])


def test_the_ego_is_told_unless_it_is_the_only_possible_one(tmp_path: Path) -> None:
    own = load_scenario(LINE)
    assert not run_key.is_named(own, own)
    assert run_key.is_named(load_scenario(LINE, ego="other"), own)
    assert run_key.is_named(load_scenario(LINE, ego=["ego", "other"]), own)
    net = ScenarioConfig.model_validate(
        {"name": "n", "sumo": {"sumocfg": "n.sumocfg"}, "egos": [{"id": "a"}]}
    )
    assert run_key.is_named(net, net)


# --- runs ---


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four different runs, and one of them again."""
    out = tmp_path_factory.mktemp("runs") / "out"
    for more in (
        (),
        ("--set", "traffic.vary=0"),
        ("--seed", 1),
        ("--set", "traffic.vary=0", "--", "--default.speeddev", "0.2"),
    ):
        assert run("straight-line-varied", "--out", out, *SUMO, *more).status == 0
    again = run("straight-line-varied", "--out", out, *SUMO, "--seed", 0)
    assert (
        again.err.splitlines()[-1]
        == f"{out}: straight-line-varied--sumo--0: its earlier row is replaced"
    )
    return out


@pytest.mark.slow
def test_each_run_has_a_row_a_trace_and_a_manifest_of_its_own(folder: Path) -> None:
    keys = keys_of(folder)
    assert keys[:3] == [
        "straight-line-varied--sumo--0",
        "straight-line-varied--sumo-traffic.vary-0.0--0",
        "straight-line-varied--sumo--1",
    ]
    assert len(set(keys)) == len(keys) == 4
    assert len((folder / records.TABLE).read_text().splitlines()) == 5
    assert sorted(path.stem for path in (folder / records.TRACES).iterdir()) == sorted(keys)
    assert not (folder / records.FIGURES).exists()
    told = {key: records.read_manifest_of(folder, key) for key in keys}
    assert [told[key]["scenario"]["traffic"]["vary"] for key in keys] == [2.0, 0.0, 2.0, 0.0]
    assert told[keys[3]]["sumo_options"] == ["--default.speeddev", "0.2"]
    assert len({json.dumps(each) for each in told.values()}) == 4
    assert (
        len(
            report.report([folder], folder / "r", (), lambda text: None).document["tables"][
                "outcomes"
            ]["rows"]
        )
        == 3
    )


@pytest.mark.slow
def test_scenario_files_of_one_name_are_told_apart_by_what_is_in_them(tmp_path: Path) -> None:
    text = (
        builtin.scenario_path("straight-line")
        .read_text(encoding="utf-8")
        .replace("../", f"{builtin.root()}/")
    )
    out, files = tmp_path / "out", [tmp_path / "a.yaml", tmp_path / "b.yaml"]
    files[0].write_text(text)
    files[1].write_text(text + "\ncost: {headway_s: 2.0}\n")
    for file in (*files, *files):
        answer = run(file, "--out", out, *SUMO)
        assert answer.status == 0, answer
    first, second = keys_of(out)
    assert first == "straight-line--sumo--0"
    assert re.fullmatch(r"straight-line\.[0-9a-f]{8}--sumo--0", second)
    run(files[1], "--out", out, "--planner", "constant", "--no-pictures")
    assert keys_of(out)[2] == second.replace("--sumo--", "--constant--"), (
        "all of a scenario's rows have its name"
    )
    assert [row["scenario"] for row in records.read_rows(out)][:2] == [
        first.partition("--")[0],
        second.partition("--")[0],
    ]
    assert records.load_trace(out / records.TRACES / f"{second}.npz").key == second
    assert f"this one is kept as {second.partition('--')[0]}" in answer.err
    assert "its earlier row is replaced" in answer.err


def test_an_interrupt_while_pictures_are_drawn_leaves_the_rest_and_the_result_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("sumo_mcts.reporting.storyboard.storyboard", interrupted)
    result = CliRunner().invoke(app, ["run", LINE, "--planner", "sumo", "--out", str(tmp_path)])
    assert "outcome      arrived" in result.stdout
    assert keys_of(tmp_path) == ["straight-line--sumo--0"]
    assert records.load_trace(tmp_path / records.TRACES / "straight-line--sumo--0.npz").cycles


# --- the folder ---


def test_runs_at_the_same_time_lose_nothing(tmp_path: Path) -> None:
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda seed: run_folder.keep(made(seed), tmp_path, ()), range(4)))
    keys = [made_row(seed=seed)["key"] for seed in range(4)]
    assert sorted(keys_of(tmp_path)) == sorted(keys)
    assert len((tmp_path / records.TABLE).read_text().splitlines()) == 5
    assert sorted(path.stem for path in (tmp_path / records.MANIFESTS).iterdir()) == sorted(keys)


def test_who_does_not_get_into_the_folder_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_folder, "PATIENCE_S", 0.1)
    with (
        only_here(tmp_path),
        pytest.raises(ConfigError, match="another run or batch is at work there"),
    ):
        run_folder.keep(made(), tmp_path, ())
    run_folder.keep(made(), tmp_path, ())


def test_a_row_is_replaced_in_its_place_and_all_other_lines_stay_as_they_were(
    tmp_path: Path,
) -> None:
    for seed in range(3):
        run_folder.keep(made(seed), tmp_path, ())
    path = tmp_path / records.ROWS
    lines = path.read_bytes().splitlines(keepends=True)
    odd = [
        b'{"of": "another version"}\n',
        b"[" * (LONGEST_LINE + 10) + b"\n",
        b'{"key": "to\xff',
    ]
    path.write_bytes(b"".join([*lines[:2], *odd[:2], lines[2], lines[1], odd[2]]))
    kept = run_folder.keep(made(1, outcome="collision", travel_time_s=None), tmp_path, ())
    now = path.read_bytes().splitlines(keepends=True)
    assert [now[0], *now[2:]] == [lines[0], *odd[:2], lines[2], odd[2]]
    assert json.loads(now[1])["outcome"] == "collision"
    assert kept.remarks == (f"{tmp_path}: {made_row(seed=1)['key']}: its earlier row is replaced",)


def test_what_an_earlier_folder_does_not_tell_is_told_by_its_rows(tmp_path: Path) -> None:
    """Before there were manifests for each key."""
    records.append_row(tmp_path, made().rows[0])
    records.append_row(tmp_path, {**made(1).rows[0], "config_digest": "another"})
    assert run_folder.keep(made(0), tmp_path, ()).result.rows[0]["scenario"] == "left"
    assert run_folder.keep(made(1), tmp_path, ()).result.rows[0]["scenario"] == "left.aaaaaaaa"
    assert len(keys_of(tmp_path)) == 3


def test_pictures_of_another_drive_go_and_those_of_the_same_stay(tmp_path: Path) -> None:
    run_folder.keep(made(), tmp_path, ())
    key = made().rows[0]["key"]
    pictures = [tmp_path / records.FIGURES / f"{key}{end}" for end in (".gif", records.MOMENTS)]
    for picture in pictures:
        records.write_whole(picture, b"drawn")
    run_folder.keep(made(), tmp_path, ())
    assert all(picture.exists() for picture in pictures)
    other = made()
    run_folder.keep(
        other._replace(rows=({**other.rows[0], "trace_digest": "u"},), traces=()), tmp_path, ()
    )
    assert not any(picture.exists() for picture in pictures)
    assert list((tmp_path / records.TRACES).iterdir()) == [], (
        "a drive without a decision leaves no trace, and none of an earlier one"
    )


@pytest.mark.parametrize("at", range(1, 7))
def test_on_a_full_disk_the_file_is_named_and_what_was_there_stays(
    at: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_folder.keep(made(), tmp_path, ())
    before, count, fsync = (tmp_path / records.ROWS).read_bytes(), 0, os.fsync

    def full(number: int) -> None:
        nonlocal count
        count += 1
        if count >= at:
            raise OSError(errno.ENOSPC, "No space left on device")
        fsync(number)

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space") as caught:
        run_folder.keep(made(1), tmp_path, ())
    assert str(caught.value.filename).startswith(str(tmp_path))
    now = (tmp_path / records.ROWS).read_bytes()
    assert now.startswith(before)
    assert records.rows_and_torn(tmp_path)[1] == 0
    assert list(tmp_path.rglob("*.tmp")) == []


@pytest.mark.parametrize(
    "name",
    [
        records.ROWS,
        records.TABLE,
        records.MANIFEST,
        records.TRACES,
        records.MAPS,
        records.MANIFESTS,
        records.FIGURES,
    ],
)
def test_a_folder_that_cannot_take_the_results_is_told_before_the_run(
    name: str, tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / name)
    answer = run(LINE, "--out", tmp_path)
    assert (answer.status, answer.out) == (2, "")
    assert answer.err.startswith(f"error: --out {tmp_path}: {name}: is not a f")


def test_cells_of_a_table_are_no_formulas(tmp_path: Path) -> None:
    texts = ["=1+1", "+1", "-1", "@x", "\tx", "\rx", "\nx"]
    records.write_table(
        tmp_path / "t.csv", ("=a", "n"), [{"=a": text, "n": -1.5} for text in texts]
    )
    with (tmp_path / "t.csv").open(newline="", encoding="utf-8") as file:
        assert list(csv.reader(file)) == [
            ["'=a", "n"],
            *(["'" + text.replace("\r", "\n"), "-1.5"] for text in texts),
        ]


NET = """<net version="1.20"><edge id="a" from="x" to="y" priority="1"><lane id="a_0" index="0" speed="{}" length="200" shape="0,0 200,0"/></edge>
<junction id="x" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0 0,-3"/>
<junction id="y" type="dead_end" x="200" y="0" incLanes="a_0" intLanes="" shape="200,0 200,-3"/></net>"""
ROUTES = (
    '<routes><trip id="one" depart="0" from="a" to="a"/><trip id="two" depart="3" from="a" '
    'to="a"/></routes>'
)


def test_egos_and_networks_of_a_user_are_told_apart(tmp_path: Path) -> None:
    """Two egos of a .sumocfg, and another .sumocfg of the same name."""
    for name, speed in (("here", 10), ("there", 20)):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "n.net.xml").write_text(NET.format(speed))
        (folder / "n.rou.xml").write_text(ROUTES)
        (folder / "n.sumocfg").write_text(
            '<configuration><net-file value="n.net.xml"/><route-files '
            'value="n.rou.xml"/></configuration>'
        )
    out = tmp_path / "out"
    for name, ego in (
        ("here", "one"),
        ("here", "two"),
        ("there", "two"),
        ("there", "one"),
        ("here", "one"),
    ):
        answer = run(tmp_path / name / "n.sumocfg", "--ego", ego, "--out", out, *SUMO)
        assert answer.status == 0, answer
    keys = keys_of(out)
    assert keys[:2] == ["n--sumo--own--one", "n--sumo--own--two"]
    assert [re.sub(r"\.[0-9a-f]{8}", ".#", key) for key in keys[2:]] == [
        "n.#--sumo--own--two",
        "n.#--sumo--own--one",
    ]
    assert sorted(path.stem for path in (out / records.TRACES).iterdir()) == sorted(keys)
    assert report.report([out], out / "r", (), lambda text: None).document["episodes"] == 4


@pytest.mark.slow
def test_what_was_driven_in_other_traffic_is_no_pair(folder: Path) -> None:
    places = [place(row) for row in records.read_rows(folder)]
    assert len(set(places)) == 4
