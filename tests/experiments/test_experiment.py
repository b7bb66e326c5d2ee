"""An experiment file stands for the episodes that it says."""

from itertools import chain
from pathlib import Path

import pytest
from helpers_batch import GOOD, plan
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts import config
from sumo_mcts.config import builtin
from sumo_mcts.experiments.experiment import Plan, episodes, load, shard

BUILT_IN = sorted((builtin.root() / "configs" / "experiments").glob("*.yaml"))
SCENES = "name: x\nscenarios: [highway-exit]\n"


def keys(found: Plan, egos: dict[str, tuple[str, ...]] | None = None) -> list[str]:
    return [key for episode in episodes(found, egos or {}) for key in episode.keys]


@pytest.mark.parametrize("path", BUILT_IN, ids=lambda path: path.stem)
def test_built_in_experiments(path: Path) -> None:
    found = load(path)
    assert found.experiment.name == path.stem
    assert found.experiment.description
    assert builtin.experiment_path(path.stem) == path


def test_the_fixed_table_is_fixed_and_knows_the_scripts() -> None:
    for name, planner in (("table1", "paper"), ("table1-mcts", "mcts")):
        for episode in episodes(load(builtin.experiment_path(name)), {}):
            assert (
                episode.config.planner.name,
                episode.config.prediction.name,
                episode.config.traffic.vary,
            ) == (planner, "script", 0.0)


def test_a_configuration_is_that_of_run(tmp_path: Path) -> None:
    text = (
        SCENES
        + "set: {cost.jerk: 0.1, planner.iterations: 5}\nvariants: {a: {planner.iterations: 7, "
        "planner.accelerations_mps2: [-2, 0, 0.00001]}}\n"
    )
    (episode,) = episodes(plan(tmp_path, text), {})
    assignments = (
        "cost.jerk=0.1",
        "planner.iterations=7",
        "planner.accelerations_mps2=[-2, 0, 0.00001]",
    )
    assert episode.config == config.load(builtin.scenario_path("highway-exit"), assignments)


def test_variants_times_sweep_times_seeds(tmp_path: Path) -> None:
    text = """
name: x
scenarios: [highway-exit, {scenario: straight-line, seeds: [7]}]
variants: {mcts: {}, idm: {planner.name: idm}}
sweep: {planner.iterations: [100, 1000], cost.jerk: [0.5]}
seeds: [0..1, 4]
twins: true
"""
    variants = [
        "mcts-iterations-100-jerk-0.5",
        "mcts-iterations-1000-jerk-0.5",
        "idm-iterations-100-jerk-0.5",
        "idm-iterations-1000-jerk-0.5",
        "sumo",
    ]
    expected = [[f"highway-exit--{variant}--{seed}" for variant in variants] for seed in (0, 1, 4)]
    expected.insert(1, [f"straight-line--{variant}--7" for variant in variants])
    found = plan(tmp_path, text)
    assert keys(found) == list(chain(*expected))
    by_key = {episode.keys[0]: episode for episode in episodes(found, {})}
    assert by_key["highway-exit--idm-iterations-100-jerk-0.5--4"].config.planner.iterations == 100
    assert by_key["highway-exit--sumo--0"].config.planner.name == "sumo"
    assert by_key["highway-exit--sumo--0"].config.cost.jerk == 0.005


def test_sweeping_two_keys_with_one_last_part(tmp_path: Path) -> None:
    found = plan(tmp_path, SCENES + "sweep: {planner.step_s: [1], paper.step_s: [1]}\n")
    assert list(found.variants) == ["default-planner.step_s-1-paper.step_s-1"]


def test_twins_that_are_there_already(tmp_path: Path) -> None:
    found = plan(
        tmp_path, SCENES + "variants: {mcts: {}, sumo: {planner.name: sumo}}\ntwins: true\n"
    )
    assert list(found.variants) == ["mcts", "sumo"]


def test_egos_of_a_network_are_an_episode_each(tmp_path: Path) -> None:
    text = (
        f"name: x\nscenarios: [{{sumocfg: {GOOD}, egos: [other, ego], name: mine}}]\nvariants: "
        f"{{a: {{}}, b: {{}}}}\n"
    )
    found = plan(tmp_path, text)
    assert keys(found, {"mine": ("other", "ego")}) == [
        "mine--a--own--other",
        "mine--b--own--other",
        "mine--a--own--ego",
        "mine--b--own--ego",
    ]
    assert {episode.seed for episode in episodes(found, {"mine": ("other", "ego")})} == {
        None
    }  # the file's own
    assert {episode.measured for episode in episodes(found, {"mine": ("other", "ego")})} == {
        ("ego", "other")
    }


def test_egos_of_a_scenario_file_share_an_episode(tmp_path: Path) -> None:
    (tmp_path / "two.yaml").write_text(
        f"base: {builtin.scenario_path('highway-exit')}\nname: two\negos: [{{id: ego}}, {{id: "
        "left_lane}]\n"
    )
    (episode,) = episodes(plan(tmp_path, "name: x\nscenarios: [two.yaml]\n"), {})
    assert episode.keys == ("two--default--0--ego", "two--default--0--left_lane")


def test_the_digest_knows_what_is_driven(tmp_path: Path) -> None:
    first = plan(tmp_path, SCENES).digest
    assert plan(tmp_path, SCENES + "description: words\n").digest == first
    for more in (
        "seeds: 0..1\n",
        "set: {cost.jerk: 0.1}\n",
        "variants: {a: {}}\n",
        "twins: true\n",
    ):
        assert plan(tmp_path, SCENES + more).digest != first
    mine = tmp_path / "mine.yaml"
    digests = set()
    for jerk in (0.1, 0.2):
        mine.write_text(f"base: {builtin.scenario_path('highway-exit')}\ncost: {{jerk: {jerk}}}\n")
        digests.add(plan(tmp_path, "name: x\nscenarios: [mine.yaml]\n").digest)
    assert len(digests) == 2


@given(st.integers(1, 12))
def test_each_episode_is_in_one_shard(count: int) -> None:
    found = episodes(load(builtin.experiment_path("quick")), {})
    parts = [shard(found, number, count) for number in range(1, count + 1)]
    assert sorted(episode.keys for part in parts for episode in part) == sorted(
        episode.keys for episode in found
    )
    assert all(part == [episode for episode in found if episode in part] for part in parts)


def test_shards_are_of_about_one_size() -> None:
    found = episodes(load(builtin.experiment_path("table1")), {})
    assert all(abs(len(shard(found, number, 8)) - 450) < 100 for number in range(1, 9))
