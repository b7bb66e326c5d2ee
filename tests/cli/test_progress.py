"""What commands tell on standard error while they work."""

import sys

import pytest

from sumo_mcts.cli.progress import BatchProgress, progress
from sumo_mcts.experiments.progress import Progress


def test_ids_are_shown_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a terminal the library for progress would take them for markup, or end with an error."""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with progress("starting", quiet=False) as note:
        note("12.0 s  [/red] at 3 m/s, [bold]x\x1b[1m")


def test_elsewhere_than_on_a_terminal_everything_is_told_once(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with progress("starting", quiet=False) as note:
        for text in ("compiling  3 of 9", "compiling  4 of 9", "12.0 s  ego at 3 m/s", "drawing"):
            note(text)
    assert capsys.readouterr().err == "compiling ...\ndrawing ...\n"


@pytest.mark.parametrize("quiet", [False, True])
def test_a_batch_is_told_every_ten_seconds_and_at_its_end(
    quiet: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    with BatchProgress(quiet=quiet) as shown:
        for doing, done in (("checking  1", 0), ("checking  2", 0), ("", 1), ("", 2), ("", 8)):
            shown.tell(Progress(doing, done, 8, 1, 2, 0.5 if done else None, 4.0 if done else None))
    left = "1 collisions, 2 errors, 0.5/s, 0:00:04 left"
    lines = ["checking ...", f"8/8 episodes, {left}"]
    assert capsys.readouterr().err.splitlines() == ([] if quiet else lines)
