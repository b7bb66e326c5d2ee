"""What is compiled, when, and how often; the messages about it."""

import importlib
import inspect
import os
import pkgutil
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np
import pytest

import sumo_mcts
from sumo_mcts.numerics import kernel, prepare
from sumo_mcts.numerics.announce import (
    COMPILING,
    WAITING,
    Announcer,
    Growth,
    announced,
    unannounced,
    watched,
)
from sumo_mcts.numerics.kept import NOTHING_KEPT, Kept

pytestmark = pytest.mark.skipif(kernel.is_plain(), reason="nothing is compiled")

SOURCE = """
import os, time
from sumo_mcts.numerics.kernel import entry, kernel, lengthy, making_arrays
import numpy as np

time.sleep(float(os.environ.get("IMPORT_S", 0)))

@kernel
def smallest(a, b):
    return a if a < b else b

@kernel
def clipped(x, least):
    return -smallest(-x, -least)

@entry
def total(values, short):
    result = clipped(0, 0) + clipped(short[0], 1) * 0.0
    for k in range(len(values)):
        result += clipped(values[k], 1.5)
    return result

@lengthy
def counted(n):
    return np.arange(n).sum()
"""
VALUES, SHORT = np.array([1.0, 2.0, 3.0]), np.array([7], np.int32)


@pytest.fixture
def kept_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which kernels are kept meanwhile."""
    place = tmp_path / "kept"
    place.mkdir()
    monkeypatch.setattr(kernel, "_given", [place])
    return place


@pytest.fixture
def toys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept_in: Path) -> ModuleType:
    """A module with some kernels."""
    (tmp_path / "toys.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)
    return _anew(monkeypatch)


def _anew(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """As in another process: nothing is loaded yet."""
    monkeypatch.delitem(sys.modules, "toys", raising=False)
    return importlib.import_module("toys")


def _said(use: Any) -> list[str]:
    said: list[str] = []
    with announced(said.append):
        use()
    return said


# --- what is compiled ---


def test_python_runs_the_source_of_a_kernel_that_only_kernels_call(toys: ModuleType) -> None:
    assert _said(lambda: toys.clipped(1.0, least=1.5)) == []
    assert toys.clipped(1.0, least=1.5) == 1.5
    assert not toys.clipped.signatures


def test_a_constant_or_a_shorter_integer_is_no_reason_to_compile_again(toys: ModuleType) -> None:
    assert toys.total(VALUES, SHORT) == pytest.approx(6.5)
    assert {tuple(map(str, each)) for each in toys.clipped.signatures} == {
        ("int64", "int64"),
        ("float64", "float64"),
    }


def test_what_is_compiled_is_announced_and_kept(
    toys: ModuleType, kept_in: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = _said(lambda: toys.total(VALUES, SHORT))
    assert [line.partition("  ")[0] for line in said] == [
        COMPILING
    ] * 5  # total, and two of each other
    assert said[-1].endswith("  5 kernels")
    assert kernel.kept_kernels() == 5
    again = _anew(monkeypatch)
    assert _said(lambda: again.total(VALUES, SHORT)) == []
    assert again.total(VALUES, SHORT) == pytest.approx(6.5)


@pytest.mark.slow
def test_a_changed_source_is_compiled(
    toys: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert toys.counted(4) == 6
    (tmp_path / "toys.py").write_text(SOURCE.replace(".sum()", ".sum() + 100"))
    kernel._source.cache_clear()
    importlib.invalidate_caches()
    assert _anew(monkeypatch).counted(4) == 106


@pytest.mark.parametrize("keep", [0, 1, 40, -1])
def test_a_damaged_file_is_compiled_again_without_a_word_of_it(
    toys: ModuleType, kept_in: Path, keep: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    toys.counted(4)
    (file,) = kept_in.glob("toys.counted-*")
    whole = file.read_bytes()
    file.write_bytes(whole[:keep])
    again = _anew(monkeypatch)
    said = _said(lambda: again.counted(4))
    assert [line.partition("  ")[0] for line in said] == [COMPILING]
    assert again.counted(4) == 6
    assert file.stat().st_size == pytest.approx(len(whole), abs=200)


def test_a_whole_file_that_means_nothing_is_compiled_again(
    toys: ModuleType, kept_in: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    toys.counted(4)
    (file,) = kept_in.glob("toys.counted-*")
    for content in (b"no pickle", b"cos\nnothing_like_that\n."):
        one = Kept(file)
        one.take(lambda _: None)
        one.write(content)
        one.release()
        assert _anew(monkeypatch).counted(4) == 6


def test_on_a_full_disk_it_goes_on_and_says_so_once(
    toys: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Kept, "_fill", fails)
    monkeypatch.setattr("sumo_mcts.numerics.announce._said", set())
    with announced(lambda _: None):
        assert toys.total(VALUES, SHORT) == pytest.approx(6.5)
        assert toys.counted(4) == 6
    line, _, rest = capsys.readouterr().err.partition("\n")
    assert NOTHING_KEPT in line
    assert "No space left on device" in line
    assert rest == ""


def test_where_nothing_can_be_kept_it_works_too(
    toys: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernel, "folder", lambda: None)
    assert toys.total(VALUES, SHORT) == pytest.approx(6.5)
    assert kernel.kept_kernels() == 0


def test_what_fails_to_compile_leaves_no_lock(
    tmp_path: Path, toys: ModuleType, kept_in: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "wrong.py").write_text(
        "from sumo_mcts.numerics.kernel import entry\n\n@entry\ndef wrong(x):\n    return "
        "x.nothing\n"
    )
    wrong = importlib.import_module("wrong").wrong
    with pytest.raises(Exception, match="nothing"):
        wrong(1.0)
    (file,) = kept_in.glob("wrong.*")
    assert not Kept(file).is_taken()


# --- which environment it is for ---


def test_each_environment_has_a_folder_of_its_own_and_compiles_aloud(
    tmp_path: Path, toys: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What another version of numba or Python, or another processor, left in its folder does not
    count."""
    monkeypatch.setattr(kernel, "_given", [])
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folders = set()
    places = [
        ("numba.__version__", "0.99"),
        ("sys.version", "4.0"),
        ("sumo_mcts.numerics.kernel.version", lambda _: "99"),
        (None, None),
    ]
    for place, value in places:
        with monkeypatch.context() as patch:
            if place is not None:
                patch.setattr(place, value)
            kernel._own_folder.cache_clear()
            folders.add(kernel.folder())
            module = _anew(patch)
            assert kernel.kept_kernels() == 0
            assert [line.partition("  ")[0] for line in _said(lambda m=module: m.counted(4))] == [
                COMPILING
            ]
            assert kernel.kept_kernels() == 1
    kernel._own_folder.cache_clear()
    assert len(folders) == len(places)


