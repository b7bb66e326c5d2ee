"""The results in folders, merged: the rows, where their traces lie, and what is wrong with them."""

import re
import shlex
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sumo_mcts import records
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments.experiment import DECIDING
from sumo_mcts.records import ROW_KEYS, Row
from sumo_mcts.records.highlights import order
from sumo_mcts.records.measures import BY_KEY, MOST, PAIRING
from sumo_mcts.records.statistics import TWIN, place
from sumo_mcts.reporting.variants import planner_rank, twins_of

_SHARDS = 1_000_000  # that an experiment may have been cut into
_NAMED = 8  # names in a note


class Results(NamedTuple):
    """Episodes and what is known about them."""

    name: str  # of the experiment or the only scenario, else of the folder
    description: str
    # With every key of ROW_KEYS, and those of PAIRING that were there; by scenario, variant, seed,
    # ego.
    rows: tuple[Row, ...]
    traces: dict[str, Path]  # by the key of the row; only those that exist
    versions: dict[str, str]  # of the first folder that has them
    notes: tuple[str, ...]  # what a reader has to know about missing or broken things


def gather(folders: Sequence[Path]) -> Results:
    """All episodes of the folders; of those with the same key the last.

    Raises ConfigError where there is none. What cannot be read becomes a note.
    """
    rows: dict[str, Row] = {}
    traces: dict[str, Path] = {}
    notes: list[str] = []
    counts: list[int] = []
    for folder in folders:
        found, problems = _rows_of(folder)
        counts.append(len(found))
        notes += [*problems, *_replaced(folder, rows, found)]
        rows |= found
        traces = {key: path for key, path in traces.items() if key not in found} | _traces_of(
            folder, found
        )
    if not rows:
        raise ConfigError(notes[0] if notes else f"{folders[0]}: {records.ROWS}: no episode in it")
    manifests = [_manifest_of(folder, notes) for folder in folders]
    notes += [*_unfinished(folders, counts, manifests), *_other_shards(manifests)]
    scenarios, variants = (_order_in(manifests, key) for key in ("scenarios", "variants"))
    ordered = tuple(sorted(rows.values(), key=lambda row: _order(row, scenarios, variants)))
    return Results(
        *_title(folders, manifests, ordered),
        ordered,
        traces,
        _versions(manifests),
        (*notes, *_doubts(ordered, manifests)),
    )


def _order(row: Row, scenarios: Mapping[str, int], variants: Mapping[str, int]) -> tuple[Any, ...]:
    """As the experiment names them; what no experiment names comes after, by planner and name."""
    return (
        scenarios.get(row["scenario"], len(scenarios)),
        row["scenario"],
        variants.get(row["variant"], len(variants)),
        planner_rank(row["planner"]),
        _natural(row["variant"]),
        *order(row),
    )


def _natural(text: str) -> tuple[Any, ...]:
    """A sort key by which mcts-50 comes before mcts-1000."""
    return tuple(
        (part.isdecimal(), int(part) if part.isdecimal() else part) for part in text.split("-")
    )


# --- rows ---


def _rows_of(folder: Path) -> tuple[dict[str, Row], list[str]]:
    """The rows of a folder by key, and what is wrong with them."""
    if not folder.is_dir():
        raise ConfigError(f"{folder}: no such folder")
    named = f"{folder}: {records.ROWS}"
    try:
        lines, torn = records.rows_and_torn(folder)
    except OSError as error:
        return {}, [f"{named}: cannot be read: {error.strerror}"]
    if not lines and not torn and not (folder / records.ROWS).exists():
        return {}, [
            f"{named}: no such file; `sumo-mcts run` and `sumo-mcts batch` write one with --out"
        ]
    missing = Counter(key for line in lines for key in ROW_KEYS if key not in line)
    notes = []
    if torn:
        notes.append(
            f"{named}: {torn} of its lines {'is' if torn == 1 else 'are'} not a whole row, and "
            "left out"
        )
    if missing:
        notes.append(
            f"{named}: up to {max(missing.values())} of {len(lines)} rows are of another version, "
            f"without {some_of(list(missing))}"
        )
    latest = {line["key"]: line for line in lines}  # of the same key the last
    rows = {
        name: {
            key: _allowed(key, line.get(key))
            for key in (*ROW_KEYS, *(each.key for each in PAIRING if each.key in line))
        }
        for name, line in latest.items()
    }
    strange = dict.fromkeys(
        key
        for name, row in rows.items()
        for key, value in row.items()
        if value is None and latest[name].get(key) is not None
    )
    if strange:
        notes.append(
            f"{named}: values that their keys do not allow are left out: {some_of(list(strange))}"
        )
    if not rows:
        notes.append(f"{named}: no episode in it")
    return {str(row["key"]): row for row in rows.values()}, notes


