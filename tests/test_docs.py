"""The documents say what is there: generated parts are up to date, files, functions and keys exist,
commands parse, examples are valid."""

import ast
import importlib
import json
import re
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml
from helpers_docs import COMMANDS, NAMED, commands_page, definitions
from helpers_scenes import PAGE as SCENES
from helpers_scenes import page as scenes_page
from typer.testing import CliRunner

from sumo_mcts import config
from sumo_mcts.cli import app
from sumo_mcts.commands import validate
from sumo_mcts.config import builtin
from sumo_mcts.config.docs import refreshed, schema_text, tables
from sumo_mcts.episode import run_episode
from sumo_mcts.evaluation import referee
from sumo_mcts.experiments import experiment
from sumo_mcts.records import ROW_KEYS
from sumo_mcts.reporting.results_page import blocks

TOP = Path(__file__).resolve().parent.parent
PAGES = [
    TOP / "README.md",
    TOP / "CHANGELOG.md",
    TOP / "CONTRIBUTING.md",
    *sorted((TOP / "docs").rglob("*.md")),
]
SECTIONS = config.json_schema()["properties"]
# What a run leaves behind, and files of the reader.
_NOT_HERE = ("manifests/", "out/", "traces/", "maps/", "figures/", "exports/")
_FILE = re.compile(r"[\w.-]+(?:/[\w.-]+)+\.(?:py|md|yaml|jsonl|json|toml|xml|gif|sumocfg)")


def pages(pattern: str) -> list[tuple[Path, str]]:
    """(page, first group) of every match, outside the generated tables."""
    return [
        (page, found)
        for page in PAGES
        for found in re.findall(pattern, page.read_text(encoding="utf-8"), re.MULTILINE)
    ]


def spans() -> list[tuple[Path, str]]:
    """Every code span."""
    return pages(r"(?<!`)`([^`\n]+)`(?!`)")


def fenced(language: str) -> list[Any]:
    """Every fenced example, as test parameters."""
    found = [
        (page.name, text)
        for page in PAGES
        for text in re.findall(
            rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL
        )
    ]
    return [pytest.param(text, id=f"{name}-{k}") for k, (name, text) in enumerate(found)]


def examples(of_experiments: bool) -> list[Any]:
    """The examples in YAML: experiments name scenarios, scenarios do not."""
    return [each for each in fenced("yaml") if ("\nscenarios:" in each.values[0]) == of_experiments]


def indented(program: str) -> list[Any]:
    """Every line of an indented example that calls the program, without its comment."""
    lines = pages(rf"^    ({program} (?:[^\n]*\\\n)*[^\n]*)$")
    return [
        pytest.param(
            shlex.split(line.replace("\\\n", " "), comments=True)[len(program.split()) :],
            id=f"{page.name}-{k}",
        )
        for k, (page, line) in enumerate(lines)
    ]


def exists(name: str, page: Path) -> bool:
    """Whether a file is there, seen from the page, from the top folder or from the package."""
    return any((folder / name).exists() for folder in (page.parent, TOP, TOP / "sumo_mcts"))


# --- generated ---


def test_the_tables_of_the_scenario_file_are_up_to_date() -> None:
    text = (TOP / "docs" / "scenario-file.md").read_text(encoding="utf-8")
    assert text == refreshed(text, config.json_schema()), "run python -m sumo_mcts.config.docs"


def test_the_schema_on_disk_is_up_to_date() -> None:
    assert (TOP / "configs" / "schema.json").read_text(encoding="utf-8") == schema_text(
        config.json_schema()
    ), "run python -m sumo_mcts.config.docs"


def test_the_schema_is_no_scenario() -> None:
    assert "schema" not in builtin.scenario_names()


def test_the_page_of_commands_is_up_to_date() -> None:
    assert COMMANDS.read_text(encoding="utf-8") == commands_page(app), (
        "run python tests/helpers_docs.py"
    )


def test_the_page_of_scenes_is_up_to_date() -> None:
    assert SCENES.read_text(encoding="utf-8") == scenes_page(), "run python tests/helpers_scenes.py"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_lines_are_short(page: Path) -> None:
    """At most 100 columns, but for tables, pictures, headings, examples and generated parts."""
    left_out = r"```.*?```|<!-- (keys|results): .*?<!-- end of \1 -->"  # examples, generated parts
    text = re.sub(left_out, "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert not [
        line
        for line in text.splitlines()
        if len(line) > 100 and not line.startswith(("|", "![", "#"))
    ]


