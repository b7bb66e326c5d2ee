"""What an experiment file may say: wrong ones are refused in one line, every key is documented."""

import re
from pathlib import Path

import pytest
from helpers_batch import plan

from sumo_mcts.config import builtin
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments.experiment import episodes, load
from sumo_mcts.experiments.schema import Entry, Experiment

BUILT_IN = sorted((builtin.root() / "configs" / "experiments").glob("*.yaml"))
SCENES = "name: x\nscenarios: [highway-exit]\n"


WRONG = {
    "nothing": ("", "an experiment is a mapping of keys: name, description, scenarios,"),
    "not yaml": ("name: [", "not valid YAML: line 1"),
    "key unknown": (
        SCENES + "seed: 3\n",
        (
            "seed: unknown key; allowed: name, description, scenarios, variants, sweep, seeds, twins, "
            "traces, "
        ),
    ),
    "entry key unknown": (
        "name: x\nscenarios: [{scenario: highway-exit, ego: a}]\n",
        "scenarios.0.ego: unknown key; allowed: scenario, sumocfg, name, egos",
    ),
    "no scenarios": ("name: x\nscenarios: []\n", "scenarios: has to have at least 1 entry"),
    "unknown scenario": (
        "name: x\nscenarios: [nowhere]\n",
        "scenarios.0: nowhere: no such scenario; give a .yaml, a .sumocfg, or one of: century-avenue-right",
    ),
    "unknown sumocfg": (
        "name: x\nscenarios: [{sumocfg: no.sumocfg, egos: [a]}]\n",
        "scenarios.0: sumocfg: no.sumocfg: no such file",
    ),
    "sumocfg without egos": (
        "name: x\nscenarios: [no.sumocfg]\n",
        "scenarios.0: egos: vehicle ids or {random: N} belong to a sumocfg, and only there",
    ),
    "egos of a scenario": (
        "name: x\nscenarios: [{scenario: highway-exit, egos: [a]}]\n",
        "egos: vehicle ids or {random: N} belong to a sumocfg",
    ),
    "no egos": (
        "name: x\nscenarios: [{sumocfg: no.sumocfg, egos: []}]\n",
        "scenarios.0.egos: give vehicle ids or {random: N}",
    ),
    "egos twice": (
        "name: x\nscenarios: [{sumocfg: no.sumocfg, egos: [a, a]}]\n",
        "scenarios.0.egos: ids: one is named twice",
    ),
    "random zero": (
        "name: x\nscenarios: [{sumocfg: no.sumocfg, egos: {random: 0}}]\n",
        "egos.random: has to be at least 1, got 0",
    ),
    "both sources": (
        "name: x\nscenarios: [{scenario: a, sumocfg: b, egos: [c]}]\n",
        "scenarios.0: give either scenario or sumocfg",
    ),
    "scenario twice": (
        "name: x\nscenarios: [highway-exit, highway-exit]\n",
        "scenarios: highway-exit: named 2 times; give a `name` of its own to each",
    ),
    "no variants": (SCENES + "variants: {}\n", "variants: has to have at least 1 entry"),
    "variant twice": (
        SCENES + "variants:\n  a: {}\n  a: {}\n",
        "not valid YAML: line 5, column 3: a: given twice",
    ),
    "sweep value twice": (
        SCENES + "sweep: {planner.iterations: [5, 5]}\n",
        "variants: default-iterations-5: two variants have this name",
    ),
    "empty grid": (
        SCENES + "sweep: {planner.iterations: []}\n",
        "sweep.planner.iterations: has to have at least 1 entry",
    ),
    "variant key": (
        SCENES + "variants: {a: {planner.iteration: 3}}\n",
        "variants.a: planner.iteration: unknown key; allowed: name, iterations,",
    ),
    "variant value": (
        SCENES + "variants: {a: {planner.iterations: many}}\n",
        "variants.a: planner.iterations: has to be a whole number",
    ),
    "sweep value": (
        SCENES + "sweep: {planner.iterations: [0]}\n",
        "variants, sweep: default-iterations-0: planner.iterations: has to be at least 1, got 0",
    ),
    "set key": (
        SCENES + "set: {cost.heading: 1}\n",
        "set: cost.heading: unknown key; allowed: contact,",
    ),
    "set below a value": (SCENES + "set: {name.x: 1}\n", "set: name.x: name has no keys below it"),
    "entry set": (
        "name: x\nscenarios: [{scenario: highway-exit, set: {cost.jerk: -1}}]\n",
        "scenarios.0.set: cost.jerk: has to be at least 0",
    ),
    "variant name": (
        SCENES + "variants: {a: {name: b}}\n",
        "variants.a: name and egos belong to the entries of `scenarios`",
    ),
    "twins of other traffic": (
        SCENES + "variants: {a: {traffic.vary: 0}}\ntwins: true\n",
        "variants.a: changes sumo, egos, traffic, episode, which twins share",
    ),
    "twins' name": (
        SCENES + "variants: {sumo: {}}\ntwins: true\n",
        "variants: sumo: with `twins` this is the name of the twins",
    ),
    "seeds backwards": (
        SCENES + "seeds: 9..0\n",
        "seeds: 9..0: the range runs backwards; write 0..9",
    ),
    "seeds in a list backwards": (
        SCENES + "seeds: [1, 5..3]\n",
        "seeds: 5..3: the range runs backwards",
    ),
    "too many seeds": (
        SCENES + "seeds: 0..99999999999\n",
        "seeds: 0..99999999999: a seed is at most 2147483647",
    ),
    "too many seeds in ranges": (
        SCENES + "seeds: [0..999999, 1000000..1999999]\n",
        "seeds: at most 1000000 seeds",
    ),
    "too many episodes": (
        SCENES + "seeds: 0..999999\nvariants: {a: {}, b: {}}\n",
        "2000000 episodes; at most 1000000",
    ),
    "too many variants": (
        SCENES
        + "sweep: {"
        + ", ".join(f"planner.options.k{k}: [{', '.join(map(str, range(100)))}]" for k in range(9))
        + "}\n",
        "scenarios x variants x sweep: 1000000000000000000; at most 10000",
    ),
    "key twice inside": (
        SCENES + "set: {planner.iterations: 5, planner.iterations: 6}\n",
        "planner.iterations: given twice",
    ),
    "seeds negative": (
        SCENES + "seeds: [-1]\n",
        "seeds: -1: a number from 0 on, or a range such as 0..9",
    ),
    "seeds number": (
        SCENES + "seeds: 100\n",
        "seeds: a range such as 0..9, or a list of numbers and ranges, got 100",
    ),
    "seeds none": (
        SCENES + "seeds: []\n",
        "seeds: a range such as 0..9, or a list of numbers and ranges",
    ),
    "seeds truth": (SCENES + "seeds: [true]\n", "seeds: True: a number from 0 on"),
    "scenarios text": (
        "name: x\nscenarios: highway-exit\n",
        "scenarios: has to be a list, got 'highway-exit'",
    ),
    "scenario number": (
        "name: x\nscenarios: [3]\n",
        "scenarios.0: has to be a mapping of keys, got 3",
    ),
    "variants list": (
        SCENES + "variants: [a]\n",
        "variants: has to be a mapping of keys, got ['a']",
    ),
    "variant number": (
        SCENES + "variants: {a: 3}\n",
        "variants.a: has to be a mapping of keys, got 3",
    ),
    "variant named by a number": (
        SCENES + "variants: {3: {}}\n",
        "not valid YAML: line 3, column 12: 3: a key has to be a text; write it in quotes",
    ),
    "variant named by a list": (
        SCENES + "variants: {? [3] : {}}\n",
        "not valid YAML: line 3, column 14: a key has to be a text",
    ),
    "section number": (
        SCENES + "variants: {a: {planner: 3}}\n",
        "variants.a: planner: has to be a mapping of keys, got 3",
    ),
    "sweep number": (
        SCENES + "sweep: {planner.iterations: 3}\n",
        "sweep.planner.iterations: has to be a list, got 3",
    ),
    "twins perhaps": (SCENES + "twins: perhaps\n", "twins: has to be true or false, got 'perhaps'"),
    "no name": ("scenarios: [highway-exit]\n", "name: has to be given"),
    "name": ("name: a b\nscenarios: [highway-exit]\n", "name: has to be a text like ^[A-Za-z0-9]"),
    "traces": (SCENES + "traces: some\n", "traces: has to be 'worth', 'all' or 'none', got 'some'"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_files(case: str, tmp_path: Path) -> None:
    text, said = WRONG[case]
    with pytest.raises(ConfigError) as refused:
        plan(tmp_path, text)
    message = str(refused.value)
    assert message.startswith(f"{tmp_path / 'small.yaml'}: ")
    assert "\n" not in message
    assert said in message


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError,
        match=r"nowhere: no such experiment; give a \.yaml, or one of: ablation, baselines",
    ):
        builtin.experiment_path("nowhere")
    with pytest.raises(
        ConfigError,
        match=r"^vared: no such experiment \(near: varied\); give a \.yaml, or one of: ablation, "
        r"baselines",
    ):
        builtin.experiment_path("vared")
    with pytest.raises(
        ConfigError, match=r"^highway-exits: no such scenario \(near: highway-exit, "
    ):
        builtin.scenario_path("highway-exits")
    with pytest.raises(ConfigError, match=r"nowhere\.yaml: no such file"):
        load(tmp_path / "nowhere.yaml")


# --- the page that describes it ---

PAGE = (builtin.root() / "docs" / "experiments.md").read_text(encoding="utf-8")


def test_every_key_is_documented() -> None:
    for model in (Experiment, Entry):
        assert not [
            name
            for name, field in model.model_fields.items()
            if f"| `{field.alias or name}` |" not in PAGE
        ]


@pytest.mark.slow
def test_the_sizes_of_the_built_in_ones() -> None:
    described: set[str] = set()
    for names, counts in re.findall(
        r"^\| (`[^|]*`) \| ([\d, each]+) \|", PAGE.split("## Built-in")[1], re.MULTILINE
    ):
        listed = re.findall(r"`([\w-]+)`", names)
        numbers = [int(number) for number in re.findall(r"\d+", counts)] * (
            len(listed) if "each" in counts else 1
        )
        for name, number in zip(listed, numbers, strict=True):
            found = load(builtin.experiment_path(name))
            egos = {
                case.name: [str(k) for k in range(case.egos.random or 0)]
                for case in found.cases
                if case.egos is not None
            }
            assert len(episodes(found, egos)) == number, name
        described.update(listed)
    assert {path.stem for path in BUILT_IN} == described


def test_a_configuration_by_what_it_holds(tmp_path: Path) -> None:
    (tmp_path / "mine.sumo.cfg").write_text("<configuration/>")
    with pytest.raises(
        ConfigError, match=r"scenarios\.0: egos: vehicle ids or {random: N} belong to a sumocfg"
    ):
        plan(tmp_path, "name: x\nscenarios: [mine.sumo.cfg]\n")
    found = plan(tmp_path, "name: x\nscenarios: [{sumocfg: mine.sumo.cfg, egos: [a]}]\n")
    assert [(case.name, case.base.sumo.sumocfg) for case in found.cases] == [
        ("mine_sumo", str(tmp_path / "mine.sumo.cfg"))
    ]
