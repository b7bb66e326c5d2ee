"""The animation of an episode as a video file (MP4, H.264). Needs the extra `video`, which brings an encoder along."""

from itertools import chain, repeat
from pathlib import Path

import numpy as np
from PIL import Image

from sumo_mcts.records import Trace, written_whole
from sumo_mcts.reporting.birdseye import FPS, HOLD_MS, Note, frames, silent

WIDTH = 1080  # px
QUALITY = 8  # of the encoder, up to 10


class EncoderError(Exception):
    """The extra `video` is not installed."""


def film(trace: Trace, path: Path, note: Note = silent) -> None:
    """Write the whole episode in real time. Raises EncoderError, ValueError where there is no cycle, OSError where it cannot be written."""
    try:
        import imageio_ffmpeg as encoders
    except ImportError:
        raise EncoderError("needs an encoder that is not installed: pip install 'sumo-mcts[video]'; png and gif need none") from None
    drawn = map(_even, frames(trace, WIDTH, FPS, note))
    first = next(drawn)
    with written_whole(path) as unfinished:
        unfinished.touch()  # where nothing can be written this says so
        encoder = encoders.write_frames(
            str(unfinished), first.size, fps=FPS, quality=QUALITY, codec="libx264", macro_block_size=2, ffmpeg_log_level="error",
            output_params=["-f", "mp4"],
        )  # fmt: skip
        encoder.send(None)
        frame = first
        for frame in chain([first], drawn):
            encoder.send(np.asarray(frame))
        for last in repeat(np.asarray(frame), HOLD_MS * FPS // 1000):
            encoder.send(last)
        encoder.close()


def _even(frame: Image.Image) -> Image.Image:
    """Without the last row or column where the encoder wants an even number."""
    return frame.crop((0, 0, frame.width // 2 * 2, frame.height // 2 * 2))
