"""The commands that read a folder of results: what they write, what they say, and that SUMO is not
asked."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from helpers_recorded import keep, keep_trace, of_a_scene
from helpers_trace import crossing_trace
from PIL import Image
from typer.testing import CliRunner

from sumo_mcts import config, records
from sumo_mcts.cli import app
from sumo_mcts.config import builtin
from sumo_mcts.episode import run_episode
from sumo_mcts.records import codec
from sumo_mcts.reporting import export

KEY = "unprotected-left-turn--mcts-idm-200--3"
EXPLAIN = Path(__file__).resolve().parents[2] / "docs" / "explain.md"


class Answer(NamedTuple):
    status: int
    out: str
    err: str


def call(*words: object) -> Answer:
    """sumo-mcts, as far as its own errors: wrong usage is click's affair."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return Answer(result.exit_code, result.stdout, result.stderr)


def error_of(*words: object) -> str:
    """The one line of an error."""
    answer = call(*words)
    lines = [line for line in answer.err.splitlines() if not line.endswith(" ...")]
    assert (answer.status, answer.out, len(lines)) == (2, "", 1), answer
    return lines[0].removeprefix("error: ")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as `run --out` leaves it, with one episode."""
    folder = tmp_path_factory.mktemp("recorded")
    keep(folder, run_episode(of_a_scene("unprotected-left-turn"), 3))
    return folder


@pytest.fixture
def several(tmp_path: Path) -> Path:
    """Three recorded episodes of a batch, and a fourth whose trace was not kept."""
    for seed, outcome in ((7, "arrived"), (8, "collision"), (9, "timeout"), (10, "arrived")):
        records.append_row(
            tmp_path,
            {
                "key": f"crossing--mcts--{seed}",
                "scenario": "crossing",
                "variant": "mcts",
                "outcome": outcome,
            },
        )
    for seed in (7, 8, 9):
        trace = crossing_trace()
        keep_trace(tmp_path, trace._replace(key=f"crossing--mcts--{seed}", cycles=trace.cycles[:3]))
    return tmp_path


# --- without SUMO ---

NO_SUMO = """
import importlib.abc, sys

