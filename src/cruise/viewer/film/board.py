"""What is written over the picture: the order, the clock, names of drones and gates, and what happens."""

import math
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from cruise.racing.shapes import opening
from cruise.viewer.painting import look
from cruise.viewer.painting.camera import Camera
from cruise.viewer.painting.look import Colour, font
from cruise.viewer.painting.scenery import Scenery
from cruise.viewer.standings import Course, Standing

SAID = 2.2  # how long a sentence stays [s]
MOST_ROWS = 8


class Layout(NamedTuple):
    """Sizes in pixels, for a width of the picture."""

    text: int
    row: int
    edge: int
    width: int  # of the board

    @classmethod
    def of(cls, width: int) -> "Layout":
        """Letters are larger, measured by the picture, where it is small."""
        text = max(10, round(width / 76 if width >= 960 else width / 64))
        return cls(text, round(1.75 * text), round(1.2 * text), round(17 * text))


def write_over(
    picture: Image.Image, course: Course, view: tuple[Scenery, Camera], t: float, order: list[Standing]
) -> None:
    """Everything but the names of drones, which need to know where they are."""
    draw, layout = ImageDraw.Draw(picture), Layout.of(picture.width)
    write_gates(draw, *view, int(course.log.next_gate[0, 0]))
    _board(draw, course, layout, t, order)
    _clock(draw, picture.width, layout, t)


def write_names(
    picture: Image.Image, places: np.ndarray, order: list[Standing], camera: Camera, pixels_above: float
) -> None:
    """A chip with its number above every drone, the leader's last so that nothing covers it."""
    draw, layout = ImageDraw.Draw(picture), Layout.of(picture.width)
    for row in reversed(order):
        x, y = camera.project(places[row.drone])[0]
        _chip(draw, (x, y - pixels_above), row.drone, layout, row.status == "flying")


def write_comment(picture: Image.Image, said: list[tuple[float, str]], t: float) -> None:
    """The latest sentence, for a moment, at the lower edge."""
    recent = [text for time, text in said if time <= t < time + SAID]
    if not recent:
        return
    draw, layout = ImageDraw.Draw(picture), Layout.of(picture.width)
    letters = font(round(1.1 * layout.text), bold=True)
    half = draw.textlength(recent[-1], letters) / 2 + layout.text
    x, y = picture.width / 2, picture.height - layout.edge - layout.row / 2
    box = (x - half, y - 0.62 * layout.row, x + half, y + 0.62 * layout.row)
    draw.rounded_rectangle(box, layout.text / 2, fill=look.PANEL)
    draw.text((x, y), recent[-1], look.INK, letters, anchor="mm")


def write_gates(draw: ImageDraw.ImageDraw, scenery: Scenery, camera: Camera, first: int) -> None:
    """The number of every gate above it, and which is the first."""
    layout = Layout.of(camera.size[0])
    tops = [[*gate.position_w[:2], opening(gate, scenery.frame_width)[:, 2].max()] for gate in scenery.gates]
    for gate, (x, y) in enumerate(camera.project(np.array(tops))[0]):
        text = f"{gate + 1}" + (" start" if gate == first else "")
        draw.text((x, y - 0.8 * layout.text), text, look.MUTED, font(layout.text), anchor="mm")


def _board(draw: ImageDraw.ImageDraw, course: Course, layout: Layout, t: float, order: list[Standing]) -> None:
    log, (text, row, edge, width) = course.log, layout
    laps = "1 lap" if log.laps == 1 else f"{log.laps} laps"
    title = log.track[:1].upper() + log.track[1:]
    draw.text((edge + 2, edge), title, look.INK, font(round(1.5 * text), bold=True))
    draw.text((edge + 2, edge + 2.0 * text), laps, look.MUTED, font(text))
    top = edge + 3.9 * text
    rows = order[:MOST_ROWS]
    bottom = top + len(rows) * row + 0.5 * text
    draw.rounded_rectangle((edge, top, edge + width, bottom), text / 2, fill=look.PANEL)
    for place, standing in enumerate(rows):
        y = top + 0.25 * text + (place + 0.5) * row
        _board_row(draw, course, layout, standing, (place, y))


def _board_row(
    draw: ImageDraw.ImageDraw, course: Course, layout: Layout, standing: Standing, at: tuple[int, float]
) -> None:
    (place, y), (text, _, edge, width) = at, layout
    out = standing.status not in ("flying", "finished")
    ink = look.MUTED if out else look.INK
    draw.text((edge + 1.6 * text, y), str(place + 1), look.MUTED, font(text), anchor="rm")
    _chip(draw, (edge + 3.0 * text, y), standing.drone, layout, flying=True)
    pilot = str(course.log.pilots[standing.drone])
    draw.text((edge + 4.2 * text, y), _short(draw, pilot, 6.6 * text, text), ink, font(text), anchor="lm")
    told, colour = _told(course, standing, place)
    draw.text((edge + width - 0.7 * text, y), told, colour, font(text), anchor="rm")


def _told(course: Course, standing: Standing, place: int) -> tuple[str, Colour]:
    """What the last column of the board says."""
    if standing.status not in ("flying", "finished"):
        return standing.status, look.WARNING
    if place == 0 and standing.status == "finished":
        return f"{course.result.drones[standing.drone].finish_time:.2f}", look.INK
    if place == 0:
        return (f"lap {standing.lap}/{course.log.laps}" if standing.lap else "grid"), look.MUTED
    return ("" if math.isnan(standing.gap) else f"+{max(standing.gap, 0.0):.2f}"), look.INK


def _short(draw: ImageDraw.ImageDraw, text: str, width: float, size: int) -> str:
    while draw.textlength(text, font(size)) > width:
        text = text.removesuffix("\u2026")[:-1] + "\u2026"
    return text


def _clock(draw: ImageDraw.ImageDraw, width: int, layout: Layout, t: float) -> None:
    place = (width - layout.edge, layout.edge)
    draw.text(place, f"{t:.1f} s", look.INK, font(round(1.5 * layout.text), bold=True), anchor="ra")


def _chip(draw: ImageDraw.ImageDraw, at: tuple[float, float], drone: int, layout: Layout, flying: bool) -> None:
    x, y = at
    colour = look.colour_of(drone) if flying else look.CRASHED
    half = 0.68 * layout.text
    wide = max(half, draw.textlength(str(drone + 1), font(layout.text, bold=True)) / 2 + 0.25 * layout.text)
    draw.rounded_rectangle((x - wide, y - half, x + wide, y + half), layout.text / 4, fill=colour)
    letters = font(round(0.92 * layout.text), bold=True)
    draw.text((x, y), str(drone + 1), look.ink_on(colour), letters, anchor="mm")
