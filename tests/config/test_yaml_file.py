"""YAML of which nothing is known ends in a value or in one line, at once."""

import json
import os
import socket
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sumo_mcts.config import parsed, yaml_file
from sumo_mcts.config.yaml_file import MOST_BYTES, MOST_DEPTH, MOST_VALUES, YamlError
from sumo_mcts.errors import ConfigError

PATIENCE_S = 20.0  # of a test machine; a file of the largest size takes some 4 s

VALUES = {
    "numbers": ("[1, 1.5, 1e-3, -2E5, .5, 010]", [1, 1.5, 0.001, -2e5, 0.5, 8]),
    "keys": (
        "{on: true, no: 1, '1': 2, 'null': 3, =: 4}",
        {"on": True, "no": 1, "1": 2, "null": 3, "=": 4},
    ),
    "merge": (
        "{x: &x {a: 1, b: 2}, y: {<<: *x, b: 3}}",
        {"x": {"a": 1, "b": 2}, "y": {"a": 1, "b": 3}},
    ),
    "merge of several": (
        "{x: &x {a: 1}, y: &y {a: 2, b: 2}, z: {<<: [*x, *y]}}",
        {"x": {"a": 1}, "y": {"a": 2, "b": 2}, "z": {"a": 1, "b": 2}},
    ),
    "signs that mean something elsewhere": ("[=, <<]", ["=", "<<"]),
    "nothing": ("# nothing", None),
    "as deep as is allowed": ("[" * MOST_DEPTH + "]" * MOST_DEPTH, None),
}

REFUSED = {
    "key twice": ("a: 1\nb: 2\na: 3", "line 3, column 1: a: given twice"),
    "key twice inside": ("a: {b: 1, c: {d: 1, d: 2}}", "line 1, column 21: d: given twice"),
    "key twice, once in quotes": ("{a: 1, 'a': 2}", "a: given twice"),
    "merge twice": ("{x: &x {a: 1}, y: {<<: *x, <<: *x}}", "<<: given twice"),
    "merge of a text": ("{<<: x}", "<<: has to be a mapping, or a list of mappings"),
    "date": ("a: 2001-99-99", "line 1, column 4: a date: allowed are texts (in quotes), numbers,"),
    "date that exists": ("a: 2001-09-09 10:00:00", "line 1, column 4: a date"),
    "code": (
        "!!python/object/apply:os.system [x]",
        "line 1, column 1: !!python/object/apply:os.system: allowed are texts",
    ),
    "set": ("!!set {a, b}", "!!set: allowed are"),
    "bytes": ("!!binary aGk=", "!!binary: allowed are"),
    "tag of its own": ("!x a", "line 1, column 1: !x: allowed are"),
    "number that is none": ("!!int x", "line 1, column 1: 'x': not a int"),
    "list as key": ("{[1]: 2}", "line 1, column 2: a key has to be a text"),
    "number as key": (
        "a: {3: 2}",
        "line 1, column 5: 3: a key has to be a text; write it in quotes",
    ),
    "truth as key": ("{True: 2}", "True: a key has to be a text; write it in quotes"),
    "null as key": ("{~: 2}", "~: a key has to be a text; write it in quotes"),
    "date as key": ("{2001-01-01: 2}", "2001-01-01: a key has to be a text"),
    "too deep": ("[" * 100_000, f"lists and mappings more than {MOST_DEPTH} deep"),
    "too deep in lines": (
        "\n".join(f"{' ' * k}a:" for k in range(100)),
        f"more than {MOST_DEPTH} deep",
    ),
    "too deep by aliases": (
        f"[&k0 [x], {', '.join(f'&k{k} [*k{k - 1}]' for k in range(1, 60))}]",
        f"more than {MOST_DEPTH} deep",
    ),
    "too many values": (f"[{'x,' * 400_000}]", f"more than {MOST_VALUES} values"),
    "too many by aliases": (
        "{k0: &k0 [x, x, x, x], "
        + ", ".join(f"k{k}: &k{k} [{','.join([f'*k{k - 1}'] * 10)}]" for k in range(1, 30))
        + "}",
        f"more than {MOST_VALUES} values",
    ),
    "too many by merges": (
        "{k0: &k0 {a: 1}, "
        + ", ".join(f"k{k}: &k{k} {{<<: [{','.join([f'*k{k - 1}'] * 10)}]}}" for k in range(1, 30))
        + "}",
        f"more than {MOST_VALUES} values",
    ),
    "itself": ("&a [*a]", "a value that contains itself"),
    "itself, merged": ("&a {<<: *a}", "a value that contains itself"),
    "digits": (f"a: {'1' * 5000}", "line 1, column 4: a number of more than 1000 digits"),
    "base 60": (f"a: 1{':1' * 300_000}", "a number of more than 1000 digits"),
    "too long": (" " * (MOST_BYTES + 1), f"more than {MOST_BYTES} characters"),
    "character that there is not": ('"\\UFFFFFFFF"', "line 1, column"),
    "half a character": ('a: "\\ud800"', "line 1, column 4: a text that is not Unicode"),
    "half a character in a key": ('"\\ud800": 1', "a text that is not Unicode"),
    "NUL": ("ok: 1\nb: \0", "line 2, column 4: a character that is not allowed"),
    "two documents": ("a: 1\n---\nb: 2", "line 2, column 1"),
    "unknown alias": ("*a", "line 1, column 1: found undefined alias"),
}