def test_kernels_of_other_fields_lie_in_another_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To numba two tuples of as many numbers are of one type, whatever the names of their fields
    are; the weights of the cost are named outside the packages with kernels."""
    monkeypatch.setattr(kernel, "_given", [])
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    package = shutil.copytree(kernel._PACKAGE, tmp_path / "package")
    monkeypatch.setattr(kernel, "_PACKAGE", package)
    folders = []
    counts = ("road.py", "scene.py", "config/sections/cost.py")
    for name in (None, *counts, "config/sections/planning.py"):
        if name is not None:
            (package / name).write_text((package / name).read_text() + "# another\n")
        kernel._own_folder.cache_clear()
        folders.append(kernel.folder())
    kernel._own_folder.cache_clear()
    assert len(set(folders[:-1])) == 1 + len(counts) and folders[-1] == folders[-2]


def test_the_environment_names_the_processor() -> None:
    processor = kernel._NUMBA.registry.cpu_target.target_context.codegen().magic_tuple()
    assert len(processor) == 3
    assert set(map(str, processor)) <= set(kernel.environment())


# --- prepared ---


def test_what_is_missing_runs_as_plain_python_and_is_compiled_then(
    toys: ModuleType, kept_in: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The result is that of the compiled function, which is not compiled again when it is used."""
    results: list[float] = []

    def use() -> None:
        results.append(toys.total(VALUES, SHORT))
        assert kernel.kept_kernels() == 0

    said = _said(lambda: prepare.prepare(use))
    assert said
    assert kernel.kept_kernels() == 5
    assert _said(lambda: results.append(toys.total(VALUES, SHORT))) == []
    assert results == [pytest.approx(6.5)] * 2


def test_what_is_called_is_compiled_before_what_calls_it(toys: ModuleType) -> None:
    trial = prepare._Trial()
    with kernel.tried(trial.run):
        toys.total(VALUES, SHORT)
    tasks = trial.tasks()
    assert [task.kernel.py_func.__name__ for task in tasks] == ["smallest", "clipped", "total"]
    assert [{called.py_func.__name__ for called in task.calls} for task in tasks] == [
        set(),
        {"smallest"},
        {"clipped"},
    ]


