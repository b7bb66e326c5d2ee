"""What a user's .sumocfg asks for while egos are looked for, and which egos there can be."""

import gzip
from contextlib import closing
from pathlib import Path

import pytest

from sumo_mcts import config, load_scenario, records, run_batch
from sumo_mcts.episode import run_episode
from sumo_mcts.errors import ConfigError
from sumo_mcts.scenarios import list_candidates
from sumo_mcts.world.arguments import without_outputs
from sumo_mcts.world.candidates import require_named
from sumo_mcts.world.simulation import Simulation

FILES = Path(__file__).parent.parent / "bad_inputs"
NET = FILES.parent.parent / "networks" / "crossing" / "crossing.net.xml"
OUTPUTS = """
    <output><output-prefix value="mine_"/><fcd-output value="fcd.xml"/><summary value="summary.xml"/><tripinfo-output value="trips.xml"/></output>
    <report><log value="log.txt"/></report> <state><save-state.times value="1"/><save-state.prefix value="state"/></state>
"""
WRITTEN = {
    f"mine_{name}"
    for name in ("fcd.xml", "summary.xml", "trips.xml", "log.txt", "state_1.00.xml.gz")
}


def sumocfg(folder: Path, *, routes: str | None = None, more: str = "") -> Path:
    """A simulation of the crossing: one vehicle `ego` and one `other`, or what the routes say."""
    folder.mkdir(exist_ok=True)
    (folder / "mine.rou.xml").write_text(routes or (FILES / "one.rou.xml").read_text())
    path = folder / "mine.sumocfg"
    path.write_text(
        f'<configuration><net-file value="{NET}"/><route-files '
        f'value="mine.rou.xml"/>{more}</configuration>'
    )
    return path


def written(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()} - {"mine.rou.xml", "mine.sumocfg"}


@pytest.mark.slow
def test_only_an_episode_of_its_own_writes_what_the_user_asks_for(tmp_path: Path) -> None:
    path = sumocfg(tmp_path / "net", more=OUTPUTS)
    scenario = config.build(
        {"name": "mine", "sumo": {"sumocfg": str(path)}, "egos": [{"id": "ego"}]},
        "mine",
        ("planner.name=constant",),
    )
    assert [candidate.id for candidate in list_candidates(str(path), None, ())] == ["ego", "other"]
    assert written(path.parent) == set()
    experiment = tmp_path / "x.yaml"
    experiment.write_text(
        f"name: x\nscenarios: [{{sumocfg: {path}, egos: {{random: 1, seed: 1}}}}]\nvariants: "
        f"{{constant: {{planner.name: constant}}}}\n"
    )
    (batch,) = run_batch(experiment, tmp_path / "out", jobs=1)
    assert batch["outcome"] == "arrived"
    assert written(path.parent) == set()
    (alone,) = run_episode(
        scenario.model_copy(update={"egos": (config.EgoConfig(id=batch["ego"]),)})
    ).rows
    assert written(path.parent) == WRITTEN
    assert alone["trace_digest"] == batch["trace_digest"]
    assert (tmp_path / "out" / records.ROWS).is_file()


def test_what_is_given_on_the_command_line_stands(tmp_path: Path) -> None:
    sumo = config.SumoConfig(
        sumocfg=str(sumocfg(tmp_path, more=OUTPUTS)),
        options={"vehroutes": "routes.xml", "no-step-log": True},
    )
    assert without_outputs(sumo, ("--fcd-output", "fcd.xml", "--summary=s.xml", "--log", "l.txt",
    "--save-state.times", "1")) == [
        "--tripinfo-output", "/dev/null", "--vehroute-output", "/dev/null",
    ]  # fmt: skip


def test_nobody_departs_after_the_end(tmp_path: Path) -> None:
    late = '<vehicle id="{0}" depart="{0}"><route edges="from_west to_north"/></vehicle>'
    routes = f"<routes>{''.join(late.format(second) for second in range(0, 60, 10))}</routes>"
    path = sumocfg(tmp_path, routes=routes, more='<end value="25"/>')
    assert [candidate.id for candidate in list_candidates(str(path), None, ())] == ["0", "10", "20"]
    assert [candidate.id for candidate in list_candidates(str(path), None, ("--end", "35"))] == [
        "0",
        "10",
        "20",
        "30",
    ]
    scenario = config.build(
        {"name": "mine", "sumo": {"sumocfg": str(path)}, "egos": [{"id": "20"}, {"id": "40"}]},
        "mine",
        ("planner.name=sumo",),
    )
    on_its_way, too_late = run_episode(scenario).rows
    assert on_its_way["outcome"] == "arrived"
    assert on_its_way["travel_time_s"] > 5.0
    assert (too_late["outcome"], too_late["error"]) == (
        "error",
        (
            "never departed before the simulation's end at 25 s (SUMO's option end); the first that "
            "did: 0, 10, 20"
        ),
    )


def test_any_is_one_that_comes_to_the_goal(tmp_path: Path) -> None:
    ways = {
        "first": "from_west to_south",
        "second": "from_west to_north",
        "third": "from_west to_north",
    }
    vehicles = "".join(
        f'<vehicle id="{name}" depart="{k}"><route edges="{way}"/></vehicle>'
        for k, (name, way) in enumerate(ways.items())
    )
    path = sumocfg(tmp_path, routes=f"<routes>{vehicles}</routes>")
    assert load_scenario(path, ego="any").egos[0].id == "first"
    assert load_scenario(path, ego="any", until="to_north").egos[0].id == "second"
    with pytest.raises(
        ConfigError,
        match="--ego any: no suitable vehicle departs and passes edge to_east; without --ego the "
        "candidates are listed",
    ):
        load_scenario(path, ego="any", until="to_east")


FLOWS = """<routes>
    <vType id="car"/> <flow id="a-b" begin="0" number="2" period="5"><route edges="from_west to_north"/></flow>
    <person id="p0" depart="0"><personTrip from="from_west" to="to_north" modes="car"/></person>
</routes>"""


@pytest.mark.parametrize("ego", ["a-b.0", "a-b.99", "p0_0", "actor"])
@pytest.mark.parametrize("packed", [False, True])
def test_egos_that_sumo_could_make(ego: str, packed: bool, tmp_path: Path) -> None:
    path = sumocfg(tmp_path, routes=FLOWS)
    if packed:
        (tmp_path / "mine.rou.xml").unlink()
        (tmp_path / "mine.rou.xml.gz").write_bytes(gzip.compress(FLOWS.encode()))
        path.write_text(path.read_text().replace("rou.xml", "rou.xml.gz"))
    with closing(Simulation(["-c", str(path)])):
        require_named("egos", [ego], ["actor"])
        with pytest.raises(
            ConfigError,
            match=r"egos: a-c\.0: no file of the simulation names such a vehicle; near: a-b",
        ):
            require_named("egos", [ego, "a-c.0"], ["actor"])


def test_whom_an_included_file_names_is_not_known(tmp_path: Path) -> None:
    path = sumocfg(tmp_path, routes='<routes><include href="further.rou.xml"/></routes>')
    (tmp_path / "further.rou.xml").write_text((FILES / "one.rou.xml").read_text())
    with closing(Simulation(["-c", str(path)])):
        require_named("egos", ["ego", "whoever"], [])