class Nobody(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("libsumo", "sumolib", "sumo", "traci"):
            raise ImportError(f"{name} is asked for")

sys.meta_path.insert(0, Nobody())
from typer.testing import CliRunner
from sumo_mcts.cli import app

folder = sys.argv[1]
for line in ("render", "render --format gif", "render --format mp4", "export", "export --format fcd", "explain --at 2.2 --replan"):
    words = line.split()
    answer = CliRunner().invoke(app, [words[0], folder, *words[1:]])
    assert answer.exit_code == 0, (words, answer.output, answer.exception)
print(answer.stdout)
"""


@pytest.fixture(scope="module")
def without_sumo(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """All commands, where SUMO cannot be imported and the network is not there: the folder, and
    what `explain` said."""
    folder = tmp_path_factory.mktemp("elsewhere")
    for part in (records.TRACES, records.MAPS):
        shutil.copytree(recorded / part, folder / part)
    trace = records.load_trace(folder / records.TRACES / f"{KEY}.npz")
    scenario = json.loads(trace.setting.config)
    scenario["sumo"]["net"] = "/nowhere/gone.net.xml"
    setting = trace.setting._replace(config=json.dumps(scenario))
    keep_trace(folder, trace._replace(setting=setting, cycles=trace.cycles[:5]))
    done = subprocess.run(
        [sys.executable, "-c", NO_SUMO, folder], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return folder, done.stdout


@pytest.mark.slow
def test_everything_works_without_sumo_and_without_the_network(
    without_sumo: tuple[Path, str],
) -> None:
    folder, said = without_sumo
    assert said.rstrip().endswith("taken again with the same settings: the identical decision")
    written = sorted(
        path.relative_to(folder).as_posix()
        for path in (*(folder / "figures").iterdir(), *(folder / "exports").iterdir())
    )
    assert written == sorted(
        [
            *(f"figures/{KEY}.{suffix}" for suffix in ("png", "gif", "mp4")),
            *(f"exports/{KEY}{suffix}" for suffix in (".csv", ".fcd.xml")),
        ]
    )


@pytest.mark.slow
def test_the_pictures_are_pictures_of_the_episode(without_sumo: tuple[Path, str]) -> None:
    folder, _ = without_sumo
    with Image.open(folder / "figures" / f"{KEY}.png") as image:
        assert (image.format, image.width > 1000) == ("PNG", True)
    with Image.open(folder / "figures" / f"{KEY}.gif") as image:
        assert (image.format, image.n_frames) == (
            "GIF",
            21,
        )  # ten a second, from the first decision to the fifth


@pytest.mark.slow
def test_plain_python_takes_the_identical_decision(recorded: Path) -> None:
    words = [sys.executable, "-m", "sumo_mcts", "explain", recorded, "--at", "6", "--replan"]
    done = subprocess.run(
        words,
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
    )
    assert done.stdout.endswith("taken again with the same settings: the identical decision\n")


# --- which episode, which format, which file ---


def test_several_episodes_are_listed(several: Path) -> None:
    for words in (("render",), ("export",), ("explain", "--at", "1")):
        answer = call(words[0], several, *words[1:])
        assert answer.status == 0
        assert re.findall(r"^  (\S+) +(\S+)$", answer.out, re.MULTILINE) == [
            ("crossing--mcts--7", "arrived"), ("crossing--mcts--8", "collision"),
            ("crossing--mcts--9", "timeout")
        ]  # fmt: skip
    listed = json.loads(call("explain", several, "--at", "1", "--json").out)
    assert listed[1] == {"key": "crossing--mcts--8", "outcome": "collision"}
    assert not (several / "figures").exists()


def test_an_episode_is_chosen_and_a_file_is_named(several: Path) -> None:
    answer = call(
        "render", several, "--episode", "crossing--mcts--8", "--out", several / "new" / "mine.gif"
    )
    assert (answer.status, answer.out) == (0, f"{several / 'new' / 'mine.gif'}\n")
    assert "drawing the film ..." in answer.err
    with Image.open(several / "new" / "mine.gif") as image:
        assert image.n_frames == 11
    quiet = call("render", several, "--episode", "crossing--mcts--8", "--quiet")
    assert quiet == (0, "", "")
    assert (several / "figures" / "crossing--mcts--8.png").is_file()


def test_moments_are_drawn_beside_each_other(several: Path) -> None:
    """Without the map too, which has the signals."""
    words = ("render", several, "--episode", "crossing--mcts--8", "--moments", "0.75,0")
    sizes = {}
    for views in ("above", "chase", "above,chase", None):
        path = several / "figures" / "crossing--mcts--8--moments.png"
        answer = call(*words, *(() if views is None else ("--views", views)))
        assert (answer.status, answer.out) == (0, f"{path}\n")
        with Image.open(path) as image:
            sizes[views] = image.size
    assert sizes[None] == sizes["above,chase"]
    assert len({width for width, _ in sizes.values()}) == 1
    assert sizes[None][1] > sizes["above"][1] > sizes["chase"][1]


def test_the_head_line_tells_how_long_the_ego_stood(several: Path) -> None:
    words = ("explain", several, "--episode", "crossing--mcts--7", "--at", "0.7")
    head = call(*words).out.splitlines()[0]
    assert "stood" not in head  # nothing is known of it
    row = {
        "key": "crossing--mcts--7",
        "scenario": "crossing",
        "variant": "mcts",
        "outcome": "arrived",
    }
    known = {"stopped_s": 41.25, "longest_stop_s": 30.0, "stopped_at_green_s": 0.0}
    records.append_row(several, {**row, **known})
    assert call(*words).out.splitlines()[0] == (
        f"{head}; the ego stood 41.2 s in all, 30.0 s at a stretch, 0.0 s at green"
    )
    assert json.loads(call(*words, "--json").out)["stood"] == known
    records.append_row(several, {**row, **known, "longest_stop_s": -1.0, "stopped_s": "long"})
    assert call(*words).out.splitlines()[0] == f"{head}; the ego stood 0.0 s at green"


def test_a_trace_that_tells_less_is_explained_as_far_as_it_goes(several: Path) -> None:
    answer = call("explain", several, "--episode", "crossing--mcts--7", "--at", "0.7")
    assert answer.status == 0
    assert "decision 2 of 3, at 0.5 s; planner unknown" in answer.out
    assert "--replan: the trace does not hold the scenario" in error_of(
        "explain", several, "--episode", "crossing--mcts--7", "--at", "0", "--replan"
    )


# --- what can be wrong ---


@pytest.mark.slow
def test_wrong_words_are_told_in_one_line(recorded: Path, several: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    wrong = {
        (
            "render",
            tmp_path / "none",
        ): "none: no such folder; allowed: what --out of `run` or `batch` named",
        (
            "render",
            tmp_path / "empty",
        ): "empty: no recorded episode: traces/*.npz is what `run --out` and `batch --out` leave",
        (
            "render",
            several,
            "--episode",
            "crossing--mtcs--8",
        ): "no such episode; close to it: crossing--mcts--8, ",
        (
            "render",
            several,
            "--episode",
            "xyz",
        ): "--episode xyz: no such episode; close to it: crossing--mcts--7, ",
        (
            "render",
            several,
            "--episode",
            "crossing--mcts--10",
        ): "it was run, but its trace was not kept; an experiment keeps all of them with traces: "
        "all",
        ("render", recorded, "--format", "webm"): "--format webm: allowed: png, gif, mp4",
        ("render", recorded, "--moments", "2,x"): "--moments 2,x: allowed: times in s, as 2,4,6",
        ("render", recorded, "--moments", ""): "--moments : allowed: times in s, as 2,4,6",
        ("render", recorded, "--moments", "nan"): "--moments nan: allowed: times in s, as 2,4,6",
        ("render", recorded, "--moments", "1,2,3,4,5,6,7"): "7 moments; allowed: at most 6",
        ("render", recorded, "--moments", "2,99"): f"--moments: 99; {KEY} has decisions from 0.1 s",
        ("render", recorded, "--moments", "0"): f"--moments: 0; {KEY} has decisions from 0.1 s",
        (
            "render",
            recorded,
            "--moments",
            "2",
            "--views",
            "above,front",
        ): "--views above,front: 'front'; allowed: above, chase",
        ("render", recorded, "--views", "above"): "--views above: of which moments? Give --moments",
        ("render", recorded, "--moments", "2", "--format", "gif"): "--format gif: allowed: png",
        (
            "render",
            recorded,
            "--moments",
            "2",
            "--out",
            "x.gif",
        ): "--out x.gif: what is to be written? Give a name that ends in .png",
        ("export", recorded, "--format", "png"): "--format png: allowed: csv, fcd",
        (
            "render",
            recorded,
            "--out",
            "film.webm",
        ): "--out film.webm: what is to be written? Give --format, or a name that ends in .png, "
        ".gif, .mp4",
        (
            "render",
            recorded,
            "--format",
            "gif",
            "--out",
            "a.png",
        ): "--format gif: the name of --out a.png says png",
        (
            "export",
            recorded,
            "--out",
            "a.xml",
        ): "Give --format, or a name that ends in .csv, .fcd.xml",
        (
            "export",
            several,
            "--episode",
            "crossing--mcts--8",
        ): "no such file; crossing--mcts--8 refers to its lanes by the numbers that they have "
        "there",
        ("explain", recorded): f"--at: not given; {KEY} was driven from 0.1 s to 18.1 s",
        ("explain", recorded, "--at", "18.2"): f"--at: 18.2; {KEY} was driven from 0.1 s to 18.1 s",
        ("explain", recorded, "--at", "nan"): "--at: nan; ",
        ("explain", recorded, "--at", "0"): "--at: 0; ",
        (
            "explain",
            recorded,
            "--at",
            "6",
            "--set",
            "planner",
        ): "--set planner: write it as key.subkey=value",
        (
            "explain",
            recorded,
            "--at",
            "6",
            "--set",
            "planner.iteration=3",
        ): "planner.iteration: unknown key; allowed: name, iterations, ",
        (
            "explain",
            recorded,
            "--at",
            "6",
            "--set",
            "planer.iterations=3",
        ): "planer: unknown key; allowed: name, ",
        **{
            (
                "explain",
                recorded,
                "--at",
                "6",
                "--set",
                key,
            ): f"--set {key}: a recorded decision does not depend on it; it reads the sections "
            "planner, "
            for key in (
                "traffic.vary=0",
                "sumo.step_length_s=0.2",
                "episode.time_limit_s=9",
                "sensor.range_m=1",
                "egos=[{id: other}]",
                "description=x",
            )
        },
        (
            "explain",
            recorded,
            "--at",
            "6",
            "--set",
            "prediction.name=routes",
        ): "routes is an oracle that this episode did not ask",
    }
    for words, message in wrong.items():
        assert message in error_of(*words), words


def test_the_moment_may_be_anywhere_in_the_episode(recorded: Path) -> None:
    for at, number in (("0.1", 1), ("0.59", 1), ("0.6", 2), ("18.1", 36)):
        assert json.loads(call("explain", recorded, "--at", at, "--json").out)["cycle"] == number


@pytest.mark.parametrize(
    "damaged",
    [
        "{",
        "3",
        "{}",
        '{"planner": {"name": "mcts"}}',
        '{"planner": 1, "prediction": 2}',
        "[" * 99_999,
        "PERIOD",
    ],
)
def test_a_scenario_in_a_trace_that_is_none_is_told(damaged: str, several: Path) -> None:
    text = (
        '{"planner": {"name": "mcts", "period_s": "soon"}, "prediction": {"name": "idm"}}'
        if damaged == "PERIOD"
        else damaged
    )
    path = several / records.TRACES / "crossing--mcts--7.npz"
    trace = records.load_trace(path)
    keep_trace(several, trace._replace(setting=trace.setting._replace(config=text)))
    for more in ((), ("--at", "1"), ("--at", "1", "--replan")):
        assert (
            error_of("explain", several, "--episode", "crossing--mcts--7", *more)
            == f"{path}: the scenario in it is not a resolved one"
        )


def test_a_trace_of_another_format_and_a_broken_one_are_told(several: Path) -> None:
    path = several / records.TRACES / "crossing--mcts--7.npz"
    with np.load(path) as archive:
        columns = dict(archive)
    np.savez(path, **{**columns, "format": np.array(2)})
    assert f"written in trace format 2, this version reads 6 and {codec.FORMAT}" in error_of(
        "render", several, "--episode", "crossing--mcts--7"
    )
    path.write_bytes(b"half")
    assert "not a whole trace" in error_of(
        "explain", several, "--episode", "crossing--mcts--7", "--at", "1"
    )


def test_a_broken_map_is_told(recorded: Path, tmp_path: Path) -> None:
    shutil.copytree(recorded, tmp_path / "r")
    (path,) = (tmp_path / "r" / records.MAPS).iterdir()
    path.write_bytes(b"half")
    assert f"{path.name}: not a whole map" in error_of("export", tmp_path / "r")


def test_mp4_without_its_extra_names_it(several: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    message = error_of("render", several, "--episode", "crossing--mcts--7", "--format", "mp4")
    assert (
        message
        == "--format mp4: needs an encoder that is not installed: pip install imageio-ffmpeg; "
        "png and gif need none"
    )


@pytest.mark.parametrize("name", ["f.png", "f.gif", "f.mp4"])
def test_where_nothing_can_be_written_the_file_is_named(several: Path, name: str) -> None:
    (several / "file").write_text("in the way")
    assert "file" in error_of(
        "render", several, "--episode", "crossing--mcts--7", "--out", several / "file" / name
    )


# --- the documentation's example ---


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the page's `run` leaves, but for the pictures."""
    folder = tmp_path_factory.mktemp("page")
    keep(
        folder / "out" / "straight",
        run_episode(config.load(builtin.scenario_path("straight-line-varied")), 1),
    )
    return folder


PAGE = EXPLAIN.read_text(encoding="utf-8")


def test_the_example_is_the_episode_that_the_page_runs() -> None:
    assert "    sumo-mcts run straight-line-varied --seed 1 --out out/straight\n" in PAGE


@pytest.mark.slow
@pytest.mark.parametrize("block", re.findall(r"```text\n\$ (.*?)```", PAGE, re.DOTALL))
def test_the_page_shows_what_the_command_prints(
    block: str, example: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(example)
    command, _, shown = block.partition("\n")
    said = call(*command.removeprefix("sumo-mcts ").split())
    assert said.status == 0
    assert said.out.endswith(shown.removeprefix("...\n\n"))
    assert shown.startswith("...") or said.out == shown


@pytest.mark.slow
def test_the_python_of_the_page_runs(
    example: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(example)
    (program,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    exec(compile(program, "explain.md", "exec"), {})
    reason, iterations = capsys.readouterr().out.split()
    assert reason == "search"
    assert int(iterations) > 1000


def test_every_column_of_the_export_has_its_unit() -> None:
    plain = {"vehicle", "role", "lane", "reason", "lane_change", "cost", "iterations"}
    assert all(
        re.search(r"_(s|m|rad|mps|mps2)$", column)
        for column in export.COLUMNS
        if column not in plain
    )
