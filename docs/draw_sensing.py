"""Draws what a drone sees and believes, for docs/sensing.md: `python -m docs.draw_sensing`."""

import math
from pathlib import Path

import jax
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cruise.config import Randomisation, Sensing
from cruise.env.race_env import make_race_env
from cruise.env.randomise import perturbation
from cruise.env.sensing import camera_axes
from cruise.env.surroundings import perceive
from cruise.evaluation.pilot_choice import find_pilot
from cruise.pilots.base import crews
from cruise.presets import TRACKS, VEHICLES
from cruise.report.figure_style import BLUE, FAINT, INK, ORANGE, new_figure, our_look, tidy
from cruise.rollout import act_together, first_memories, team_rules

IMAGE = Path(__file__).parent / "images" / "sensing.png"
TRACK, VEHICLE, PILOT = TRACKS["ring"], VEHICLES["racer"], "racer-ring"
SENSING = Sensing("camera", velocity_bias=0.3)
MAPPED_WRONG = Randomisation(gate_shift=0.8, gate_turn=0.2)
STEPS, SEED = 75, 4


def fly() -> tuple:
    """The race as it is and as the drone knows it at every step, its rotation, and where its gates stand."""
    perturb = perturbation(TRACK, VEHICLE, MAPPED_WRONG, sensing=SENSING)
    env, pilot = make_race_env(TRACK, 1, VEHICLE, "body", perturb=perturb), find_pilot(PILOT)
    groups, rules = crews([pilot]), team_rules([pilot], VEHICLE.collision_distance, 0)

    @jax.jit
    def flown(key: jax.Array) -> tuple:
        start = env.reset(key)

        def step(carry: tuple, _: None) -> tuple:
            state, memories = carry
            memories, action = act_together(env, groups, memories, state, key)
            return (env.step(state, action, rules)[0], memories), (state, perceive(state))

        return jax.lax.scan(step, (start, first_memories(env, groups, start)), length=STEPS)[1]

    states, known = flown(jax.random.key(SEED))
    last = jax.tree.map(lambda leaf: leaf[-1], states)
    axes = camera_axes(env.dynamics.rotation(last.drones), last.surroundings.sensed.sensor.tilt)
    return jax.tree.map(np.asarray, (states, known, axes))


def from_above(axes: Axes, states: tuple, known: tuple, camera: tuple) -> None:
    """The path as flown and as believed, gates as they stand and as believed, and the camera's view."""
    true, believed = (np.asarray(one.drones.body.position_w)[:, :, 0] for one in (states, known))
    axes.plot(*true[:, :2].T, color=INK, label="flown")
    axes.plot(*believed[:, :2].T, color=ORANGE, linewidth=1.0, label="believed")
    heading = math.atan2(camera[0][1, 0], camera[0][0, 0])
    sides = heading + np.linspace(-0.5, 0.5, 20) * SENSING.camera_width
    reach = SENSING.sensor_range * np.stack([np.cos(sides), np.sin(sides)]) + true[-1, :2, None]
    axes.fill(*np.concatenate([true[-1, :2, None], reach], axis=1), color=BLUE, alpha=0.1, label="field of view")
    stand, thought = states.surroundings.gates, known.surroundings.gates
    for gate in range(len(TRACK.gates)):
        for place, normal, colour in (
            (stand.position_w[-1][:2, gate], stand.normal_w[-1][:, gate], INK),
            (thought.position_w[-1][:2, gate, 0], thought.normal_w[-1][:, gate, 0], ORANGE),
        ):
            across = np.array([-normal[1], normal[0]]) * TRACK.gates[gate].width / 2
            axes.plot(*np.stack([place - across, place + across], axis=1), color=colour, linewidth=3, alpha=0.8)
    axes.set_aspect("equal")
    axes.set_xlim(-14, 14)
    axes.set_ylim(-14, 14)
    tidy(axes, "from above: black as it is, orange as the drone believes [m]")


def through_the_camera(axes: Axes, states: tuple, known: tuple, camera: tuple) -> None:
    """The openings of the gates in the image, by angles' tangents: as they are, and as the drone believes them."""
    limits = math.tan(SENSING.camera_width / 2), math.tan(SENSING.camera_height / 2)
    for state, colour, drone in ((states, INK, ()), (known, ORANGE, (0,))):
        origin = np.asarray(state.drones.body.position_w)[-1, :, 0]
        gates = state.surroundings.gates
        for gate in range(len(TRACK.gates)):
            place, (x, y) = (
                gates.position_w[-1][(slice(None), gate, *drone)],
                gates.normal_w[-1][(slice(None), gate, *drone)],
            )
            half = TRACK.gates[gate].width / 2
            corners = [place + half * (a * np.array([-y, x, 0.0]) + b * np.array([0.0, 0.0, 1.0])) for a, b in SQUARE]
            seen = np.array([[axis[:, 0] @ (corner - origin) for axis in camera] for corner in corners])
            if (seen[:, 0] > 0.1).all():
                axes.plot(-seen[:, 1] / seen[:, 0], seen[:, 2] / seen[:, 0], color=colour, linewidth=2)
    axes.set_xlim(-limits[0], limits[0])
    axes.set_ylim(-limits[1], limits[1])
    axes.set_aspect("equal")
    axes.set_facecolor(FAINT + "33")
    axes.set_xticks([])
    axes.set_yticks([])
    tidy(axes, "through the camera")


SQUARE = ((1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1))


@our_look()
def draw() -> Figure:
    """Both views of the last moment."""
    flown = fly()
    figure = new_figure(12.0, 5.2)
    above, inside = figure.subplots(1, 2)
    from_above(above, *flown)
    through_the_camera(inside, *flown)
    above.legend(loc="upper left", fontsize=8, frameon=False)
    return figure


if __name__ == "__main__":
    draw().savefig(IMAGE, dpi=90)