@pytest.mark.parametrize("case", VALUES)
def test_values(case: str) -> None:
    text, value = VALUES[case]
    assert yaml_file.parsed(text) == value or value is None


@pytest.mark.slow
@pytest.mark.parametrize("case", REFUSED)
def test_refused(case: str) -> None:
    text, said = REFUSED[case]
    began = time.monotonic()
    with pytest.raises(YamlError) as refused:
        yaml_file.parsed(text)
    assert said in str(refused.value)
    assert time.monotonic() - began < PATIENCE_S


def test_aliases_do_not_share() -> None:
    first, second = yaml_file.parsed("[&a {b: 1}, *a]")
    first["b"] = 2
    assert second == {"b": 1}


def test_files_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / "socket"))
        for name, said in {
            "folder": "a folder, not a file", "pipe": "a pipe, not a file",
            "socket": "a socket, not a file", "/dev/zero": "a device, not a file",
            "loop": "cannot be read: Too many levels of symbolic links",
            "dangling": "no such file", "a\0b": "no such file", "~": "no such file",
            "x" * 300: "cannot be read: File name too long", "folder/": "a folder, not a file",
        }.items():  # fmt: skip
            with pytest.raises(ConfigError) as refused:
                parsed(tmp_path / name)
            assert said in str(refused.value)
            assert str(refused.value).isprintable()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_that_may_not_be_read(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("a: 1")
    path.chmod(0)
    with pytest.raises(ConfigError, match="cannot be read: Permission denied"):
        parsed(path)


def test_encodings(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("a: é", encoding="utf-8-sig")
    assert parsed(path) == {"a": "é"}
    for encoding in ("utf-16", "utf-16-le", "utf-32", "latin-1"):
        path.write_text("a: é", encoding=encoding)
        with pytest.raises(ConfigError, match="not valid YAML: "):
            parsed(path)
    with path.open("wb") as file:
        file.truncate(1 << 40)  # takes no room on the disk
    with pytest.raises(ConfigError, match="more than 1 000 000 bytes"):
        parsed(path)


@given(st.text() | st.text("{}[]&*!|>-?:,#'\"%@`<= \n\tab01", max_size=60))
def test_any_text(text: str) -> None:
    try:
        value = yaml_file.parsed(text)
    except YamlError:
        return
    json.dumps(value, ensure_ascii=False).encode()
