"""What folders of results hold, merged: the rows, where their traces lie, and what is wrong with them."""

import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sumo_mcts import records
from sumo_mcts.config import ConfigError
from sumo_mcts.experiments.experiment import DECIDING
from sumo_mcts.experiments.statistics import TRAFFIC_DIGEST, TWIN, place
from sumo_mcts.experiments.worth import order
from sumo_mcts.records import ROW_KEYS, Row

_TEXTS = ("key", "scenario", "variant", "planner", "prediction", "ego", "outcome", "error", "trace_digest", "config_digest", TRAFFIC_DIGEST)
_TRUTHS = ("at_fault", "inevitable", "in_time")
_ORDER = ("mcts", "paper", "exhaustive")  # planners in the order in which they are shown; then all others,
_LAST = ("idm", "random", "constant", TWIN)  # and these at the end


class Results(NamedTuple):
    """Episodes and what is known about them."""

    name: str  # of the experiment or the only scenario, else of the folder
    description: str
    rows: tuple[Row, ...]  # every key of ROW_KEYS, and TRAFFIC_DIGEST of a batch; by scenario, variant, seed, ego
    traces: dict[str, Path]  # by the key of the row; only those that exist
    versions: dict[str, str]  # of the first folder that tells
    notes: tuple[str, ...]  # what a reader has to know about missing or broken things


def gather(folders: Sequence[Path]) -> Results:
    """All episodes of the folders; of those with the same key the last. Raises ConfigError where there is none, OSError where one cannot be read."""
    rows: dict[str, Row] = {}
    traces: dict[str, Path] = {}
    notes: list[str] = []
    counts: list[int] = []
    for folder in folders:
        found, problems = _rows_of(folder)
        counts.append(len(found))
        notes += [*problems, *_replaced(folder, rows, found)]
        rows |= found
        traces = {key: path for key, path in traces.items() if key not in found} | _traces_of(folder, found)
    if not rows:
        raise ConfigError(notes[0] if notes else f"{folders[0]}: {records.ROWS}: no episode in it")
    manifests = [_manifest_of(folder, notes) for folder in folders]
    notes += [*_unfinished(folders, counts, manifests), *_other_shards(manifests)]
    scenarios, variants = (_order_in(manifests, key) for key in ("scenarios", "variants"))
    ordered = tuple(sorted(rows.values(), key=lambda row: _order(row, scenarios, variants)))
    return Results(*_title(folders, manifests, ordered), ordered, traces, _versions(manifests), (*notes, *_doubts(ordered, manifests)))


def planner_rank(planner: str | None) -> int:
    """Where a planner stands in tables and figures."""
    name = planner or ""
    return _ORDER.index(name) if name in _ORDER else len(_ORDER) + 1 + _LAST.index(name) if name in _LAST else len(_ORDER)


def _order(row: Row, scenarios: Mapping[str, int], variants: Mapping[str, int]) -> tuple[Any, ...]:
    """As the experiment names them; what no experiment names comes after, by planner and name."""
    place_of = scenarios.get(row["scenario"], len(scenarios)), row["scenario"], variants.get(row["variant"], len(variants))
    who = planner_rank(row["planner"]), _natural(row["variant"])
    return *place_of, *who, *order(row)


def _natural(text: str) -> tuple[Any, ...]:
    """So that mcts-50 comes before mcts-1000."""
    return tuple((part.isdecimal(), int(part) if part.isdecimal() else part) for part in text.split("-"))


# --- rows ---


def _rows_of(folder: Path) -> tuple[dict[str, Row], list[str]]:
    """The rows of a folder by key, and what is wrong with them."""
    if not folder.is_dir():
        raise ConfigError(f"{folder}: no such folder")
    if not (folder / records.ROWS).is_file():
        return {}, [f"{folder}: {records.ROWS}: no such file; `sumo-mcts run` and `sumo-mcts batch` write one with --out"]
    lines, torn = records.rows_and_torn(folder)
    missing = Counter(key for line in lines for key in ROW_KEYS if key not in line)
    notes = []
    if torn:
        notes.append(f"{folder}: {records.ROWS}: {torn} of its lines {'is' if torn == 1 else 'are'} not a whole row, and left out")
    if missing:
        notes.append(f"{folder}: {records.ROWS}: up to {max(missing.values())} of {len(lines)} rows are of another version, without {', '.join(missing)}")
    rows = {line["key"]: {key: _kind(key, line.get(key)) for key in (*ROW_KEYS, *({TRAFFIC_DIGEST} & line.keys()))} for line in lines}
    if not rows:
        notes.append(f"{folder}: {records.ROWS}: no episode in it")
    return rows, notes


