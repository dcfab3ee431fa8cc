"""Colours and letters of films, those of the replay page in its dark scheme."""

import functools
from pathlib import Path

import numpy as np
from PIL import ImageColor, ImageFont

from cruise.palette import drone_colour

Colour = tuple[int, int, int]

BACKGROUND: Colour = (10, 14, 21)
GROUND: Colour = (26, 34, 48)
GRID: Colour = (61, 75, 97)
GATE: Colour = (135, 147, 166)
GATE_DARK: Colour = (96, 107, 126)
STRIP: Colour = (223, 231, 242)
HIGHLIGHT: Colour = (240, 228, 66)
ARMS: Colour = (139, 149, 165)
CRASHED: Colour = (91, 100, 114)
INK: Colour = (233, 237, 243)
MUTED: Colour = (152, 164, 181)
WARNING: Colour = (255, 138, 112)
PANEL: Colour = (17, 23, 33)
ROW: Colour = (36, 43, 54)
SHADOW: Colour = (15, 20, 29)
DARK: Colour = (10, 14, 21)
WHITE: Colour = (255, 255, 255)


def colour_of(drone: int) -> Colour:
    """Of a drone; one that is black elsewhere is white on this dark ground."""
    red, green, blue = ImageColor.getrgb(drone_colour(drone))[:3]
    return (red, green, blue) if red + green + blue else WHITE


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
