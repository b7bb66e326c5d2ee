"""The animation of an episode: its frames, and a GIF of them (film.py writes a video)."""

import io
import math
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from sumo_mcts.arrays import Floats
from sumo_mcts.records import Trace, write_whole
from sumo_mcts.reporting.birdseye import draw_panel
from sumo_mcts.reporting.camera import STRIP, Shot, arrangement, shot_at, views_of
from sumo_mcts.reporting.canvas import (
    ASPHALT,
    BLINK,
    BRAKE,
    EGO,
    EGO_DARK,
    FAINT,
    INK,
    KERB,
    LAND,
    OTHER,
    OTHER_DARK,
    PAINT,
    PAPER,
    ROUTE,
    SS,
    fitted,
    mixed,
    write_text,
)
from sumo_mcts.reporting.ground import Ground, roads_of
from sumo_mcts.reporting.words import action_words

FPS = 10
REAL_TIME_S = 30.0  # a drive up to so long is shown in real time
FAST_S = 16.0  # a longer one is shown faster, by a whole factor, in at most this time
# Bytes of a GIF in real time of up to 20 s. A longer one may have more in proportion, a faster one
# twice as many. Beyond that every second frame is left out.
GIF_BYTES = 1_500_000
HOLD_MS = 1500  # the last frame stays
_BAND = 44  # px: the line of text below the scene
Note = Callable[[str], object]  # gets a message before work that takes long


def silent(text: str) -> None:
    """A note that drops its text."""


def animation(trace: Trace, path: Path, width: int = 720, note: Note = silent) -> None:
    """Write a GIF of the whole episode, a long one faster than real time.

    Raises ValueError where there is no cycle, OSError where it cannot be written.
    """
    speed = film_speed(trace)
    drawn = [
        frame.quantize(palette=_palette(), dither=Image.Dither.NONE)
        for frame in frames(trace, width, note)
    ]
    content = _gif(drawn, FPS)
    allowed = 2.0 if speed > 1 else max(1.0, _duration(trace) / 20.0)
    if len(content) > GIF_BYTES * allowed:  # a moving camera leaves no pixel as it was
        content = _gif([*drawn[:-1:2], drawn[-1]], FPS // 2)
    write_whole(path, content)


def _gif(drawn: list[Image.Image], fps: int) -> bytes:
    """The encoded animation."""
    durations = [1000 // fps] * (len(drawn) - 1) + [HOLD_MS]
    buffer = io.BytesIO()
    drawn[0].save(
        buffer,
        format="GIF",
        save_all=True,
        append_images=drawn[1:],
        duration=durations,
        loop=0,
        disposal=1,
        optimize=False,
    )
    return buffer.getvalue()


# --- frames ---


def film_speed(trace: Trace) -> int:
    """How many times faster than real time an episode is shown, so that no film has more frames
    than REAL_TIME_S."""
    duration = _duration(trace)
    return 1 if duration <= REAL_TIME_S else math.ceil(duration / FAST_S)


def frame_times(trace: Trace) -> Floats:
    """[F] simulation times of the frames, s: from the first decision to the last, FPS of them a
    second of the film."""
    apart, duration = film_speed(trace) / FPS, _duration(trace)
    elapsed: Floats = np.minimum(
        apart * np.arange(math.ceil(duration / apart - 1e-6) + 1), duration
    )
    return trace.cycles[0].time + elapsed


def frames(trace: Trace, width: int, note: Note = silent) -> Iterator[Image.Image]:
    """The whole episode, FPS frames a second. Raises ValueError where there is no cycle."""
    shots, speed = [shot_at(trace, float(time)) for time in frame_times(trace)], film_speed(trace)
    _, aspect = arrangement(shots)
    height = round(width / (0.75 * STRIP if aspect == STRIP else 1.5))
    # A camera that stands still is better, even if vehicles are smaller.
    views = views_of(shots, (width, height), largest=145.0)
    ground = Ground(roads_of(trace.lanes), views[0])
    for number, (shot, view) in enumerate(zip(shots, views, strict=True), 1):
        note(f"drawing the film  frame {number} of {len(shots)}")
        yield _frame(
            draw_panel(ground.under(view), shot, view),
            shot,
            trace.outcome if number == len(shots) else "",
            speed,
        )


def _duration(trace: Trace) -> float:
    """From the first decision to the last, s."""
    if not trace.cycles:
        raise ValueError(f"{trace.key}: the trace holds no cycle to draw")
    return trace.cycles[-1].time - trace.cycles[0].time


def _frame(panel: Image.Image, shot: Shot, ended: str, speed: int) -> Image.Image:
    """The finished frame: scene and a line of text; `speed`: times faster than real time."""
    scene = panel.reduce(SS)
    frame = Image.new("RGB", (scene.width, scene.height + _BAND), PAPER)
    frame.paste(scene, (0, 0))
    band = Image.new("RGB", (scene.width * SS, _BAND * SS), PAPER)
    draw = ImageDraw.Draw(band)
    end = write_text(draw, (14, 29), f"{shot.cycle.time + shot.elapsed:.1f} s", 17, bold=True)
    end = write_text(draw, (max(96, end + 14), 29), f"{shot.ego[3]:.1f} m/s", 15, FAINT)
    if speed > 1:
        end = write_text(draw, (end + 14, 29), f"{speed}\u00d7 speed", 15, FAINT)
    text = ended.replace("_", " ") if ended else action_words(shot.cycle)
    colour = EGO if ended in ("", "arrived") else BRAKE
    write_text(
        draw,
        (scene.width - 14, 29),
        fitted(draw, text, 15, scene.width - 34 - end),
        15,
        colour,
        bold=bool(ended),
        anchor="rs",
    )
    frame.paste(band.reduce(SS), (0, scene.height))
    return frame


@cache
def _palette() -> Image.Image:
    """The colours that occur and the steps between neighbours: one palette for all frames, so that
    still pixels stay the same."""
    pairs = [
        (LAND, KERB),
        (KERB, ASPHALT),
        (ASPHALT, PAINT),
        (ASPHALT, EGO),
        (ASPHALT, OTHER),
        (ROUTE, EGO),
        (ROUTE, PAINT),
        (EGO, PAINT),
        (OTHER, OTHER_DARK),
    ]
    pairs += [
        (EGO, EGO_DARK),
        (ASPHALT, BRAKE),
        (ASPHALT, BLINK),
        (PAPER, INK),
        (PAPER, FAINT),
        (PAPER, EGO),
        (PAPER, BRAKE),
        (ASPHALT, ROUTE),
    ]
    colours = list(
        dict.fromkeys(mixed(a, b, share) for a, b in pairs for share in (0.0, 0.25, 0.5, 0.75, 1.0))
    )
    image = Image.new("P", (1, 1))
    image.putpalette([channel for colour in colours for channel in colour])
    return image