def _kind(key: str, value: Any) -> Any:
    """The value, or None where it is not of the key's kind."""
    if key in _TEXTS:
        return value if isinstance(value, str) else None
    if key in _TRUTHS:
        return value if isinstance(value, bool) else None
    return value if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max else None


def _replaced(folder: Path, before: Mapping[str, Row], found: Mapping[str, Row]) -> list[str]:
    """A word about rows that take the place of the rows of other scenarios, which were of the same name."""
    digests = [(before[key]["config_digest"], row["config_digest"]) for key, row in found.items() if key in before]
    others = sum(one is not None and other is not None and one != other for one, other in digests)
    return [f"{folder}: {others} of its episodes replace those of the same key that were driven with other settings"] if others else []


def _unfinished(folders: Sequence[Path], counts: Sequence[int], manifests: Sequence[Mapping[str, Any]]) -> list[str]:
    """A word about each batch that has not ended; `counts`: of the rows in its folder."""
    notes = []
    for folder, there, manifest in zip(folders, counts, manifests, strict=True):
        wanted = manifest.get("rows")
        if isinstance(wanted, int) and there < wanted:
            notes.append(f"{folder}: {there} of the {wanted} rows of its batch are there; the command that began it goes on")
    return notes


def _other_shards(manifests: Sequence[Mapping[str, Any]]) -> list[str]:
    """A word about shards of an experiment that are not among the folders."""
    there: dict[tuple[str, int], set[int]] = {}
    for manifest in manifests:
        number, _, count = str(manifest.get("shard", "")).partition("/")
        if number.isdecimal() and count.isdecimal():
            there.setdefault((str(manifest.get("experiment_digest")), int(count)), set()).add(int(number))
    missing = {count: sorted(set(range(1, count + 1)) - found) for (_, count), found in there.items()}
    return [f"shard {', '.join(f'{k}/{count}' for k in those)} of the experiment is not here" for count, those in missing.items() if those]


def _doubts(rows: Sequence[Row], manifests: Sequence[Mapping[str, Any]]) -> list[str]:
    """What makes numbers doubtful."""
    of_twins = Counter(place(row) for row in rows if row["planner"] == TWIN)
    several = sum(count > 1 for count in of_twins.values())
    doubts = [f"{several} episodes have several twins (planner {TWIN}); the first of them is the one compared with"] if several else []
    told = [manifest["versions"] for manifest in manifests if isinstance(manifest.get("versions"), dict)]
    for name in DECIDING:
        found = list(dict.fromkeys(str(versions[name]) for versions in told if versions.get(name)))
        if len(found) > 1:
            doubts.append(f"the folders were written with different versions of {name}: {', '.join(found)}")
    return doubts


# --- manifests and traces ---


def _manifest_of(folder: Path, notes: list[str]) -> dict[str, Any]:
    """The manifest, empty where there is none that can be read; a word in `notes` where it is broken."""
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


def _order_in(manifests: Iterable[dict[str, Any]], key: str) -> dict[str, int]:
    """The number of each name under a key of the manifests, in the order in which they stand there."""
    names = dict.fromkeys(name for manifest in manifests if isinstance(manifest.get(key), dict) for name in manifest[key])
    return {name: i for i, name in enumerate(names)}


def _title(folders: Sequence[Path], manifests: Iterable[dict[str, Any]], rows: Iterable[Row]) -> tuple[str, str]:
    """Name and description: of the experiment, of the only scenario, else the folder's name."""
    scenarios = {row["scenario"] for row in rows}
    for manifest in manifests:
        for key in ("experiment", "scenario"):
            told = manifest.get(key)
            if isinstance(told, dict) and isinstance(told.get("name"), str) and (key == "experiment" or scenarios == {told["name"]}):
                return told["name"], str(told.get("description") or "")
    return ", ".join(dict.fromkeys(folder.resolve().name for folder in folders)), ""


def _versions(manifests: Iterable[dict[str, Any]]) -> dict[str, str]:
    """What it ran on, by the first manifest that says so."""
    told: dict[Any, Any] = next((manifest["versions"] for manifest in manifests if isinstance(manifest.get("versions"), dict)), {})
    return {str(name): str(version) for name, version in told.items() if version}


def _traces_of(folder: Path, keys: Iterable[str]) -> dict[str, Path]:
    """The traces that are there."""
    there = {path.stem: path for path in (folder / records.TRACES).glob("*.npz")}
    return {key: there[key] for key in keys if key in there}