def some_of(names: Sequence[str]) -> str:
    """The names, the first of many."""
    more = len(names) - _NAMED
    return ", ".join(names[:_NAMED]) + (f" and {more} more" if more > 0 else "")


def _allowed(key: str, value: Any) -> Any:
    """The value, or None where its measure does not allow it."""
    if not BY_KEY[key].is_within(value):
        return None
    return printable(value) if isinstance(value, str) else value


def printable(text: str) -> str:
    """The text with line breaks and control characters written out."""
    return (
        text
        if text.isprintable()
        else "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
    )


def _replaced(folder: Path, before: Mapping[str, Row], found: Mapping[str, Row]) -> list[str]:
    """A note about rows that replace rows of another scenario with the same name."""
    digests = [
        (before[key]["config_digest"], row["config_digest"])
        for key, row in found.items()
        if key in before
    ]
    others = sum(one is not None and other is not None and one != other for one, other in digests)
    if not others:
        return []
    said = "of its episodes replace those of the same key that were driven with other settings"
    return [f"{folder}: {others} {said}"]


def _unfinished(
    folders: Sequence[Path], counts: Sequence[int], manifests: Sequence[Mapping[str, Any]]
) -> list[str]:
    """A note about each batch that has not ended; `counts`: of the rows in each folder."""
    notes = []
    for folder, there, manifest in zip(folders, counts, manifests, strict=True):
        wanted = manifest.get("rows")
        if isinstance(wanted, int) and there < wanted <= MOST:
            notes.append(
                f"{folder}: {there} of the {wanted} rows of its batch are there; the command that "
                "began it goes on"
            )
    return notes


def _other_shards(manifests: Sequence[Mapping[str, Any]]) -> list[str]:
    """A note about shards of an experiment that are not among the folders."""
    there: dict[tuple[str, int], set[int]] = {}
    for manifest in manifests:
        number, count = _shard_of(manifest)
        if 1 <= number <= count <= _SHARDS:
            there.setdefault((str(manifest.get("experiment_digest")), count), set()).add(number)
    missing = {
        count: sorted(set(range(1, count + 1)) - found) for (_, count), found in there.items()
    }
    return [
        f"shard {some_of([f'{k}/{count}' for k in those])} of the experiment is not here"
        for count, those in missing.items()
        if those
    ]


def _shard_of(manifest: Mapping[str, Any]) -> tuple[int, int]:
    """The shard's number and how many there are; (0, 0): the manifest does not say."""
    match = re.fullmatch(r"([0-9]{1,9})/([0-9]{1,9})", str(manifest.get("shard", "")))
    return (0, 0) if match is None else (int(match[1]), int(match[2]))


