"""The folder of a batch: which batch it belongs to, which rows it holds; one writer at a time."""

import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from shutil import rmtree
from typing import Any

from sumo_mcts import records
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments.experiment import DECIDING, Episode
from sumo_mcts.records import MANIFEST, MAPS, ROWS, TABLE, TRACES, Row

try:
    import fcntl
except ImportError:  # on Windows
    fcntl = None  # type: ignore[assignment]

# what --fresh removes; last the manifest, which says that it may
_LEFT_BEHIND = (ROWS, TABLE, TRACES, MAPS, "tables", "report.html", "report.md", MANIFEST)

_KINDS = {  # of the manifest's values
    "experiment": dict,
    "experiment_digest": str,
    "shard": str,
    "versions": dict,
    "plugins": list,
    "files": dict,
    "egos": dict,
}


@contextmanager
def only_here(folder: Path, patience_s: float = 0.0) -> Iterator[None]:
    """No other run or batch works in the folder meanwhile, on this machine.

    Raises ConfigError where one does so for longer than `patience_s`.
    """
    if fcntl is None:
        yield
        return
    made = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    number = os.open(folder, os.O_RDONLY)
    try:
        _lock(number, folder, time.monotonic() + patience_s)
        yield
    finally:
        os.close(number)
        if made:
            with suppress(OSError):
                folder.rmdir()  # only where nothing came into it


def _lock(number: int, folder: Path, until: float) -> None:
    """Lock the folder, until the descriptor is closed or the process ends. Raises ConfigError at
    `until` (time.monotonic())."""
    while True:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            if time.monotonic() >= until:
                raise ConfigError(
                    f"--out {folder}: another run or batch is at work there"
                ) from None
        time.sleep(0.05)


def clear(folder: Path) -> None:
    """Remove what a batch and its report leave behind, and nothing else.

    Raises ConfigError where no batch did.
    """
    check_ours(folder)
    if not (folder / MANIFEST).exists():
        return
    for name in _LEFT_BEHIND:
        if (folder / name).is_dir():
            rmtree(folder / name)
        else:
            (folder / name).unlink(missing_ok=True)


def check_ours(folder: Path) -> None:
    """Raise ConfigError where something else than a batch left rows or a manifest in the folder."""
    if not (folder / MANIFEST).exists():
        if (folder / ROWS).exists():
            raise ConfigError(f"--out {folder}: holds rows without {MANIFEST}; take another --out")
    elif not holds_batch(folder):
        raise ConfigError(f"--out {folder}: holds something else than a batch; take another --out")


def holds_batch(folder: Path) -> bool:
    """Whether a batch was begun in a folder."""
    return (folder / MANIFEST).exists() and "experiment_digest" in _manifest(folder)


def begun(folder: Path, wanted: Mapping[str, Any]) -> dict[str, Any] | None:
    """The manifest of a folder in which the wanted batch was begun; None: no batch was.

    Raises ConfigError where it holds anything else.
    """
    check_ours(folder)
    if not (folder / MANIFEST).exists():
        return None
    remedy = "take another --out, or --fresh to remove what is there"
    manifest = _manifest(folder)
    for key, kind in _KINDS.items():
        if (key in manifest and not isinstance(manifest[key], kind)) or key not in (
            *manifest,
            "files",
        ):
            raise ConfigError(
                f"--out {folder}: {MANIFEST}: {key}: is not what a batch writes; {remedy}"
            )
    if manifest["experiment_digest"] != wanted["experiment_digest"]:
        name = manifest["experiment"].get("name")
        what = (
            "another experiment"
            if name != wanted["experiment"]["name"]
            else f"another state of {name}"
        )
        raise ConfigError(f"--out {folder}: holds {what}; {remedy}")
    if manifest["shard"] != wanted["shard"]:
        raise ConfigError(
            f"--out {folder}: holds shard {manifest['shard']}, not {wanted['shard']}; each shard "
            "has a folder of its own"
        )
    _check_same(manifest, wanted, f"--out {folder}", remedy)
    return manifest


def _check_same(
    manifest: Mapping[str, Any], wanted: Mapping[str, Any], where: str, remedy: str
) -> None:
    """Raise ConfigError where further rows would come of other programs or files than the rows that
    are there. `remedy`: what the message offers."""
    for name in DECIDING:
        before, now = manifest["versions"].get(name), wanted["versions"][name]
        if before != now:
            raise ConfigError(f"{where}: was begun with {name} {before}, this is {now}; {remedy}")
    there, here = manifest.get("files", wanted["files"]), wanted["files"]
    for name in sorted(there.keys() | here.keys()):
        if there.get(name) != here.get(name):
            raise ConfigError(f"{where}: {name} has changed since the batch was begun; {remedy}")
    for plugin in wanted["plugins"]:
        if plugin not in manifest["plugins"]:
            raise ConfigError(
                f"{where}: plugin {plugin['name']} has changed since the batch was begun; {remedy}"
            )


def done(folder: Path, episodes: Sequence[Episode]) -> list[Row]:
    """The rows of whole episodes, each once.

    Those of an episode of which a part is missing do not count.
    """
    rows = {row["key"]: row for row in records.read_rows(folder) if "key" in row}
    return [
        rows[key]
        for episode in episodes
        if all(key in rows for key in episode.keys)
        for key in episode.keys
    ]


def settle(folder: Path, episodes: Sequence[Episode]) -> None:
    """Leave only the rows of whole episodes in the folder, in the order of the experiment, as JSON
    lines and as CSV. Raises OSError."""
    rows = done(folder, episodes)
    records.write_whole(
        folder / ROWS, "".join(records.json_text(row, indent=None) + "\n" for row in rows).encode()
    )
    records.write_csv(folder)


def sweep(folder: Path) -> None:
    """Remove files that a killed process was about to write."""
    for path in (
        *folder.glob(".*.tmp"),
        *(folder / TRACES).glob(".*.tmp"),
        *(folder / MAPS).glob(".*.tmp"),
    ):
        path.unlink()


def drop_traces(folder: Path, keys: set[str]) -> None:
    """Remove the traces of these keys."""
    for key in keys:
        (folder / TRACES / f"{key}.npz").unlink(missing_ok=True)


def _manifest(folder: Path) -> dict[str, Any]:
    """The manifest in a folder; empty where it is none."""
    return records.read_manifest(folder) or {}
