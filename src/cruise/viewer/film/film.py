"""A race, frame by frame."""

from collections.abc import Iterator

import numpy as np
from PIL import Image

from cruise.errors import CruiseError
from cruise.storage.race_log import EventKind, RaceLog
from cruise.viewer.film.board import Layout, write_comment, write_names, write_over
from cruise.viewer.film.flights import Flight, make_flight
from cruise.viewer.painting import look
from cruise.viewer.painting.camera import Margins
from cruise.viewer.painting.look import Colour, mix
from cruise.viewer.painting.scene import FINE, LEAST, Drone, make_scene, paint_scene
from cruise.viewer.painting.scenery import log_scenery
from cruise.viewer.standings import Standing, commentary, make_course, standings

HOLD = 1.5  # how long the end of a race is shown [s]
TRAIL, TRAIL_PIECE = 3.0, 1 / 15  # [s]
GLOW = 0.9  # how long a gate keeps the colour of the drone that flew through [s]


def frames(
    log: RaceLog, size: tuple[int, int], rate: float, clip: tuple[float, float] | None = None
) -> Iterator[Image.Image]:
    """Pictures of a race.

    Args:
        log: the race.
        size: width and height [px].
        rate: pictures per second of the race.
        clip: from when to when [s]; by default the whole race, and its end for a moment longer.

    Raises:
        CruiseError: the clip lies outside the race.
    """
    times = frame_times(log, rate, clip)
    stage, course = log_scenery(log), make_course(log)
    scene = make_scene(stage, size, margins_of(size[0]))
    camera = scene.camera.scaled(1 / FINE)
    flights = [make_flight(log, drone) for drone in range(log.num_drones)]
    said = commentary(course)
    for t in times:
        order = standings(course, t)
        picture = paint_scene(scene, [_drone(flights[row.drone], row, t) for row in order], _strips(log, t, order), t)
        write_over(picture, course, (stage.at(t), camera), t, order)
        places = np.stack([flight.position_at(t) for flight in flights])
        write_names(picture, places, order, camera, LEAST * size[1] / 2 + Layout.of(size[0]).text)
        write_comment(picture, said, t)
        yield picture


def margins_of(width: int) -> Margins:
    """What the board covers."""
    layout = Layout.of(width)
    return layout.edge + layout.width, layout.edge, layout.edge, 1.6 * layout.row


def frame_times(log: RaceLog, rate: float, clip: tuple[float, float] | None) -> list[float]:
    """When the pictures are taken [s]."""
    end = float(log.time[-1])
    if clip is None:
        held = round(HOLD * rate)
        return [*(np.arange(int(end * rate) + 1) / rate).tolist(), *[end] * held]
    first, last = clip
    if not 0 <= first < last or first >= end:
        raise CruiseError(f"a clip from {first:g} to {last:g} s does not lie within the race, which lasts {end:.2f} s")
    return (first + np.arange(max(1, round((min(last, end) - first) * rate))) / rate).tolist()


def _drone(flight: Flight, row: Standing, t: float) -> Drone:
    """A drone at a time, with where it was in the last seconds."""
    now = min(t, flight.end)
    times = np.arange(max(0.0, t - TRAIL), now + TRAIL_PIECE, TRAIL_PIECE).clip(max=now)
    trail = np.asarray(flight.position_at(times))
    return Drone(row.drone, flight.position_at(t), flight.axes_at(t), row.status, trail, (t - times) / TRAIL)


def _strips(log: RaceLog, t: float, order: list[Standing]) -> list[Colour]:
    """The lights of gates: where the first drone flies to, and for a moment the colour of who flew through."""
    leader = next((row for row in order if row.status == "flying"), None)
    target = -1 if leader is None else (log.next_gate[0, 0] + leader.passed) % log.num_gates
    strips = [look.HIGHLIGHT if gate == target else look.STRIP for gate in range(log.num_gates)]
    through = (log.event_kind == EventKind.CROSSING) & (log.event_time <= t) & (log.event_time > t - GLOW)
    for time, gate, drone in zip(
        *(c[through].tolist() for c in (log.event_time, log.event_gate, log.event_drone)), strict=True
    ):
        strips[gate] = mix(strips[gate], look.colour_of(drone), 1 - ((t - time) / GLOW) ** 2)
    return strips
