"""The animation of an episode as a video file (MP4, H.264).

Needs the extra `video`, which brings an encoder along.
"""

import errno
import os
import shutil
from itertools import chain, repeat
from pathlib import Path

import numpy as np
from PIL import Image

from sumo_mcts.records import Trace, written_whole
from sumo_mcts.reporting.animation import FPS, HOLD_MS, Note, frames, silent

WIDTH = 1080  # px
QUALITY = 8  # of the encoder, up to 10
FREE = 1 << 20  # bytes: a disk with less is full


class EncoderError(Exception):
    """The extra `video` is not installed."""


def film(trace: Trace, path: Path, note: Note = silent) -> None:
    """Write the whole episode, a long one faster than real time.

    Raises EncoderError, ValueError where there is no cycle, OSError where it cannot be written.
    """
    try:
        import imageio_ffmpeg as encoders
    except ImportError:
        raise EncoderError(
            "needs an encoder that is not installed: pip install imageio-ffmpeg; png and gif "
            "need none"
        ) from None
    drawn = map(_even, frames(trace, WIDTH, note))
    first = next(drawn)
    with written_whole(path) as unfinished:
        unfinished.touch()  # where nothing can be written this says so
        encoder = encoders.write_frames(
            str(unfinished), first.size, fps=FPS, quality=QUALITY, codec="libx264",
            macro_block_size=2, ffmpeg_log_level="quiet",
            output_params=["-f", "mp4"],
        )  # fmt: skip
        try:
            encoder.send(None)
            frame = first
            for frame in chain([first], drawn):
                encoder.send(np.asarray(frame))
            for last in repeat(np.asarray(frame), HOLD_MS * FPS // 1000):
                encoder.send(last)
            encoder.close()
        except OSError:
            raise _failed(path) from None
        if not _is_whole(unfinished.read_bytes()):  # the encoder may fail in the end without a word
            raise _failed(path)


def _failed(path: Path) -> OSError:
    """The error where the encoder ended by itself: the pipe loses the reason, but a full disk can
    be seen."""
    full = shutil.disk_usage(path.parent).free < FREE
    return (
        OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        if full
        else OSError(errno.EIO, "the video encoder failed", str(path))
    )


def _is_whole(content: bytes) -> bool:
    """Whether an MP4 consists of whole boxes, its index among them."""
    at, kinds = 0, set()
    while at + 8 <= len(content):
        size, kind = int.from_bytes(content[at : at + 4], "big"), content[at + 4 : at + 8]
        long = size == 1  # then the size follows
        kinds.add(kind)
        at += max(int.from_bytes(content[at + 8 : at + 16], "big") if long else size, 8)
    return at == len(content) and b"moov" in kinds


def _even(frame: Image.Image) -> Image.Image:
    """Without the last row or column where the encoder needs an even number."""
    return frame.crop((0, 0, frame.width // 2 * 2, frame.height // 2 * 2))
