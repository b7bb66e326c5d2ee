"""What a batch refuses before its first episode."""

from concurrent.futures import Future
from pathlib import Path

import pytest
from helpers_batch import (
    GOOD,
    SMALL,
    network,
    write,
)

from sumo_mcts import config, run_batch
from sumo_mcts.config import builtin
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments.batch import listed
from sumo_mcts.experiments.experiment import load
from sumo_mcts.experiments.preparation import asked, kind
from sumo_mcts.experiments.problems import BatchError
from sumo_mcts.experiments.schema import Egos
from sumo_mcts.experiments.tasks import choose, rehearse
from sumo_mcts.experiments.workers import DeadWorkerError, SilentWorkerError, here


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
        asked(load(write(tmp_path)), "highway-exit", answer, crew, lambda _: None)


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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
        variant: kind(config)
        for variant, config in load(write(tmp_path, text)).cases[0].configs.items()
    }
    assert kinds["a"] == kinds["b"] == kinds["c"] != kinds["d"]
