"""Planners, predictors and cost terms of the user's own: the worked examples as they stand,
permission, labels, and everything that may be wrong with one."""

import hashlib
import importlib
import json
import math
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers_docs import unpack
from helpers_model import compiled
from helpers_tree import TOYS, grow

import sumo_mcts
from sumo_mcts import config
from sumo_mcts.commands import regret, validate
from sumo_mcts.config import ScenarioConfig, plugins
from sumo_mcts.driver import factories
from sumo_mcts.driver.replan import recorded_config, replan
from sumo_mcts.episode import EpisodeResult, run_episode
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments.experiment import Episode
from sumo_mcts.experiments.tasks import failed
from sumo_mcts.model.cost import step_own
from sumo_mcts.model.cost_params import Term, compiled_term
from sumo_mcts.model.motion import advance
from sumo_mcts.planners.search import search
from sumo_mcts.reporting.explanation import explain
from sumo_mcts.reporting.explanation_words import text
from sumo_mcts.scenarios import load_scenario
from sumo_mcts.scene import Answers
from sumo_mcts.studies.forecasts import compare
from sumo_mcts.studies.regret import Asked

STEP_OWN = compiled(step_own)

TOP = Path(__file__).resolve().parents[2]


# --- the examples ---


@pytest.fixture
def examples(tmp_path: Path) -> Path:
    """A folder with the examples of the documents, as if courteous were installed there."""
    unpack("extending.md", tmp_path)
    unpack("gym.md", tmp_path)
    for name in ("networks", "routes", "configs"):
        (tmp_path / name).symlink_to(TOP / name)
    project = tomllib.loads((tmp_path / "pyproject.toml").read_text())["project"]
    installed = tmp_path / f"{project['name']}-{project['version']}.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    )
    groups = [
        f"[{group}]\n" + "\n".join(f"{name} = {code}" for name, code in points.items())
        for group, points in project["entry-points"].items()
    ]
    (installed / "entry_points.txt").write_text("\n\n".join(groups) + "\n")
    return tmp_path


