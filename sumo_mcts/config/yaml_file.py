"""Reads YAML that may hold anything: bounded in size, depth and number of values.

Allowed is what JSON can say too. Keys are texts (`on` is a text, not a truth value), and no key
stands twice in a mapping.
"""

import re
from pathlib import Path
from typing import Any

import yaml

from sumo_mcts import files

MOST_BYTES = 1_000_000
MOST_DEPTH = 40  # lists and mappings inside each other
MOST_VALUES = 50_000  # what stands behind an alias counts as often as it is named
MOST_DIGITS = 1000  # of a number
_TAG = "tag:yaml.org,2002:"
_MERGE = f"{_TAG}merge"
_SCALARS = {f"{_TAG}{name}" for name in ("null", "bool", "int", "float", "str")}
_NUMBERS = {f"{_TAG}int", f"{_TAG}float"}
_TEXTS = {f"{_TAG}value", _MERGE}  # `=` and `<<` where they are no key
_EXPONENT = re.compile(r"^[-+]?[0-9]+[eE][-+]?[0-9]+$")
_Measure = tuple[int, int]  # of a node: how many values, and how deep


class YamlError(ValueError):
    """What is wrong with a text in YAML and where, in one line."""


def read(path: Path) -> Any:
    """What a file in YAML says.

    Raises OSError whose `strerror` says why it cannot be read, and YamlError.
    """
    data = files.content(path, MOST_BYTES)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise YamlError(f"byte {error.start + 1}: not a text in UTF-8") from None
    return parsed(text)


def parsed(text: str) -> Any:
    """The value that a text in YAML stands for.

    It is None, bool, int, float, str, or lists and dicts of these, each a new one. Raises
    YamlError.
    """
    if len(text) > MOST_BYTES:
        raise YamlError(f"more than {MOST_BYTES} characters")
    loader = None
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
        if node is None:
            return None
        _measure(node, {})
        return _value(loader, node)
    except YamlError:
        raise
    except yaml.reader.ReaderError as error:
        raise YamlError(
            f"{_place(text, error.position)}: a character that is not allowed"
        ) from None
    except yaml.MarkedYAMLError as error:
        raise _wrong(error.problem_mark or error.context_mark, str(error.problem)) from None
    # the library lets through what Python raises, of a character that there is not for example
    except Exception as error:
        raise _wrong(
            loader.get_mark() if loader is not None else None, " ".join(str(error).split())
        ) from None


class _Loader(yaml.SafeLoader):
    """Composes nodes, not deeper and not more than is allowed."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = self._count = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """As the library's, where there is room for one more."""
        self._depth, self._count = self._depth + 1, self._count + 1
        _require_small(self.peek_event(), self._count, self._depth - 1)  # type: ignore[no-untyped-call]  # the library has no types
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node


# A number in JSON, in YAML 1.2 and to readers. YAML 1.1, which the library reads, needs a point in
# it.
_Loader.add_implicit_resolver(f"{_TAG}float", _EXPONENT, list("-+0123456789"))


def _measure(node: yaml.Node, known: dict[int, _Measure | None]) -> _Measure:
    """How many values a node stands for and how deep they lie, aliases followed.

    Raises YamlError where that is too much, or has no end.
    """
    if id(node) in known:
        found = known[id(node)]
        if found is None:
            raise _wrong(node.start_mark, "a value that contains itself")
        return found
    known[id(node)] = None
    count, depth = 1, 0
    for child in _children(node):
        below = _measure(child, known)
        count, depth = count + below[0], max(depth, below[1] + 1)
        _require_small(node, count, depth)
    known[id(node)] = count, depth
    return count, depth


def _children(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [part for pair in node.value for part in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


def _require_small(where: Any, count: int, depth: int) -> None:
    """Raise YamlError where there are too many values, or they lie too deep."""
    if depth > MOST_DEPTH:
        raise _wrong(where.start_mark, f"lists and mappings more than {MOST_DEPTH} deep")
    if count > MOST_VALUES:
        raise _wrong(where.start_mark, f"more than {MOST_VALUES} values")


def _value(loader: _Loader, node: yaml.Node) -> Any:
    if isinstance(node, yaml.SequenceNode) and node.tag == f"{_TAG}seq":
        return [_value(loader, item) for item in node.value]
    if isinstance(node, yaml.MappingNode) and node.tag == f"{_TAG}map":
        return _mapping(loader, node)
    if isinstance(node, yaml.ScalarNode) and node.tag in _SCALARS | _TEXTS:
        return _scalar(loader, node)
    kind = "a date" if node.tag == f"{_TAG}timestamp" else node.tag.replace(_TAG, "!!")
    raise _wrong(
        node.start_mark,
        f"{kind}: allowed are texts (in quotes), numbers, true, false, null, lists and mappings",
    )


def _require_unicode(node: yaml.ScalarNode) -> None:
    """Raise YamlError where a text holds half of a character, as an escape may: no file could be
    written with it."""
    if any("\ud800" <= c <= "\udfff" for c in node.value):
        raise _wrong(node.start_mark, "a text that is not Unicode")


def _scalar(loader: _Loader, node: yaml.ScalarNode) -> Any:
    _require_unicode(node)
    if node.tag in _TEXTS:
        return node.value
    if node.tag in _NUMBERS and len(node.value) > MOST_DIGITS:
        raise _wrong(node.start_mark, f"a number of more than {MOST_DIGITS} digits")
    try:
        return loader.construct_object(node)
    except (ValueError, LookupError, OverflowError):  # a tag that says otherwise: !!int x
        raise _wrong(
            node.start_mark, f"{node.value!r:.40}: not a {node.tag.removeprefix(_TAG)}"
        ) from None


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[str, Any]:
    """A mapping with what `<<` merges into it, which its own keys override."""
    own: dict[str, Any] = {}
    merged: dict[str, Any] = {}
    for key, value in node.value:
        if not _is_text(key):
            raise _wrong(
                key.start_mark,
                f"{key.value!s:.40}: a key has to be a text; write it in quotes"
                if key.id == "scalar"
                else "a key has to be a text",
            )
        _require_unicode(key)
        if key.value in own or (key.tag == _MERGE and merged):
            raise _wrong(key.start_mark, f"{key.value}: given twice")
        if key.tag == _MERGE:
            merged = _merged(loader, value)
        else:
            own[key.value] = _value(loader, value)
    return {**merged, **own}


def _is_text(key: yaml.Node) -> bool:
    """Whether a key is a text; what YAML 1.1 alone takes for a truth value (on, off, yes, no) is
    one too."""
    if not isinstance(key, yaml.ScalarNode):
        return False
    return key.tag in {f"{_TAG}str", *_TEXTS} or (
        key.tag == f"{_TAG}bool" and key.value.lower() not in ("true", "false")
    )


def _merged(loader: _Loader, node: yaml.Node) -> dict[str, Any]:
    """The mappings that `<<` names, merged; of the same key the first one counts."""
    found: dict[str, Any] = {}
    for part in node.value if isinstance(node, yaml.SequenceNode) else [node]:
        if not isinstance(part, yaml.MappingNode):
            raise _wrong(part.start_mark, "<<: has to be a mapping, or a list of mappings")
        found = {**_mapping(loader, part), **found}
    return found


def _wrong(mark: Any, what: str) -> YamlError:
    return YamlError(
        what if mark is None else f"line {mark.line + 1}, column {mark.column + 1}: {what}"
    )


def _place(text: str, position: int) -> str:
    before = text[:position]
    return f"line {before.count(chr(10)) + 1}, column {position - before.rfind(chr(10))}"
