"""Films as files: animated GIF by Pillow, MP4 by the ffmpeg that imageio-ffmpeg brings."""

import io
import itertools
import tempfile
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from cruise.errors import CruiseError, one_line
from cruise.extras import import_extra
from cruise.storage.race_log import RaceLog
from cruise.viewer.film.film import frames
from cruise.viewer.painting import look

GIF_SIZE, GIF_RATE = (800, 450), 100 / 6  # a GIF counts hundredths of a second
MP4_SIZE, MP4_RATE = (1280, 720), 25.0
UNCHANGED = 255  # index of the colour that shows what was there before
GROUND_COLOURS = 96  # of 256 in a GIF
SHADES = np.linspace(0.0, 0.85, 11)  # of every other colour, towards the ground

Clip = tuple[float, float] | None


def draw_gif(log: RaceLog, clip: Clip = None) -> bytes:
    """An animated picture that repeats for ever."""
    pictures = frames(log, GIF_SIZE, GIF_RATE, clip)
    first = next(pictures)
    changes = _only_changes(itertools.chain([first], pictures), _shared_palette(first, log.num_drones))
    content = io.BytesIO()
    next(changes).save(
        content,
        "GIF",
        save_all=True,
        append_images=changes,
        duration=round(1000 / GIF_RATE),
        loop=0,
        optimize=False,
        transparency=UNCHANGED,
        disposal=1,
    )
    return content.getvalue()


def _only_changes(pictures: Iterable[Image.Image], palette: Image.Image) -> Iterator[Image.Image]:
    """Every picture with what is as in the one before left transparent, which packs to a quarter."""
    before = None
    for picture in pictures:
        flat = picture.quantize(palette=palette, dither=Image.Dither.NONE)
        now = np.asarray(flat)
        change = Image.fromarray(now if before is None else np.where(now == before, np.uint8(UNCHANGED), now), "P")
        change.putpalette(flat.getpalette() or [])
        yield change
        before = now


def _shared_palette(picture: Image.Image, drones: int) -> Image.Image:
    """Colours for all frames, so that what does not move does not change: many of the ground, some of all else."""
    ground = picture.quantize(GROUND_COLOURS, Image.Quantize.MEDIANCUT).getpalette() or []
    own = dict.fromkeys(look.colour_of(drone) for drone in range(drones))
    bright = [*own, look.INK, look.STRIP, look.HIGHLIGHT, look.GATE, look.SOLID, look.MUTED, look.WARNING, look.ARMS]
    shades = [look.mix(colour, look.GROUND, share) for share in SHADES for colour in bright]
    colours = [*ground[: 3 * GROUND_COLOURS], *(part for shade in shades for part in shade)]
    palette = Image.new("P", (1, 1))
    palette.putpalette(colours[: 3 * UNCHANGED])
    return palette


def check_video() -> None:
    """Raises CruiseError where MP4 files cannot be made."""
    _load_ffmpeg()


def _load_ffmpeg() -> Any:
    return import_extra("imageio_ffmpeg", "video", "--mp4 needs imageio-ffmpeg")


def draw_mp4(log: RaceLog, clip: Clip = None) -> bytes:
    """A film in H.264, which every browser plays."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "race.mp4"
        _encode(path, frames(log, MP4_SIZE, MP4_RATE, clip))
        return path.read_bytes()


def _encode(path: Path, pictures: Iterable[Image.Image]) -> None:
    options = ["-crf", "20", "-preset", "fast", "-movflags", "+faststart"]
    writer: Iterator = _load_ffmpeg().write_frames(
        str(path), MP4_SIZE, fps=MP4_RATE, codec="libx264", quality=None, output_params=options, macro_block_size=8
    )
    try:
        with warnings.catch_warnings():  # ffmpeg starts by a fork, of which JAX warns; but its child execs at once
            warnings.filterwarnings("ignore", r"os\.fork", RuntimeWarning)
            next(writer)
        for picture in pictures:
            writer.send(np.ascontiguousarray(picture))  # type: ignore[attr-defined]
    except OSError as error:
        raise CruiseError(f"the film could not be encoded: {one_line(error)}") from None
    finally:
        writer.close()  # type: ignore[attr-defined]
