"""Exports say what the trace says, and SUMO's own floating car data of the same episode say the
same."""

import csv
from pathlib import Path

import pytest
import sumolib
from helpers_recorded import of_a_scene

from sumo_mcts.episode import EpisodeResult, run_episode
from sumo_mcts.reporting import export
from sumo_mcts.road import RoadMap
from sumo_mcts.scene import Decision

SUMOS = "sumo.fcd.xml"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("export")


@pytest.fixture(scope="module")
def episode(folder: Path) -> EpisodeResult:
    return run_episode(
        of_a_scene("highway-exit"),
        3,
        sumo_options=("--fcd-output", str(folder / SUMOS), "--fcd-output.acceleration"),
    )


def road_of(episode: EpisodeResult) -> RoadMap:
    assert episode.road is not None
    return episode.road


def test_csv_has_a_row_for_every_cycle_and_vehicle(episode: EpisodeResult, tmp_path: Path) -> None:
    trace, road = episode.traces[0], road_of(episode)
    export.write_csv(tmp_path / "t.csv", trace, road)
    with (tmp_path / "t.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == export.COLUMNS
    expected = [
        (cycle.time, vehicle)
        for cycle in trace.cycles
        for vehicle in (cycle.ego.id, *cycle.agents.ids)
    ]
    assert [(float(row["time_s"]), row["vehicle"]) for row in rows] == expected
    for cycle, row in zip(trace.cycles, (row for row in rows if row["role"] == "ego"), strict=True):
        assert (float(row["x_m"]), float(row["v_mps"]), float(row["s_m"])) == (
            cycle.ego.x,
            cycle.ego.v,
            cycle.ego.s,
        )
        assert row["lane"] == road.lane_ids[cycle.ego.lane]
        assert (row["reason"], float(row["cost"])) == (
            cycle.decision.reason,
            cycle.decision.children[cycle.decision.chosen].best,
        )
    agents = [row for row in rows if row["role"] != "ego"]
    assert [float(row["y_m"]) for row in agents] == [
        y for cycle in trace.cycles for y in cycle.agents.y
    ]
    assert {row["reason"] for row in agents} == {""}


def test_fcd_is_what_sumo_writes_itself(
    episode: EpisodeResult, folder: Path, tmp_path: Path
) -> None:
    trace = episode.traces[0]
    export.write_fcd(tmp_path / "t.fcd.xml", trace, road_of(episode))
    ours, sumos = (
        {
            round(float(step.time), 2): {vehicle.id: vehicle for vehicle in step.vehicle or ()}
            for step in sumolib.xml.parse(str(path), "timestep")
        }
        for path in (tmp_path / "t.fcd.xml", folder / SUMOS)
    )
    assert list(ours) == [round(cycle.time - 0.1, 2) for cycle in trace.cycles]
    compared = 0
    for time, vehicles in ours.items():
        assert "ego" in vehicles
        for name, vehicle in vehicles.items():
            true = sumos[time][name]
            assert vehicle.lane == true.lane
            for key, within in (
                ("x", 0.011),
                ("y", 0.011),
                ("pos", 0.011),
                ("speed", 0.011),
                ("angle", 0.011),
                ("acceleration", 0.011),
            ):
                assert float(getattr(vehicle, key)) == pytest.approx(
                    float(getattr(true, key)), abs=within
                ), (time, name, key)
            compared += 1
    assert compared == sum(1 + len(cycle.agents.ids) for cycle in trace.cycles)


def test_people_and_whoever_is_on_no_lane_are_written_too(
    episode: EpisodeResult, tmp_path: Path
) -> None:
    cycle = next(cycle for cycle in episode.traces[0].cycles if len(cycle.agents.ids) > 1)
    agents = cycle.agents._replace(
        ids=('a<"&', *cycle.agents.ids[1:]),
        person=cycle.agents.person | True,
        lane=cycle.agents.lane * 0 - 1,
    )
    decision = Decision(cycle.decision.command, None, (), -1, "idm", 0, 0)
    trace = episode.traces[0]._replace(cycles=(cycle._replace(agents=agents, decision=decision),))
    export.write_fcd(tmp_path / "t.fcd.xml", trace, road_of(episode))
    (step,) = sumolib.xml.parse(str(tmp_path / "t.fcd.xml"), "timestep")
    assert [person.id for person in step.person] == list(agents.ids)
    assert [float(person.x) for person in step.person] == pytest.approx(
        agents.x.tolist(), abs=0.006
    )
    export.write_csv(tmp_path / "t.csv", trace, road_of(episode))
    with (tmp_path / "t.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["vehicle"], row["role"], row["lane"], row["cost"]) for row in rows[1:]] == [
        (name, "person", "", "") for name in agents.ids
    ]