def python(folder: Path, *words: str, status: int = 0) -> str:
    """What a new Python prints, with the folder on its path."""
    path = os.pathsep.join([str(folder), str(TOP), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == status, done.stderr
    return done.stdout if status == 0 else done.stderr


def episode(folder: Path, *words: str) -> dict[str, Any]:
    (row,) = json.loads(python(folder, "-m", "sumo_mcts", "run", *words, "--json"))["episodes"]
    return dict(row)


@pytest.mark.slow
def test_the_worked_example_drives(examples: Path) -> None:
    row = episode(examples, "scene.yaml", "--out", "out", "--set", "traffic.vary=0")
    assert (row["outcome"], row["planner"], row["prediction"], row["variant"]) == (
        "arrived",
        "steady",
        "lively",
        "steady-lively-traffic.vary-0.0",
    )
    assert row["failsafe_interventions"] == 0
    manifest = json.loads((examples / "out" / "manifest.json").read_text())
    package = {"name": "courteous", "version": "0.1"}
    of = {
        name: hashlib.sha256((examples / "courteous" / f"{name}.py").read_bytes()).hexdigest()
        for name in ("planner", "predictor", "cost")
    }
    assert manifest["plugins"] == [
        {
            "key": "planner.name",
            "name": "steady",
            "code": "courteous.planner:Steady",
            "file_digest": of["planner"],
            "package": package,
        },
        {
            "key": "prediction.name",
            "name": "lively",
            "code": "courteous.predictor:Lively",
            "file_digest": of["predictor"],
            "package": package,
        },
        {
            "key": "cost.term",
            "name": "keep_right",
            "code": "courteous.cost:keep_right",
            "file_digest": of["cost"],
            "package": package,
        },
    ]
    by_code = (
        "--planner",
        "courteous.planner:Steady",
        "--prediction",
        "courteous.predictor:Lively",
        "--set",
        "cost.term=courteous.cost:keep_right",
    )
    same = episode(examples, "scene.yaml", *by_code, "--set", "traffic.vary=0", "--allow-plugins")
    assert same["trace_digest"] == row["trace_digest"]
    assert "runs only with --allow-plugins" in python(
        examples, "-m", "sumo_mcts", "run", "scene.yaml", *by_code, status=2
    )


@pytest.mark.slow
def test_a_learned_policy_drives(examples: Path) -> None:
    python(examples, "-m", "learned.learn", "weights.npy", "1", "2")
    assert np.load(examples / "weights.npy").shape == (15, 10 + 4 * 11 + 4 * 5 + 7 + 1)
    row = episode(
        examples,
        "straight-line",
        "--planner",
        "learned.planner:Learned",
        "--set",
        "planner.options.weights=weights.npy",
        "--time-limit",
        "5",
        "--allow-plugins",
    )
    assert row["outcome"] != "error" and row["failsafe_interventions"] == 0
    assert row["cycles"] > 5


@pytest.mark.slow
@pytest.mark.parametrize("page", ["api.md", "gym.md"])
def test_the_programs_of_the_documents_run(page: str, tmp_path: Path) -> None:
    programs = re.findall(
        r"^```python\n(.*?)^```", (TOP / "docs" / page).read_text(), re.DOTALL | re.MULTILINE
    )
    assert programs
    for program in programs:
        assert python(tmp_path, "-c", program) is not None


def test_names_are_loaded_when_they_are_used() -> None:
    program = (
        "import sys, sumo_mcts; assert not {'numpy', 'numba', 'pydantic', 'libsumo'} & "
        "set(sys.modules); print(sorted(sumo_mcts.__all__))"
    )
    assert python(TOP, "-c", program).strip() == (
        "['BatchError', 'ConfigError', 'Controller', '__version__', 'load_scenario', "
        "'run_batch', 'run_episode']"
    )
    assert sumo_mcts.run_episode is run_episode and sumo_mcts.load_scenario is load_scenario
    assert set(sumo_mcts.__all__) <= set(dir(sumo_mcts))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = sumo_mcts.nothing


# --- plugins that are wrong ---

CODE = """
import numpy as np
from sumo_mcts.driver.factories import make_predictor
from sumo_mcts.prediction.forecast import OracleData, predict
from sumo_mcts.planners.baselines import ConstantPlanner
from sumo_mcts.scene import Plan

class Good(ConstantPlanner):
    def __init__(self, options, scenario):
        super().__init__(scenario.planner.period_s)

class Reader(Good):
    needs_forecast = True

class Picky(Good):
    def __init__(self, options, scenario):
        raise ValueError(f"speed: at least 0, got {options['speed']}")

class Lacking:
    needs_forecast = False
    def __init__(self, options, scenario): pass
    def start(self, task, seed): pass

class Stalled(Good):
    def start(self, task, seed):
        raise RuntimeError("no\\nfuel")

class Planless(Good):
    def plan(self, situation):
        decision = super().plan(situation)
        time = np.arange(3.0)
        return decision._replace(plan=Plan(time, time[:2], time, time, np.zeros((3, 4))))

class Idm:
    oracle = False
    def __init__(self, options, scenario):
        self.wrong = options
        self.asked = 0
    def start(self, road, oracles):
        self.road, self.oracles = road, oracles
    def predict(self, q):
        self.asked += 1
        lane = q.scene.agents.lane
        lanes = {} if self.oracles is None else {i: self.oracles.lanes(name, int(lane[i])) for i, name in enumerate(q.scene.agents.ids)}
        forecast = predict(self.road, q, OracleData(lanes=lanes))
        return forecast if self.asked % 3 else wrong(forecast, self.wrong)

class Knowing(Idm):
    oracle = True

class Deaf(Idm):
    def start(self, road, oracles):
        raise OSError("no map")

def wrong(forecast, how):
    if how.get("raises"):
        raise KeyError("who")
    if how.get("nothing"):
        return None
    changes = {
        "nan": {"pose": forecast.pose * np.nan}, "short": {"v": forecast.v[:, :-1]}, "lane": {"lane": forecast.lane + 10_000},
        "weight": {"weight": forecast.weight * 2}, "step": {"dt": 0.1}, "single": {"v": forecast.v.astype(np.float32), "lane": forecast.lane.astype(np.int64)},
    }
    return forecast._replace(**changes.get(how.get("name"), {}))

def costly(t, lane, s, v, a, jerk, min_gap, weight): return weight * v
def free(t, lane, s, v, a, jerk, min_gap, weight): return 0.0
def few(t, lane): return 0.0
def words(t, lane, s, v, a, jerk, min_gap, weight): return "dear"
"""


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A module of the user's own."""
    (tmp_path / "of_mine.py").write_text(CODE)
    (tmp_path / "broken_one.py").write_text("import nowhere_to_be_found\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.invalidate_caches()
    monkeypatch.delitem(sys.modules, "of_mine", raising=False)
    return "of_mine"


def scene(*sets: str) -> ScenarioConfig:
    return load_scenario("straight-line", "episode.stop_time_s=5", *sets, allow_plugins=True)


WRONG = {
    "planner.name=nowhere:X": "planner.name: nowhere:X: nowhere cannot be imported: "
    "ModuleNotFoundError: No module named 'nowhere'",
    "planner.name=broken_one:X": "planner.name: broken_one:X: broken_one cannot be imported: "
    "ModuleNotFoundError: No module named 'nowhere_to_be_found'",
    "planner.name=of_mine:X": "planner.name: of_mine:X: of_mine has no X",
    "planner.name=of_mine:Lacking": "planner.name: of_mine:Lacking: lacks plan; it needs "
    "needs_forecast, start, plan",
    "planner={name: of_mine:Picky, options: {speed: -1}}": "does not take planner.options "
    "{'speed': -1}: ValueError: speed: at "
    "least 0, got -1",
    "prediction.name=of_mine:Good": "prediction.name: of_mine:Good: lacks oracle, predict; it "
    "needs oracle, start, predict",
    "cost.term=of_mine:few": "cost.term: of_mine:few: cannot be compiled: TypeError: Signature "
    "mismatch: 8 argument types given, but function takes 2",
    "cost.term=of_mine:words": "cost.term: of_mine:words: cannot be compiled: ",
}


@pytest.mark.parametrize("setting", WRONG)
def test_what_is_wrong_is_one_line(setting: str, mine: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as error:
        run_episode(scene(setting), 0)
    assert WRONG[setting] in str(error.value) and "\n" not in str(error.value)
    path = tmp_path / "mine.yaml"
    name, _, value = setting.partition("=")
    section, _, key = name.partition(".")
    inner = f"{section}: {{{key}: '{value}'}}" if key else f"{section}: {value}"
    path.write_text(f"base: {TOP}/configs/straight-line.yaml\n{inner}\n")
    said = validate.problems_of(path, allow_plugins=True)[0]
    assert said.startswith(f"{path}: ") and WRONG[setting] in said
    assert "runs only with --allow-plugins" in validate.problems_of(path)[0]


def test_a_predictor_that_does_not_start(mine: str) -> None:
    with pytest.raises(
        ConfigError, match=r"prediction.name: of_mine:Deaf: does not start: OSError: no map"
    ):
        run_episode(scene("prediction.name=of_mine:Deaf"), 0)


def test_a_planner_that_does_not_start_is_an_outcome(mine: str) -> None:
    row = run_episode(scene("planner.name=of_mine:Stalled"), 0).rows[0]
    assert (row["outcome"], row["error"]) == (
        "error",
        "PlannerError: planner of_mine:Stalled does not start: RuntimeError: no fuel",
    )


def test_a_plan_that_is_none_costs_a_manoeuvre(mine: str) -> None:
    result = run_episode(scene("planner.name=of_mine:Planless", "failsafe.most_failures=1000"), 0)
    assert all(
        cycle.decision.reason.endswith(
            "the planner failed: a plan whose v has shape (2,), or is not finite"
        )
        for cycle in result.traces[0].cycles
    )
    assert result.rows[0]["failsafe_interventions"] == result.rows[0]["cycles"] > 3


def test_permission() -> None:
    with pytest.raises(
        ConfigError,
        match=r"straight-line.yaml: planner.name: a:B: code that a scenario names runs only with "
        r"--allow-plugins",
    ):
        load_scenario("straight-line", "planner.name=a:B")
    data = {"name": "x", "sumo": {"net": "x"}, "egos": [{"id": "e"}], "cost": {"term": "a.b:c"}}
    with pytest.raises(ConfigError, match=r"cost.term: a.b:c: code"):
        config.build(dict(data), "x")
    assert config.build(dict(data), "x", allow_plugins=True).cost.term == "a.b:c"
    plan = regret.RegretPlan(Asked(("mcts", "a:B"), (50,)), 1, 1, 1)
    with pytest.raises(ConfigError, match=r"--planners: a:B: code"):
        regret.regret(("straight-line",), (), None, (), plan, None, print)


@pytest.mark.parametrize("name", ["nothing", "a:", ":b", "a b:c", "a:b:c", "os.system('x'):y"])
def test_names_that_are_none(name: str) -> None:
    with pytest.raises(
        ConfigError,
        match=r"planner.name: has to be 'mcts', .* an installed plugin \(there is none\) or "
        r"module:name, got ",
    ):
        load_scenario("straight-line", f"planner.name={json.dumps(name)}", allow_plugins=True)


# --- predictors ---


def driven(*sets: str) -> EpisodeResult:
    return run_episode(scene("planner.iterations=50", *sets), 0)


def test_a_predictor_that_says_what_ours_says_changes_nothing(mine: str) -> None:
    ours = driven("prediction.hypotheses=1")
    theirs, single = (
        driven(f"prediction={{name: of_mine:Idm, options: {{name: {name}}}}}")
        for name in ("right", "single")
    )
    assert theirs.rows[0]["trace_digest"] == ours.rows[0]["trace_digest"]
    assert theirs.rows[0]["prediction"] == "of_mine:Idm"
    assert single.rows[0]["failsafe_interventions"] == 0  # other types of numbers are no mistake


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("raises: true", "KeyError: 'who'"),
        ("nothing: true", "ValueError: no forecast but NoneType"),
        ("name: nan", "ValueError: pose: not finite"),
        ("name: short", "ValueError: v: shape (1, "),
        ("name: lane", "ValueError: lane: not within -1.."),
        ("name: weight", "ValueError: weight: not positive numbers that sum to 1"),
        ("name: step", "ValueError: dt: 0.1 s instead of 0.2 s"),
    ],
)
def test_a_predictor_that_fails_now_and_then_costs_manoeuvres(
    how: str, said: str, mine: str
) -> None:
    result = driven(f"prediction={{name: of_mine:Idm, options: {{{how}}}}}")
    notes = [cycle.decision.reason for cycle in result.traces[0].cycles]
    failed = [k for k, note in enumerate(notes) if "the predictor failed: " in note]
    assert failed and len(failed) < len(notes)
    assert all(said in notes[k] and notes[k].startswith("fail-safe") for k in failed)
    assert result.rows[0]["failsafe_interventions"] == len(failed)
    assert result.rows[0]["outcome"] != "error"


@pytest.mark.slow
def test_an_oracle_is_labelled_and_only_an_oracle_is_told(mine: str) -> None:
    document = compare(
        [scene("prediction.name=of_mine:Knowing", "planner.iterations=50")], [0], (), print
    )
    errors = {
        row["prediction"]: row["mean_m"] for row in document["forecasts"] if row["horizon_s"] == 3.0
    }
    assert errors["of_mine:Knowing (oracle)"] == errors["routes"]
    row = driven("prediction.name=of_mine:Knowing").rows[0]
    routes = driven("prediction.name=routes").rows[0]
    assert row["prediction"] == "of_mine:Knowing (oracle)"
    assert row["trace_digest"] == routes["trace_digest"]


def test_an_explanation_names_the_forecast_that_a_plugin_reads_without_running_it(
    mine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By what is recorded."""
    cases = {
        "of_mine:Good": ("idm", ""),
        "of_mine:Reader": ("idm", ", forecast idm"),
        "mcts": ("of_mine:Knowing", ", forecast of_mine:Knowing (an oracle)"),
    }
    traces = {
        planner: driven(f"planner.name={planner}", f"prediction.name={name}").traces[0]
        for planner, (name, _) in cases.items()
    }
    monkeypatch.setattr(plugins, "loaded", lambda *_: pytest.fail("code of a plugin was loaded"))
    for planner, (_, said) in cases.items():
        assert (
            text(explain(traces[planner], None, 1))
            .splitlines()[0]
            .endswith(f"; planner {planner}{said}")
        )


def test_an_episode_that_failed_is_labelled_as_any_other(mine: str) -> None:
    oracle = "of_mine:Knowing"
    for planner, prediction, label in (
        ("Good", oracle, None),
        ("Reader", "idm", "idm"),
        ("Reader", oracle, f"{oracle} (oracle)"),
    ):
        episode = Episode(
            ("k",),
            "v",
            0,
            scene(f"planner.name=of_mine:{planner}", f"prediction.name={prediction}"),
        )
        (row,) = failed(episode, "a reason")
        assert row["prediction"] == label
    (row,) = failed(Episode(("k",), "v", 0, scene("planner.name=of_mine:Gone")), "a reason")
    assert (row["prediction"], row["error"]) == (None, "a reason")


def test_an_oracle_of_mine_cannot_be_asked_later(mine: str) -> None:
    """It is no failure of the predictor, which would lead to a manoeuvre: the record does not know."""
    result = driven("prediction.name=idm")
    trace, road = result.traces[0], result.road
    assert road is not None
    with pytest.raises(
        ConfigError,
        match=r"prediction.name: of_mine:Knowing is an oracle that this episode did not ask; "
        r"allowed: idm, constant_velocity",
    ):
        replan(
            trace,
            road,
            1,
            recorded_config(
                trace.setting, ("prediction.name=of_mine:Knowing",), allow_plugins=True
            ),
        )
    knowing = driven("prediction.name=of_mine:Knowing").traces[0]
    same_settings = recorded_config(knowing.setting, allow_plugins=True)
    assert (
        replan(knowing, road, 1, same_settings).decision.reason == knowing.cycles[1].decision.reason
    )
    silent = knowing._replace(
        cycles=tuple(cycle._replace(answers=Answers()) for cycle in knowing.cycles)
    )
    with pytest.raises(
        ConfigError,
        match=r"of_mine:Knowing asks where \S+ goes, and the oracle of this episode was not asked "
        r"that",
    ):
        replan(silent, road, 1, same_settings)


@pytest.mark.slow
def test_regret_asks_plugins(mine: str) -> None:
    plan = regret.RegretPlan(Asked(("constant", "of_mine:Good"), (50,)), 1, 3, 2)
    result = regret.regret(
        ("straight-line",),
        (),
        None,
        ("planner.iterations=50", "episode.stop_time_s=4"),
        plan,
        None,
        print,
        allow_plugins=True,
    )
    one, same = result["planners"]
    assert {**one, "planner": ""} == {**same, "planner": ""} and same["planner"] == "of_mine:Good"


# --- cost terms ---


def term_of(rate: Callable[..., float], weight: float = 1.0) -> Term:
    return Term(compiled_term(rate), weight)


def own_cost(rate: Callable[..., float], *, name: str = "traffic", gap: float = 12.0) -> float:
    toy = grow(TOYS[name], 1)
    after, _ = advance(toy.local, toy.task.ego, toy.root, 1.0, 0.0)
    return float(
        STEP_OWN(
            term_of(rate, 3.0), toy.local, toy.task.ego, toy.task.cost, toy.root, after, gap, 2.5
        )
    )


@pytest.mark.slow
def test_a_term_is_told_what_the_page_says() -> None:
    grown = grow(TOYS["traffic"], 1)
    p, root = grown.task.ego, grown.root
    after, _ = advance(grown.local, p, root, 1.0, 0.0)
    expected = (
        2.5,
        1.0,
        after.s,
        after.v,
        after.a,
        (after.a - root.a) / p.step,
        12.0,
        3.0,
    )  # the middle of three lanes
    for k, value in enumerate(expected):
        assert own_cost(PICKS[k]) == pytest.approx(
            min(value, grown.task.cost.contact) * p.step if value > 0.0 else 0.0
        ), k


def _pick(k: int) -> Callable[..., float]:
    names = "t, lane, s, v, a, jerk, min_gap, weight"
    space: dict[str, Any] = {}
    exec(f"def rate({names}):\n    return 1.0 * ({names})[{k}]", space)
    function: Callable[..., float] = space["rate"]
    return function


PICKS = [_pick(k) for k in range(8)]


def test_costs_add_up_and_stay_below_that_of_a_contact() -> None:
    limit = grow(TOYS["traffic"], 1).task.cost.contact * 0.1
    assert own_cost(lambda t, lane, s, v, a, jerk, min_gap, weight: -v) == 0.0
    assert own_cost(lambda t, lane, s, v, a, jerk, min_gap, weight: math.nan) == 0.0
    assert own_cost(lambda t, lane, s, v, a, jerk, min_gap, weight: math.inf) == pytest.approx(
        limit
    )
    assert own_cost(lambda t, lane, s, v, a, jerk, min_gap, weight: 1.0 / (v - v)) == pytest.approx(
        limit
    )


@pytest.mark.slow
def test_the_search_minds_a_term(mine: str) -> None:
    """Compiled and as plain Python the same; one of 0 changes nothing, kernels are compiled once
    for all of them."""

    def drive(*sets: str) -> dict[str, Any]:
        return dict(run_episode(scene("planner.iterations=50", *sets), 0).rows[0])

    ours, free = drive(), drive("cost.term=of_mine:free")
    compiled_for = list(search.signatures)  # type: ignore[attr-defined]  # numba's
    dear = drive("cost.term=of_mine:costly", "cost.term_weight=0.5")
    assert free["trace_digest"] == ours["trace_digest"]
    assert dear["distance_m"] < 0.8 * ours["distance_m"]
    assert list(search.signatures) == compiled_for  # type: ignore[attr-defined]
    program = (
        "from sumo_mcts import load_scenario, run_episode\n"
        "s = load_scenario('straight-line', 'episode.stop_time_s=1.5', 'planner.iterations=20', "
        "'prediction.hypotheses=1', 'cost.term=of_mine:costly',\n"
        "                  allow_plugins=True)\n"
        "print(run_episode(s, 0).rows[0]['trace_digest'])"
    )
    folder = Path(importlib.import_module(mine).__file__ or "").parent
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(TOP)])}
    plain, compiled = (
        subprocess.run(
            [sys.executable, "-c", program],
            env={**environment, "NUMBA_DISABLE_JIT": off},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for off in ("1", "0")
    )
    assert plain == compiled


def test_a_name_that_two_packages_have(monkeypatch: pytest.MonkeyPatch) -> None:
    points = metadata.EntryPoints(
        metadata.EntryPoint("mine", f"{package}.planner:Mine", config.PLANNER_GROUP)
        for package in ("one", "two")
    )
    monkeypatch.setattr(metadata, "entry_points", points.select)
    assert (
        load_scenario("straight-line", "planner.name=mine").planner.name == "mine"
    )  # installed: needs no permission
    with pytest.raises(
        ConfigError,
        match=r"mine: several packages have a plugin of this name: one.planner:Mine, "
        r"two.planner:Mine",
    ):
        plugins.loaded("planner.name", "mine")
    assert factories.prediction_label(load_scenario("straight-line")) == "idm"
