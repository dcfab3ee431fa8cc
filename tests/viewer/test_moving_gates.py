"""Gates that move are shown where they are at the time, by the page and by painted pictures."""

import numpy as np
import pytest

from cruise.presets import TRACKS
from cruise.racing.motion import gates_at, motion_row
from cruise.racing.shapes import opening
from cruise.viewer.packing import pack_scenery
from cruise.viewer.painting import look
from cruise.viewer.painting.scene import FINE, STRIP, make_scene, paint_scene
from cruise.viewer.painting.scenery import track_scenery

MOVING = TRACKS["moving"]


def test_the_page_is_told_how_gates_move():
    packed = pack_scenery(track_scenery(MOVING))["gates"]
    for gate, told in zip(MOVING.gates, packed, strict=True):
        assert (gate.motion is None) == ("motion" not in told)
        if gate.motion is not None:
            row = [*told["motion"]["sway"], *(told["motion"][name] for name in ("swing", "period", "phase"))]
            assert row == pytest.approx(motion_row(gate.motion), abs=1e-4)


@pytest.mark.parametrize("time", [0.0, 1.7])
def test_lights_of_gates_are_painted_where_they_are(time):
    scene = make_scene(track_scenery(MOVING), (1200, 900), (0, 0, 0, 0))
    picture = np.asarray(paint_scene(scene, [], [look.HIGHLIGHT] * 6, time)).astype(int)
    lit = np.abs(picture - np.array(look.HIGHLIGHT)).sum(axis=2) < 100

    def seen(gate):
        """Corners of the light round an opening that are where the gate is."""
        corners = scene.camera.scaled(1 / FINE).project(opening(gate, STRIP / 2))[0].round().astype(int)
        return sum(bool(lit[y - 1 : y + 2, x - 1 : x + 2].any()) for x, y in corners)

    there, elsewhere = ([seen(gate) for gate in gates_at(MOVING.gates, t)] for t in (time, time + 1.0))
    assert sum(there) >= 20  # of 24: some are hidden behind a frame
    assert 0 in elsewhere
