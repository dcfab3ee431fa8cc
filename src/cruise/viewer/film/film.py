"""A race, frame by frame."""

from collections.abc import Iterator

import numpy as np
from PIL import Image

from cruise.errors import CruiseError
from cruise.storage.race_log import RaceLog
from cruise.viewer.film.board import Layout, write_comment, write_names, write_over
from cruise.viewer.film.camera import fit_camera
from cruise.viewer.film.scene import LEAST, make_scene, paint_scene
from cruise.viewer.standings import commentary, make_course, standings

HOLD = 1.5  # how long the end of a race is shown [s]


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
    layout = Layout.of(size[0])
    margins = (layout.edge + layout.width, layout.edge, layout.edge, 1.6 * layout.row)
    camera = fit_camera(log, size, margins)
    scene, course = make_scene(log, camera), make_course(log)
    said = commentary(course)
    for t in times:
        order = standings(course, t)
        picture = paint_scene(scene, t, order)
        write_over(picture, course, camera, t, order)
        places = np.stack([flight.position_at(t) for flight in scene.flights])
        write_names(picture, places, order, camera, LEAST * size[1] / 2 + layout.text)
        write_comment(picture, said, t)
        yield picture


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
