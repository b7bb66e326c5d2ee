"""Manifests are plain JSON, and tell with which code they were written."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sumo_mcts import records
from sumo_mcts.records.provenance import sources


def test_manifest_is_plain_json(tmp_path: Path) -> None:
    records.write_manifest(
        tmp_path / "new" / "out",
        {"when": Path("x"), "values": np.array([1.0, np.nan]), "versions": records.versions()},
    )
    manifest = json.loads((tmp_path / "new" / "out" / records.MANIFEST).read_text())
    assert manifest["schema_version"] == records.SCHEMA_VERSION
    assert manifest["values"] == [1.0, None]
    assert manifest["versions"]["numpy"] == np.__version__


@pytest.mark.parametrize(
    "write",
    [
        lambda f: records.append_row(f, {}),
        records.write_csv,
        lambda f: records.write_manifest(f, {}),
    ],
)
def test_a_folder_that_cannot_be_is_an_os_error(tmp_path: Path, write: Any) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OSError, match="file"):
        write(tmp_path / "file" / "out")


def test_versions_do_not_load_sumo() -> None:
    code = (
        "import sys, sumo_mcts.records as r; r.versions(); print([m for m in ('libsumo', "
        "'sumolib', 'pydantic', 'numba') if m in sys.modules])"
    )
    assert (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.strip()
        == "[]"
    )


def test_the_digest_of_the_sources_covers_the_whole_package(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    read: list[Path] = []
    bytes_of = Path.read_bytes

    def noted(path: Path) -> bytes:
        read.append(path)
        return bytes_of(path)

    monkeypatch.setattr(Path, "read_bytes", noted)
    sources.cache_clear()
    assert len(sources()) == 16
    assert {"scene.py", "codec.py", "mcts.py"} < {path.name for path in read}