def test_fences_are_such_that_the_site_knows() -> None:
    """A language and, at most, a title: with anything else the site shows the fence as text."""
    opened = [(page.name, line) for page, line in pages(r"^```([^`\n]+)$")]
    assert len(opened) > 30
    assert not [each for each in opened if not re.fullmatch(r'\w+( title="[\w./]+")?', each[1])]


def test_every_key_has_a_meaning_a_type_and_a_default() -> None:
    rows = [line for line in tables(config.json_schema()).splitlines() if line.startswith("| `")]
    for row in rows:
        _, key, kind, default, _, meaning, _ = (
            cell.strip() for cell in re.split(r"(?<!\\)\|", row)
        )
        assert key and kind and default and meaning, row
        assert kind != "None", row


# --- studies ---

_BLOCK = re.compile(r"^<!-- results: .*?^<!-- end of results -->$", re.DOTALL | re.MULTILINE)
_COMMAND = re.compile(r"^    (?:sumo-mcts|python) ", re.MULTILINE)
_COMMIT = re.compile(r"\b(?=[0-9a-f]*[0-9])[0-9a-f]{7}\b")


def without_source(text: str) -> list[str]:
    """The first lines of tables that are neither generated nor have their command between them and
    what stands before, and a commit in their section."""
    found = []
    for section in re.split(r"^#+ ", _BLOCK.sub("", text), flags=re.MULTILINE):
        texts_and_tables = re.split(r"((?:^\|.*\n)+)", section, flags=re.MULTILINE)
        for before, table in zip(texts_and_tables[::2], texts_and_tables[1::2], strict=False):
            told = _COMMAND.search(before) or "same command" in before
            if not ((told or "| command and commit |" in table) and _COMMIT.search(section)):
                found.append(table.splitlines()[0])
    return found


