"""Numbers, names and sizes of a scenario have bounds, and whatever else stands there is refused in
one line."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from helpers_fuzz import refusal
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.config import ScenarioConfig, build, json_schema, load
from sumo_mcts.config.builtin import root
from sumo_mcts.errors import ConfigError, printable
from sumo_mcts.experiments.schema import Experiment

LOWEST, HIGHEST = ("minimum", "exclusiveMinimum"), ("maximum", "exclusiveMaximum")


def fine() -> dict[str, Any]:
    return {"name": "x", "sumo": {"net": "x.net.xml"}, "egos": [{"id": "ego"}]}


def numbers(part: Any, path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every number in a JSON schema, with where it stands."""
    if isinstance(part, dict):
        if part.get("type") in ("number", "integer"):
            yield path, part
        for key, below in part.items():
            yield from numbers(below, f"{path}.{key}")
    elif isinstance(part, list):
        for k, below in enumerate(part):
            yield from numbers(below, f"{path}.{k}")


@pytest.mark.parametrize("model", [ScenarioConfig, Experiment])
def test_every_number_has_bounds(model: Any) -> None:
    # the values of a seed are checked where they are read: ranges are among them
    found = [
        (path, part)
        for path, part in numbers(model.model_json_schema())
        if not re.search(r"\.seeds\.", path)
    ]
    assert len(found) > (100 if model is ScenarioConfig else 1)
    assert [path for path, part in found if not any(key in part for key in LOWEST)] == []
    assert [path for path, part in found if not any(key in part for key in HIGHEST)] == []


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("planner.iterations=true", "planner.iterations: has to be a whole number, got True"),
        ("planner.iterations='12'", "planner.iterations: has to be a whole number, got '12'"),
        ("planner.iterations=1.5", "planner.iterations: has to be a whole number, got 1.5"),
        ("planner.iterations=1000000000", "planner.iterations: has to be at most 1000000"),
        ("planner.iterations=99999999999999999999999999", ("planner.iterations: has to be at most "
                                                          "1000000")),
        (f"planner.iterations={10**400}", "planner.iterations: has to be "),
        (f"cost.headway={10**400}", "cost.headway: has to be "),
        ("planner.look_ahead_steps=1000000000", "planner.look_ahead_steps: has to be at most 12"),
        ("planner.period_s=1e-300", "planner.period_s: has to be at least 0.01"),
        ("planner.period_s=true", "planner.period_s: has to be a number, got True"),
        ("planner.adaptive=1", "planner.adaptive: has to be true or false, got 1"),
        ("cost.headway=1e308", "cost.headway: has to be at most 1000000"),
        ("cost.headway=-.inf", "cost.headway: has to be a"),
        ("sensor.range_m=1e300", "sensor.range_m: has to be at most 10000"),
        ("prediction.step_s=0.01", ("prediction.step_s: with planner.look_ahead_steps, "
                                   "planner.rollout_steps and planner.step_s a forecast of 3600 "
                                   "states")),
        ("traffic.crowd.count=[0, 100000]", "traffic.crowd.count.1: has to be at most 500"),
        ("sumo.options={scale: 1e300}", ("sumo.options.scale: has to be a number from -1000000000 "
                                        "to 1000000000")),
        ("egos=[{id: 'a b'}]", "egos.0.id: has to be a text of 1 to 500 characters without spaces"),
        ('egos=[{id: "a\\u001b[31m"}]', ("egos.0.id: has to be a text of 1 to 500 characters "
                                        "without spaces")),
        ("egos=[{id: []}]", "egos.0.id: has to be a text"),
        ("egos=[{id: a, connected: 1}]", "egos.0.connected: has to be true or false, got 1"),
        ("sumo.routes=[1]", "sumo.routes.0: has to be a text, got 1"),
        (".".join(["planner", "options", *"a" * 50]) + "=1", "a key of more than 40 parts"),
        ("name=2001-01-01", "the value is not valid YAML: line 1, column 1: a date"),
    ],
)  # fmt: skip
def test_refused(override: str, said: str) -> None:
    longest = (
        ("planner.look_ahead_steps=12", "planner.rollout_steps=24")
        if override.startswith("prediction.step_s")
        else ()
    )
    with pytest.raises(ConfigError) as refused:
        build(fine(), "x.yaml", (*longest, override))
    assert said in str(refused.value)
    assert len(str(refused.value)) < 2100