def _doubts(rows: Sequence[Row], manifests: Sequence[Mapping[str, Any]]) -> list[str]:
    """Notes about what makes numbers doubtful."""
    of_twins = Counter(map(place, twins_of(rows)))
    several = sum(count > 1 for count in of_twins.values())
    doubts = []
    if several:
        said = f"episodes have several twins (planner {TWIN}); the first is the one compared with"
        doubts.append(f"{several} {said}")
    recorded = [
        manifest["versions"] for manifest in manifests if isinstance(manifest.get("versions"), dict)
    ]
    for name in DECIDING:
        found = list(
            dict.fromkeys(
                printable(str(versions[name])) for versions in recorded if versions.get(name)
            )
        )
        if len(found) > 1:
            doubts.append(
                f"the folders were written with different versions of {name}: {some_of(found)}"
            )
    return doubts


# --- manifests and traces ---


def _manifest_of(folder: Path, notes: list[str]) -> dict[str, Any]:
    """The manifest, empty where there is none; a note is added where it is broken."""
    try:
        manifest = records.read_manifest(folder)
    except FileNotFoundError:
        return {}
    except OSError:
        manifest = None
    if manifest is None:
        notes.append(f"{folder}: {records.MANIFEST}: not a manifest, and left out")
        return {}
    return manifest


def experiment_of(folder: Path) -> str | None:
    """The name of the experiment in a folder; None: it holds none."""
    told = _manifest_of(folder, []).get("experiment")
    name = told.get("name") if isinstance(told, dict) else None
    return printable(name) if isinstance(name, str) else None


def _order_in(manifests: Iterable[dict[str, Any]], key: str) -> dict[str, int]:
    """The place of each name under a key of the manifests, in their order."""
    names = dict.fromkeys(
        name
        for manifest in manifests
        if isinstance(manifest.get(key), dict)
        for name in manifest[key]
    )
    return {name: i for i, name in enumerate(names)}


def _title(
    folders: Sequence[Path], manifests: Iterable[dict[str, Any]], rows: Iterable[Row]
) -> tuple[str, str]:
    """Name and description: of the experiment, of the only scenario, else the folder's name."""
    scenarios = {row["scenario"] for row in rows}
    for manifest in manifests:
        for key in ("experiment", "scenario"):
            recorded = manifest.get(key)
            if (
                isinstance(recorded, dict)
                and isinstance(recorded.get("name"), str)
                and (key == "experiment" or scenarios == {recorded["name"]})
            ):
                return printable(recorded["name"]), printable(
                    str(recorded.get("description") or "")
                )
    return ", ".join(dict.fromkeys(folder.resolve().name for folder in folders)), ""


def _versions(manifests: Iterable[dict[str, Any]]) -> dict[str, str]:
    """The versions in the first manifest that has some."""
    versions: dict[Any, Any] = next(
        (
            manifest["versions"]
            for manifest in manifests
            if isinstance(manifest.get("versions"), dict)
        ),
        {},
    )
    return {
        printable(str(name)): printable(str(version))
        for name, version in versions.items()
        if version
    }


def commands(folders: Iterable[Path], rows: Iterable[Row]) -> list[str]:
    """The commands that wrote the folders, as a shell takes them, each once; only those recorded.

    A batch has one in its manifest, every episode of `run` one of its own.
    """
    keys = [row["key"] for row in rows]
    words = [
        told.get("command") for folder in folders for told in _manifests_that_tell(folder, keys)
    ]
    found = dict.fromkeys(
        printable(shlex.join(each))
        for each in words
        if isinstance(each, list) and each and all(isinstance(word, str) for word in each)
    )
    return list(found)


def _manifests_that_tell(folder: Path, keys: Iterable[str]) -> list[dict[str, Any]]:
    """The manifest of a batch; else those of the episodes, and of the last where none is kept."""
    whole = _manifest_of(folder, [])
    there = {path.stem for path in (folder / records.MANIFESTS).glob("*.json")}
    if "experiment" in whole or not there:
        return [whole]
    return [records.read_manifest_of(folder, key) for key in keys if key in there]


def _traces_of(folder: Path, keys: Iterable[str]) -> dict[str, Path]:
    """The traces that are there."""
    there = {path.stem: path for path in (folder / records.TRACES).glob("*.npz")}
    return {key: there[key] for key in keys if key in there}
