"""An experiment that ran undisturbed, once for all tests of batches."""

import pytest
from helpers_batch import Reference, write

from sumo_mcts import run_batch


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Reference:
    """An experiment that ran undisturbed, with one worker: its folder and rows."""
    folder = tmp_path_factory.mktemp("whole")
    return folder / "out", run_batch(
        write(folder), folder / "out", jobs=1, command=("batch", "small.yaml")
    )