@pytest.mark.parametrize("text", ["1e-3", "1E-3", "+1e-3", "0.001"])
def test_numbers_as_readers_write_them(text: str) -> None:
    assert build(fine(), "x.yaml", (f"cost.jerk={text}",)).cost.jerk == 0.001


def test_every_mistake_is_known() -> None:
    with pytest.raises(ConfigError) as refused:
        build({**fine(), "planer": 1, "cost": {"jerk": -1}, "name": "a b"}, "x.yaml")
    assert len(refused.value.every) == 3
    assert str(refused.value) == f"{refused.value.every[0]} (and 2 more)"
    assert all(line.startswith("x.yaml: ") for line in refused.value.every)


def test_a_value_that_is_long_is_shortened() -> None:
    with pytest.raises(ConfigError) as refused:
        build({**fine(), "description": ["x" * 100_000]}, "x.yaml")
    assert len(str(refused.value)) < 300


def test_egos_plan_by_themselves_unless_they_are_connected() -> None:
    alone, told = build(fine(), "x.yaml", ("egos=[{id: a}, {id: b, connected: true}]",)).egos
    assert (alone.connected, told.connected) == (False, True)


def test_base_by_name(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("base: straight-line\nname: mine\n")
    found = load(path)
    assert (found.name, found.sumo, found.traffic) == (
        "mine",
        (built_in := load(root() / "configs" / "straight-line.yaml")).sumo,
        built_in.traffic,
    )
    (tmp_path / "straight-line").write_text(
        "name: beside\nsumo: {net: beside.net.xml}\negos: [{id: ego}]\n"
    )
    assert load(path).sumo.net == str(tmp_path / "beside.net.xml")


@pytest.mark.parametrize(
    "base",
    [
        "nowhere",
        "../configs/../x",
        "[1]",
        "''",
        ".",
        "/dev/zero",
        "'a\\0b'",
        f"{'x' * 300}",
        "{a: 1}",
        "~",
        "1",
    ],
)
def test_a_base_that_is_none(base: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(f"base: {base}\nname: mine\n")
    with pytest.raises(ConfigError, match=r"mine\.yaml: base: "):
        load(path)


def test_bases_without_end(tmp_path: Path) -> None:
    for k in range(50):
        (tmp_path / f"{k}.yaml").write_text(f"base: {k + 1}.yaml\n")
    with pytest.raises(ConfigError, match="base: more than 20 files"):
        load(tmp_path / "0.yaml")


def test_entries_whose_id_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("base: straight-line\negos: [{id: [1]}]\n")
    with pytest.raises(ConfigError, match=r"egos\.0\.id: has to be a text"):
        load(path)


SCALAR = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20)
JSON: st.SearchStrategy[object] = st.deferred(
    lambda: (
        SCALAR
        | st.lists(JSON, max_size=3)
        | st.dictionaries(st.text(max_size=10), JSON, max_size=3)
    )
)
KEYS = sorted(
    key for section in json_schema()["$defs"].values() for key in section.get("properties", {})
)


@pytest.mark.slow
@given(
    st.sampled_from([*ScenarioConfig.model_fields, "base"]),
    st.dictionaries(st.sampled_from(KEYS), JSON, max_size=4) | JSON,
)
def test_any_value(key: str, value: object) -> None:
    said = refusal(lambda: build({**fine(), key: value}, "x.yaml"))
    assert said == "" or (said.isprintable() and len(said) < 2100)


@given(st.text())
def test_messages_are_printable(text: str) -> None:
    once = printable(text)
    assert once.isprintable()
    assert printable(once) == once
    once.encode()
