"""The table of measures is what rows, documentation and reports go by."""

from pathlib import Path

from helpers_recorded import of_a_scene

from sumo_mcts import records
from sumo_mcts.episode import run_episode
from sumo_mcts.experiments.experiment import episodes, load
from sumo_mcts.experiments.tasks import failed
from sumo_mcts.records.docs import refreshed
from sumo_mcts.records.measures import BY_KEY, COMPARED, MEASURES, PAIRING, TABLES, Count, Kind

TOP = Path(__file__).resolve().parents[2]
EXPERIMENT = """
name: two
scenarios: [unprotected-left-turn]
variants:
  constant: {planner.name: constant}
seeds: [1]
"""


def test_the_documentation_is_that_of_the_table() -> None:
    text = (TOP / "docs" / "measures.md").read_text(encoding="utf-8")
    assert text == refreshed(text), "run python -m sumo_mcts.records.docs"


def test_every_measure_is_explained_once() -> None:
    assert len(BY_KEY) == len(MEASURES) + len(PAIRING)
    assert len({measure.meaning for measure in BY_KEY.values()}) == len(BY_KEY)
    assert [each.key for each in BY_KEY.values() if not each.meaning.endswith(".")] == []


def test_every_column_of_a_report_is_a_measure_that_is_counted() -> None:
    shown = [key for keys in TABLES.values() for key in keys]
    assert len(set(shown)) == len(shown)
    assert [key for key in shown if BY_KEY[key].counted is None or not BY_KEY[key].label] == []
    assert set(COMPARED) <= set(TABLES["others"])
    counted = {measure.key for measure in MEASURES if measure.counted is not None}
    assert counted - set(shown) == {"at_fault"}, "which stands in the table of outcomes"
    assert {BY_KEY[key].counted for key in COMPARED} == {Count.EPISODES}


def test_units_are_those_of_the_keys() -> None:
    units = {"_mps3": "m/s³", "_mps2": "m/s²", "_m": "m", "_s": "s"}
    for measure in MEASURES:
        unit = next((unit for end, unit in units.items() if measure.key.endswith(end)), None)
        assert unit in (None, measure.unit), measure.key
        assert measure.kind is Kind.NUMBER or not measure.unit, measure.key


def test_every_row_made_has_these_keys_and_types(tmp_path: Path) -> None:
    """Of an episode, and of one of which nothing but an error is known."""
    (driven,) = run_episode(of_a_scene("unprotected-left-turn"), 3).rows
    (tmp_path / "e.yaml").write_text(EXPERIMENT)
    (lost,) = failed(episodes(load(tmp_path / "e.yaml"), {})[0], "a reason")
    assert tuple(driven) == records.ROW_KEYS
    assert set(lost) == set(BY_KEY)
    for row in (driven, lost):
        assert [key for key, value in row.items() if not BY_KEY[key].is_within(value)] == []
