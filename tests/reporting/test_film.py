"""The film shows the animation's frames, and says what is missing where there is no encoder."""

import subprocess
import sys
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from helpers_trace import crossing_trace

from sumo_mcts.reporting import animation, film


@pytest.mark.slow
def test_the_film_holds_every_frame_and_stays_on_the_last(tmp_path: Path) -> None:
    trace = crossing_trace()._replace(cycles=crossing_trace().cycles[:4])
    told: list[str] = []
    film.film(trace, tmp_path / "new" / "f.mp4", told.append)
    command = [
        imageio_ffmpeg.get_ffmpeg_exe(),
        "-i",
        tmp_path / "new" / "f.mp4",
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-",
    ]
    decoded = subprocess.run(command, capture_output=True, check=True)
    assert b"Video: h264" in decoded.stderr
    assert b"10 fps" in decoded.stderr
    drawn = [np.asarray(film._even(frame)) for frame in animation.frames(trace, film.WIDTH)]
    shown = np.frombuffer(decoded.stdout, np.uint8).reshape(-1, *drawn[0].shape)
    assert len(drawn) == 16
    assert len(shown) == len(drawn) + animation.HOLD_MS * animation.FPS // 1000
    for expected, frame in zip((*drawn, drawn[-1]), shown, strict=False):
        assert np.abs(expected.astype(int) - frame).mean() < 4.0
    assert told[-1] == "drawing the film  frame 16 of 16"
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["f.mp4"]


def test_a_film_that_is_broken_off_leaves_the_old_one(tmp_path: Path) -> None:
    (tmp_path / "f.mp4").write_bytes(b"old")

    def interrupted(said: str) -> None:
        if said.endswith("frame 8 of 16"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        film.film(
            crossing_trace()._replace(cycles=crossing_trace().cycles[:4]),
            tmp_path / "f.mp4",
            interrupted,
        )
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("f.mp4", b"old")]


def test_sizes_are_made_even() -> None:
    frame = next(iter(animation.frames(crossing_trace(), 721)))
    assert frame.width % 2 == 1
    even = film._even(frame)
    assert (even.width, even.height % 2) == (720, 0)


def test_without_an_encoder_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(film.EncoderError, match=r"pip install imageio-ffmpeg"):
        film.film(crossing_trace(), tmp_path / "f.mp4")
    assert list(tmp_path.iterdir()) == []


def test_a_trace_without_cycles_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="crossing--mcts--7"):
        film.film(crossing_trace()._replace(cycles=()), tmp_path / "f.mp4")
    assert list(tmp_path.iterdir()) == []
