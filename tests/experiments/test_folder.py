"""The folder of a batch, as far as its manifest tells anything."""

from pathlib import Path
from typing import Any

import pytest

from sumo_mcts import records
from sumo_mcts.errors import ConfigError
from sumo_mcts.experiments import folder
from sumo_mcts.experiments.experiment import DECIDING

WANTED: dict[str, Any] = {
    "experiment": {"name": "x"}, "experiment_digest": "d", "shard": "1/1",
    "versions": dict.fromkeys(DECIDING, "1"), "plugins": [], "files": {}, "egos": {},
}  # fmt: skip


def test_what_a_batch_wrote_goes_on(tmp_path: Path) -> None:
    records.write_manifest(tmp_path, WANTED)
    found = folder.begun(tmp_path, WANTED)
    assert found is not None
    assert found["experiment_digest"] == "d"


@pytest.mark.parametrize("key", WANTED)
@pytest.mark.parametrize("value", [None, 3, [3], "text", {"a": []}])
def test_a_damaged_manifest_is_told_by_its_key(key: str, value: object, tmp_path: Path) -> None:
    """Or is that of another batch, or allows the same."""
    records.write_manifest(tmp_path, {**WANTED, key: value})
    try:
        folder.begun(tmp_path, WANTED)
    except ConfigError as error:
        said = str(error)
        assert said.startswith(f"--out {tmp_path}: ")
    else:
        assert isinstance(value, type(WANTED[key]))


@pytest.mark.parametrize("key", [key for key in WANTED if key != "experiment_digest"])
def test_a_manifest_without_a_key_is_told(key: str, tmp_path: Path) -> None:
    records.write_manifest(tmp_path, {name: value for name, value in WANTED.items() if name != key})
    if key == "files":  # which earlier versions did not write
        assert folder.begun(tmp_path, WANTED) is not None
    else:
        with pytest.raises(ConfigError, match=f"manifest.json: {key}: is not what a batch writes"):
            folder.begun(tmp_path, WANTED)