def test_what_takes_too_long_as_plain_python_is_compiled_at_once(toys: ModuleType) -> None:
    def use() -> None:
        assert toys.counted(4) == 6
        assert kernel.kept_kernels() == 1

    prepare.prepare(use)


@pytest.mark.parametrize(
    ("error", "compiled"), [(KeyboardInterrupt, 0), (SystemExit, 0), (ValueError, 5)]
)
def test_an_interrupt_of_the_trial_compiles_nothing(
    error: type[BaseException], compiled: int, toys: ModuleType, kept_in: Path
) -> None:
    def use() -> None:
        toys.total(VALUES, SHORT)
        raise error

    with pytest.raises(error):
        prepare.prepare(use)
    assert kernel.kept_kernels() == compiled


def test_what_is_kept_is_not_compiled_however_much_of_it_is_used(
    toys: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    toys.total(VALUES, SHORT)
    again = _anew(monkeypatch)
    assert _said(lambda: prepare.prepare(lambda: again.total(VALUES, SHORT))) == []
    assert len(again.total.signatures) == 1


@pytest.mark.parametrize("damaged", ["toys.*", "toys.total-*", "toys.smallest-*"])
def test_what_is_damaged_is_prepared_anew(
    toys: ModuleType, kept_in: Path, damaged: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As far as it is needed: what is part of another kernel is not asked for."""
    toys.total(VALUES, SHORT)
    for file in kept_in.glob(damaged):
        file.write_bytes(file.read_bytes()[:-5])
    again = _anew(monkeypatch)
    said = _said(lambda: prepare.prepare(lambda: again.total(VALUES, SHORT)))
    assert len(said) == {"toys.*": 5, "toys.total-*": 1, "toys.smallest-*": 0}[damaged]
    assert all(Kept(file).is_there() for file in kept_in.glob("toys.total-*"))
    assert again.total(VALUES, SHORT) == pytest.approx(6.5)


def test_an_interrupted_compilation_goes_on_where_it_was(
    toys: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(line: str) -> None:
        if "5 kernels" in line:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), announced(interrupt):
        toys.total(VALUES, SHORT)
    done = kernel.kept_kernels()
    again = _anew(monkeypatch)
    said = _said(lambda: again.total(VALUES, SHORT))
    assert 0 < done < 5
    assert len(said) == 5 - done


TWO = """
import sys
from pathlib import Path
from sumo_mcts.numerics import kernel, prepare
from sumo_mcts.numerics.announce import announced
kernel.keep_in(Path(sys.argv[1]))
prepare.FEW = int(sys.argv[2])
import numpy as np, toys
said = []
with announced(said.append):
    prepare.prepare(lambda: toys.total(np.ones(3), np.ones(1, np.int32)))
    assert toys.total(np.ones(3), np.ones(1, np.int32)) == 4.5
print(sum("compiling the search" in line for line in said))
"""


@pytest.mark.slow
def test_processes_that_start_at_the_same_time_compile_everything_once(
    toys: ModuleType, tmp_path: Path, kept_in: Path
) -> None:
    """Together; and with a process of their own to help them."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}

    def run(few: int) -> int:
        done = subprocess.run(
            [sys.executable, "-c", TWO, str(kept_in), str(few)],
            capture_output=True,
            text=True,
            check=True,
            env=environment,
        )
        return int(done.stdout)

    with ThreadPoolExecutor() as pool:
        assert sum(pool.map(run, (99, 99))) == 5
    assert kernel.kept_kernels() == 5
    for file in kept_in.iterdir():
        file.unlink()
    assert run(0) <= 5  # the other process may have come in time for some
    assert kernel.kept_kernels() == 5


def test_a_helper_that_cannot_start_or_fails_is_done_without(
    toys: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prepare, "FEW", 0)
    monkeypatch.setattr(sys, "executable", "/bin/false")
    prepare.prepare(lambda: toys.total(VALUES, SHORT))
    assert kernel.kept_kernels() == 5
    monkeypatch.setattr(sys, "executable", "/nothing/there")
    prepare.prepare(lambda: _anew(monkeypatch).total(VALUES, SHORT + 1))


KILLED = """
import os, sys
from pathlib import Path
from sumo_mcts.numerics import kernel, prepare
import numpy as np, toys
kernel.keep_in(Path(sys.argv[1]))
prepare.FEW = 0
os.environ["IMPORT_S"] = "60"  # for the other process
made = prepare._second_process
def announced():
    second = made()
    print(second.pid, flush=True)
    return second
prepare._second_process = announced
toys.total.compile = lambda _: sys.stdin.read()
prepare.prepare(lambda: toys.total(np.ones(3), np.ones(1, np.int32)))
"""


@pytest.mark.slow
@pytest.mark.skipif(
    sys.platform != "linux", reason="the system tells processes of their parent's death"
)
def test_the_second_process_ends_with_the_first(
    toys: ModuleType, tmp_path: Path, kept_in: Path
) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    command = [sys.executable, "-c", KILLED, str(kept_in)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stdout is not None
        second = Path("/proc") / process.stdout.readline().strip()
        assert second.is_dir()
        time.sleep(0.5)
        process.kill()
    until = time.monotonic() + 20.0
    while (
        second.is_dir()
        and "Z" not in (second / "stat").read_text().split()[2]
        and time.monotonic() < until
    ):
        time.sleep(0.1)
    assert time.monotonic() < until


NAMES = """
from sumo_mcts import config
from sumo_mcts.config import builtin
from sumo_mcts.driver.params import Physics
from sumo_mcts.driver.warmup import warm_up
from sumo_mcts.numerics import prepare
from sumo_mcts.world.roadmap import read_roadmap
import sys
prepare._compile_all = lambda tasks: print(*(f"{t.kernel.py_func.__module__.rpartition('.')[2]}.{t.kernel.py_func.__name__}" for t in tasks)) or sys.exit()
scenario = config.load(builtin.scenario_path("unprotected-left-turn"))
warm_up(scenario, read_roadmap(str(scenario.sumo.net)), Physics(0.1, False, 3.0))
"""
# By default each of these is compiled before the first decision, and what they call where the ego
# of the trial does not come to it.
NEEDED = {
    "actions": "action_at clear_line copy_line put_action",
    "agent_tables": "_fill _fill_bounds _fill_driven _fill_nodes",
    "completing": "unfinished",
    "cost_to_go": "_fill_to_gate waiting_s",
    "cost": """
        _before_stop _to_stop _too_slow behind is_against leads_nowhere step_comfort
        step_own
        step_passability stuck_behind terminal
    """,
    "crosswalks": "stays_on_crosswalk",
    "gaps": "gap_ahead gap_behind gap_to_leaving lane_left",
    "geometry": "boxes_touch chord point_at point_on swung",
    "interaction": """
        _headway _is_distant _nearness _swept _touch _with_distant_leader meet
    """,
    "krauss": "safe_speed",
    "least_cost": "_fill_sure _merged least_cost",
    "local_agents": "followers_of",
    "local_build": "_fill_ahead",
    "local_map": """
        boxes_meet chain_gap follows index_at keep_state kept_state node_of
        on_other_level to_end urgency_at
    """,
    "motion": """
        _cap _move _moved _must_stop _next_speed _to_line _towards_line _turned advance follow_accel
        is_closed pose_of within_step
    """,
    "behaviour": "_driving_accel _step_all",
    "conflicts": "_find_conflicts",
    "course": "to_sign",
    "following": "follow_accel free_accel leader_of",
    "paths": "_agreement _beside _best_successor _extend _leading_on _turn_score",
    "yielding": "halt_accel line_accel rank_of yield_accel",
    "obligations": "_find_obligations",
    "occupancy": "may_be_near",
    "poses": "_lane_at _place _place_on_path _point",
    "ply": "_driven_again copy_pairs for_steps needed_side replay simulate",
    "caps": "fill_caps",
    "route": "_fill_poses lane_pose",
    "continued": "choice new_row",
    "search": """
        _accel _beginning _continuation _drive_on _expand _plant _rollout _select _wish search
    """,
    "tree": "_action_of _trace_back back_up is_known near_of spent store",
}


@pytest.mark.slow
def test_by_default_just_so_much_is_compiled(tmp_path: Path) -> None:
    """A kernel more costs a quarter of a second of the first minute: it is to be noticed."""
    done = subprocess.run(
        [sys.executable, "-c", NAMES],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "XDG_CACHE_HOME": str(tmp_path), "NUMBA_DISABLE_JIT": "0"},
    )
    assert sorted(done.stdout.split()) == sorted(
        f"{module}.{name}" for module, names in NEEDED.items() for name in names.split()
    )


def _functions(module: ModuleType) -> Iterator[FunctionType]:
    """The functions of a module that are plain Python, those of its classes too."""
    for found in vars(module).values():
        within = vars(found).values() if inspect.isclass(found) else [found]
        yield from (
            each
            for each in within
            if isinstance(each, FunctionType) and each.__module__ == module.__name__
        )


# Python calls these a few times a decision: what that takes as plain Python is nothing beside their
# compilation.
CHEAP = {
    "advance", "begin_change", "bound", "box_distance", "can_change", "follow_accel", "goes_back",
    "lane_pose", "may_change", "place_is_free", "pose_of", "safe_gap",
    "step_comfort",
}  # fmt: skip


def _names(code: CodeType) -> set[str]:
    """The names of what is around that a function uses, also within comprehensions."""
    inner = (each for each in code.co_consts if isinstance(each, CodeType))
    return set(code.co_names).union(*map(_names, inner))


def test_python_calls_no_kernel_that_runs_as_plain_python_but_the_cheap_ones() -> None:
    rooms = [
        room.name
        for room in pkgutil.walk_packages(sumo_mcts.__path__, "sumo_mcts.")
        if room.name not in ("sumo_mcts.__main__", "sumo_mcts.gym")
    ]
    functions = [
        function for room in rooms for function in _functions(importlib.import_module(room))
    ]
    called = {
        name
        for function in functions
        for name in _names(function.__code__)
        if isinstance(function.__globals__.get(name), kernel.Part)
    }
    assert len(functions) > 500
    assert called == CHEAP


# --- what is said ---


def test_where_nobody_listens_standard_error_is_told_once(
    toys: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sumo_mcts.numerics.announce._said", set())
    toys.total(VALUES, SHORT)
    assert capsys.readouterr().err == f"sumo-mcts: {COMPILING}\n"
    with unannounced():
        toys.counted(4)
    assert capsys.readouterr().err == ""


def test_waiting_is_said_after_a_while() -> None:
    said: list[str] = []
    announcer = Announcer(said.append)
    announcer.waits(0.5)
    announcer.waits(5.2)
    assert said == [f"{WAITING}  5 s"]


def test_of_a_plan_it_is_said_how_far_it_is() -> None:
    said: list[str] = []
    announcer = Announcer(said.append)
    announcer.plans((7, 90))
    announcer.compiles()
    assert said == [f"{COMPILING}  7 of 90 kernels"]


def test_that_other_processes_compile_is_seen_from_what_they_keep(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    counts = iter([5, 5, 6, 8, 8])
    now = iter([100.0, 100.5, 100.5, 101.0, 101.0, 104.0])
    monkeypatch.setattr("time.monotonic", lambda: next(now))
    growth = Growth(lambda: next(counts))
    assert [growth.news() for _ in range(4)] == [
        "",
        f"{COMPILING}  1 kernels",
        f"{COMPILING}  3 kernels",
        "",
    ]


@pytest.mark.slow
def test_while_a_worker_compiles_whoever_waits_for_it_is_told() -> None:
    made, said = [0], list[str]()

    def slow() -> int:
        for _ in range(3):
            made[0] += 1
            time.sleep(0.4)
        return 7

    with ThreadPoolExecutor() as pool:
        assert watched(pool.submit(slow), lambda: made[0], said.append) == 7
    assert said
    assert {line.partition("  ")[0] for line in said} == {COMPILING}


def test_help_loads_nothing_that_takes_long() -> None:
    heavy = ("numba", "numpy", "sumo_mcts.config", "libsumo")
    program = (
        f"import sys; from sumo_mcts.cli import status; status(); print([m for m in {heavy} "
        "if m in sys.modules])"
    )
    for words in ([], ["run"]):
        done = subprocess.run(
            [sys.executable, "-c", program, *words, "--help"],
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.slow
def test_a_run_without_a_home_keeps_what_it_compiles_in_the_temporary_folder(
    tmp_path: Path,
) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "tmp").mkdir(mode=0o700)
    homes = {
        "HOME": str(tmp_path / "file" / "home"),
        "XDG_CACHE_HOME": str(tmp_path / "file" / "cache"),
        "TMPDIR": str(tmp_path / "tmp"),
    }
    command = [
        sys.executable,
        "-m",
        "sumo_mcts",
        "run",
        "straight-line",
        "--planner",
        "constant",
        "--seed",
        "1",
    ]
    first, again = (
        subprocess.run(
            command, capture_output=True, text=True, check=True, env={**os.environ, **homes}
        )
        for _ in range(2)
    )
    assert COMPILING in first.stderr
    assert COMPILING not in again.stderr
    assert [path.name for path in (tmp_path / "tmp").iterdir()] == [f"sumo_mcts-{os.getuid()}"]
