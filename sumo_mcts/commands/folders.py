"""Which folders a command may write to."""

import os
import tempfile
from pathlib import Path

from sumo_mcts import records
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments import folder as batch_folder


def check_folder(folder: Path) -> None:
    """Raise ConfigError now where the results could not be written later."""
    existing = folder
    while not existing.exists():
        existing = existing.parent
    try:
        if not existing.is_dir():
            raise NotADirectoryError(20, "is a file, not a folder")
        with tempfile.TemporaryFile(dir=existing):
            pass
    except OSError as error:
        raise ConfigError(
            f"--out {folder}: {existing} "
            f"{'cannot be written' if existing.is_dir() else error.strerror}"
        ) from None


def check_run_folder(folder: Path) -> None:
    """Raise ConfigError now where a run could not be kept later.

    That is so where a batch was begun too: its rows and manifest are of one experiment.
    """
    check_folder(folder)
    for name in (records.ROWS, records.TABLE, records.MANIFEST):
        if os.path.lexists(folder / name) and not (folder / name).is_file():
            raise ConfigError(f"--out {folder}: {name}: is not a file; take another --out")
    for name in (records.TRACES, records.MAPS, records.MANIFESTS, records.FIGURES):
        if os.path.lexists(folder / name) and not (folder / name).is_dir():
            raise ConfigError(f"--out {folder}: {name}: is not a folder; take another --out")
    if batch_folder.holds_batch(folder):
        raise ConfigError(f"--out {folder}: holds a batch; take another --out")