@pytest.mark.parametrize(
    "page", sorted((TOP / "docs" / "studies").glob("*.md")), ids=lambda page: page.name
)
def test_every_table_of_a_study_is_generated_or_has_its_command(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert without_source(text) == []
    assert len(blocks(text, page.name)) == len(_BLOCK.findall(text))
    assert all(_COMMAND.search(block) and "sources " in block for block in _BLOCK.findall(text))


def test_a_table_without_its_command_is_found() -> None:
    table, command = "| a |\n|---|\n| 1 |\n", "    sumo-mcts bench\n\n"
    whole = f"{command}{table}\nCommit 12ab34c.\n\n"
    generated = f"<!-- results: table study -->\n{table}<!-- end of results -->\n"
    assert without_source(f"# A\n\n{whole}## B\n\n{whole}{generated}") == []
    for wrong in (
        f"{command}{table}\nCommit.\n", f"Commit 12ab34c.\n\n{table}", f"{whole}{table}",
        f"{whole}\n## B\n\n{table}", f"{whole}\n## B\n\n{command}{table}",
    ):  # fmt: skip
        assert without_source(wrong) == ["| a |"], wrong


# --- files, functions, keys ---


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_named_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    links = {link for link in re.findall(r"\]\(([^)#]+)[^)]*\)", text) if "://" not in link}
    named = {name for name in _FILE.findall(text) if not name.startswith(_NOT_HERE)} | links
    named -= {
        name for name in named if name.startswith(("roads/", "courteous/", "learned/"))
    }  # made up in an example
    assert not [name for name in sorted(named) if not exists(name, page)]


def test_functions_named_exist() -> None:
    files = definitions(TOP / "sumo_mcts")
    named = [found for page in PAGES for found in NAMED.findall(page.read_text(encoding="utf-8"))]
    assert len(named) > 40
    assert not [f"{file}::{name}" for file, name in named if file not in files.get(name, [])], (
        "run python tests/helpers_docs.py"
    )


def test_the_layers_are_those_of_the_contract() -> None:
    text = (TOP / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = text.split("| layer | packages and modules |")[1].split("\n\n")[0]
    told = [set(re.findall(r"`(\w+)(?:/|\.py)`", line)) for line in table.splitlines()[2:]]
    contracts = tomllib.loads((TOP / "pyproject.toml").read_text(encoding="utf-8"))
    layers = contracts["tool"]["importlinter"]["contracts"][0]["layers"]
    assert told == [set(layer.split(" | ")) for layer in layers]


def test_keys_named_exist() -> None:
    schema = config.json_schema()
    sections = {
        key: schema["$defs"][field["$ref"].rsplit("/", 1)[-1]]["properties"]
        for key, field in SECTIONS.items()
        if "$ref" in field
    }
    dotted = [
        span
        for _, span in spans()
        if re.fullmatch(r"[a-z_]+\.[a-z_0-9]+", span) and not span.endswith(".py")
    ]
    named = [span.split(".") for span in dotted if span.split(".")[0] in sections]
    assert len(named) > 40
    assert not [".".join(parts) for parts in named if parts[1] not in sections[parts[0]]]


def test_every_key_of_the_row_is_explained() -> None:
    text = (TOP / "docs" / "measures.md").read_text(encoding="utf-8")
    assert not [key for key in ROW_KEYS if f"`{key}`" not in text]


def test_every_outcome_is_explained() -> None:
    text = (TOP / "docs" / "measures.md").read_text(encoding="utf-8")
    outcomes = (
        referee.ARRIVED,
        referee.COLLISION,
        referee.TELEPORTED,
        referee.OFF_ROUTE,
        referee.TIMEOUT,
        referee.ERROR,
    )
    assert not [outcome for outcome in outcomes if f"| `{outcome}` |" not in text]


def test_no_path_of_a_machine_is_named() -> None:
    assert not [
        (page.name, found) for page, found in pages(r"(?<!\w)((?:/home|/work|/tmp|/root|C:\\)\S*)")
    ]


# --- commands ---


@pytest.mark.parametrize("arguments", indented("sumo-mcts"))
def test_commands_parse(arguments: list[str]) -> None:
    group: Any = typer.main.get_command(app)
    name, *rest = arguments
    context = group.commands[name].make_context(
        name, rest
    )  # raises where an option or a value is wrong
    scenario = context.params.get("scenario")
    if scenario is not None and "." not in scenario:
        assert scenario in builtin.scenario_names()


@pytest.mark.parametrize("command", ["scenarios", "schema"])
def test_cheap_commands_run(command: str) -> None:
    assert CliRunner().invoke(app, [command]).exit_code == 0


def test_make_knows_the_targets_named() -> None:
    targets = set(
        re.findall(r"^([\w-]+):", (TOP / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    )
    assert {target for _, target in pages(r"^    make ([\w-]+)")} <= targets


# --- examples ---


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder in which an example finds what it names."""
    for name in ("networks", "routes", "configs"):
        (tmp_path / name).symlink_to(TOP / name)
    return tmp_path


@pytest.mark.parametrize("text", examples(of_experiments=False))
def test_scenario_examples_are_valid(text: str, checkout: Path) -> None:
    path = checkout / "example.yaml"
    path.write_text(text, encoding="utf-8")
    assert validate.problems_of(path) == []


@pytest.mark.parametrize("text", fenced("python"))
def test_python_examples_import_what_is_there(text: str) -> None:
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom):
            module = importlib.import_module(str(node.module))
            assert not [alias.name for alias in node.names if not hasattr(module, alias.name)]


@pytest.mark.parametrize("text", examples(of_experiments=True))
def test_experiment_examples_are_valid(text: str, tmp_path: Path) -> None:
    (tmp_path / "example.yaml").write_text(text, encoding="utf-8")
    plan = experiment.load(tmp_path / "example.yaml")
    assert (
        len(experiment.episodes(plan, {}))
        == sum(len(case.seeds) * len(plan.variants) for case in plan.cases)
        > 0
    )


@pytest.mark.slow
@pytest.mark.parametrize("text", examples(of_experiments=False))
def test_scenario_examples_run(text: str, checkout: Path) -> None:
    path = checkout / "example.yaml"
    path.write_text(text, encoding="utf-8")
    (row,) = run_episode(config.load(path, ("planner.iterations=300",)), 1).rows
    assert row["outcome"] == "arrived", row["error"]


def test_the_animation_is_small() -> None:
    picture = TOP / "docs" / "images" / "unprotected-left-turn.gif"
    assert picture.stat().st_size < 1_500_000


@pytest.mark.slow
def test_the_experiments_are_listed_with_what_they_are_about() -> None:
    found = json.loads(CliRunner().invoke(app, ["experiments", "--json"]).stdout)
    files = {
        path.stem: yaml.safe_load(path.read_text())
        for path in (builtin.root() / "configs" / "experiments").glob("*.yaml")
    }
    assert found == [
        {"name": name, "description": files[name]["description"]} for name in sorted(files)
    ]
    lines = CliRunner().invoke(app, ["experiments"]).stdout.splitlines()
    assert [line.split(None, 1) for line in lines] == [
        [item["name"], item["description"]] for item in found
    ]
    page = (builtin.root() / "docs" / "experiments.md").read_text()
    assert all(f"`{item['name']}`" in page for item in found)


def test_json_of_scenarios_names_them_all() -> None:
    found = json.loads(CliRunner().invoke(app, ["scenarios", "--json"]).stdout)
    assert sorted(item["name"] for item in found) == builtin.scenario_names()
