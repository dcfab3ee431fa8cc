"""Drones in a bunch somewhere on a track, as a planner meets them."""

import jax.numpy as jnp
import numpy as np

from cruise.pilots.se_ibr.centre_line import frame_at, make_centre_line
from cruise.pilots.se_ibr.game import Traffic, first_plan, shifted
from cruise.pilots.se_ibr.options import Style
from cruise.presets import TRACKS

LINE = make_centre_line(TRACKS["figure-eight"])
STYLE = Style(speed=4.0, acceleration=2.0, margin=0.35, separation=0.8, sensitivity=0.5)


def bunch(drones, batch, seed=0):
    """Traffic of drones within some metres of each other, at random places of the figure-eight, and their progress."""
    rng = np.random.default_rng(seed)
    progress = rng.uniform(0.0, LINE.length, batch) + rng.uniform(-1.0, 1.0, (drones, *batch)) * np.sqrt(drones)
    frame = frame_at(LINE, jnp.asarray(progress))
    aside, above = rng.uniform(-0.6, 0.6, (drones, *batch)), rng.uniform(-0.2, 0.3, (drones, *batch))
    position = frame.point_w + aside * frame.left_w + above * frame.up_w
    velocity = frame.tangent_w * rng.uniform(1.0, 3.2, (drones, *batch)) + rng.normal(0.0, 0.4, position.shape)
    traffic = Traffic(
        jnp.asarray(position, jnp.float32),
        jnp.asarray(velocity, jnp.float32),
        jnp.ones((drones, *batch), bool),
        jnp.full((drones, *batch), STYLE.speed, jnp.float32),
    )
    return traffic, jnp.asarray(progress, jnp.float32)


def guess_of(algorithm, traffic, progress):
    """The plan that a planner begins with."""
    return shifted(LINE, first_plan(LINE, algorithm, traffic, progress), 1.0)
