"""Colours and letters of pictures, those of the replay page in its dark scheme."""

import functools
from pathlib import Path

import numpy as np
from PIL import ImageColor, ImageFont

from cruise.palette import COLOURS, drone_colour

Colour = tuple[int, int, int]


def rgb(name: str) -> Colour:
    """Of "#rrggbb"."""
    red, green, blue = ImageColor.getrgb(name)[:3]
    return red, green, blue


_SCENE, _UI = ({name: rgb(value) for name, value in COLOURS["dark"][part].items()} for part in ("scene", "ui"))
BACKGROUND, GROUND, GRID = (_SCENE[name] for name in ("background", "ground", "grid"))
GATE, STRIP, HIGHLIGHT, SOLID = (_SCENE[name] for name in ("gate", "gateStrip", "highlight", "solid"))
ARMS, CRASHED, WHITE = (_SCENE[name] for name in ("arms", "crashed", "black"))  # a black drone would vanish
INK, MUTED, PANEL, WARNING = (_UI[name] for name in ("ink", "muted", "panel", "warn"))
SHADOW: Colour = (15, 20, 29)
DARK = BACKGROUND


def colour_of(drone: int) -> Colour:
    """Of a drone; one that is black elsewhere is white on this dark ground."""
    colour = rgb(drone_colour(drone))
    return colour if any(colour) else WHITE


def ink_on(colour: Colour) -> Colour:
    """What can be read on a colour."""
    parts = np.array(colour) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return DARK if linear @ [0.2126, 0.7152, 0.0722] > 0.22 else WHITE


def mix(a: Colour, b: Colour, share: float) -> Colour:
    """`share` of b in a."""
    red, green, blue = (round(x + (y - x) * share) for x, y in zip(a, b, strict=True))
    return red, green, blue


@functools.lru_cache(maxsize=16)
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """The letters that come with Matplotlib, the same on every machine."""
    import matplotlib  # noqa: PLC0415  (slow to import)

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)
