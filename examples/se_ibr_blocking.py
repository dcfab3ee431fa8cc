"""What the sensitivity of SE-IBR is for: a slow drone that blocks a fast one, and a fast one that gets past.

    python examples/se_ibr_blocking.py docs/images/se-ibr-blocking.png

On the figure-eight a drone that may fly 2.8 m/s starts 2.2 m behind one that may fly 2.5 m/s. Both keep 1.6 m apart in
a corridor of 0.7 m by 0.7 m at the gates and 1.7 m by 1.7 m between them, so that to pass is hard. The same starts are
flown three times: with no sensitivity, with the leader's, with the follower's.
"""

import functools
import sys
from typing import NamedTuple

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from cruise.env.race_env import make_race_env
from cruise.pilots.se_ibr import SeIbrPilot, Style
from cruise.pilots.se_ibr.centre_line import CentreLine, frame_at, make_centre_line, project
from cruise.presets import TRACKS, VEHICLES
from cruise.racing.grid import Start
from cruise.rollout import fly_from, team_rules
from cruise.vector import dot

TRACK, VEHICLE = TRACKS["figure-eight"], VEHICLES["paper"]
LEADER, FOLLOWER = 2.5, 2.8  # [m/s]
GAP, BEFORE_GATE = 2.2, 2.0  # [m]
SEPARATION, MARGIN, ACCELERATION = 1.6, 0.65, 1.7  # [m], [m], [m/s^2]
PASSED = 0.5  # so far ahead the follower has passed [m]
CASES = {
    "no sensitivity": (0.0, 0.0),
    "the leader's: it blocks": (0.5, 0.0),
    "the follower's: it gets past sooner": (0.0, 0.5),
}
BLUE, GREY = "#0072B2", "#777777"


class Duels(NamedTuple):
    """C cases of R races each, T samples."""

    time: np.ndarray  # [T] s
    seen: np.ndarray  # [2, T, C, R] the faster drone from the slower: ahead along the centre line and to the left [m]

    @property
    def lead(self) -> np.ndarray:
        """[T, C, R] of the slower drone [m]."""
        return -self.seen[0]

    @property
    def passed(self) -> np.ndarray:
        """[C, R] when the follower was past, infinite where it never was [s]."""
        behind = self.lead < -PASSED
        return np.where(behind.any(axis=0), self.time[behind.argmax(axis=0)], np.inf)


def duel(sensitivities: list[tuple[float, float]], races: int, seconds: float = 30.0, seed: int = 0) -> Duels:
    """Fly the same random starts with every pair of sensitivities, the leader's first."""
    line, env = make_centre_line(TRACK), make_race_env(TRACK, 2, VEHICLE)
    start, progress = starts(line, len(sensitivities), races, seed)
    alpha = jnp.repeat(jnp.array(sensitivities, jnp.float32).T, races, axis=1)
    style = Style((LEADER, FOLLOWER), ACCELERATION, MARGIN, SEPARATION, alpha)
    team = [SeIbrPilot(style)] * 2
    rules = team_rules(team, VEHICLE.collision_distance, 1000, alpha.shape[1:])
    flight = fly_from(env, team, rules, env.begin(start), jax.random.key(0), round(seconds / VEHICLE.control_dt))
    seen = jax.jit(functools.partial(follower_seen, line))(progress, flight.position_w)
    time = np.arange(seen.shape[1]) * VEHICLE.control_dt
    return Duels(time, np.asarray(seen).reshape(2, -1, len(sensitivities), races))


def follower_seen(line: CentreLine, progress: jax.Array, position_w: jax.Array) -> jax.Array:
    """[2, T, B] of the second drone from the first: ahead along the centre line, and to the left [m]."""
    _, along = jax.lax.scan(lambda near, position: (project(line, position, near),) * 2, progress, position_w)
    offset = jnp.moveaxis(position_w[:, :, 1] - position_w[:, :, 0], 1, 0)
    return jnp.stack([along[:, 1] - along[:, 0], dot(frame_at(line, along[:, 0]).left_w, offset)])


def starts(line: CentreLine, cases: int, races: int, seed: int) -> tuple[Start, jnp.ndarray]:
    """Leader and follower before random gates, a little to the side; the same for every case."""
    rng = np.random.default_rng(seed)
    gate = rng.integers(0, len(TRACK.gates), races)
    progress = line.gate_progress[gate] - BEFORE_GATE - np.array([[0.0], [GAP]])
    gate, progress, aside = (
        np.tile(gate, cases),
        np.tile(progress, cases),
        np.tile(rng.uniform(-0.1, 0.1, (2, races)), cases),
    )
    frame = frame_at(line, jnp.asarray(progress))
    heading = jnp.arctan2(frame.tangent_w[1], frame.tangent_w[0])
    position = jnp.asarray(frame.point_w + aside * frame.left_w, jnp.float32)
    return Start(position, heading, jnp.asarray(gate, jnp.int32)), jnp.asarray(progress, jnp.float32)


def draw(duels: Duels, race: int, path: str) -> None:
    """Leads over time above, the faster drone as the slower one sees it below; one race stands out."""
    figure, axes = plt.subplots(2, 3, figsize=(13, 7.5), layout="constrained")
    for case, (title, top, below) in enumerate(zip(CASES, axes[0], axes[1], strict=True)):
        draw_leads(top, duels, case, race)
        top.set_title(title, loc="left")
        draw_seen(below, duels.seen[:, :, case], race)
    axes[0, 0].set_ylabel("lead of the slower drone [m]")
    axes[1, 0].set_ylabel("to its left [m]")
    figure.savefig(path, dpi=100)
    plt.close(figure)


def draw_leads(axes: plt.Axes, duels: Duels, case: int, race: int) -> None:
    """Above zero the slower drone is ahead."""
    axes.axhline(0.0, color="black", linewidth=0.8)
    axes.plot(duels.time, duels.lead[:, case], color=GREY, linewidth=0.9)
    axes.plot(duels.time, duels.lead[:, case, race], color=BLUE, linewidth=2.2)
    passed = np.isfinite(duels.passed[case]).sum()
    axes.text(
        0.98, 0.95, f"passed in {passed} of {duels.lead.shape[2]} races", transform=axes.transAxes, ha="right", va="top"
    )
    axes.set(xlabel="time [s]", ylim=(-8, 4), xlim=(0, duels.time[-1]))
    axes.grid(color="#e6e6e6")
    axes.spines[["top", "right"]].set_visible(False)


def draw_seen(axes: plt.Axes, seen: np.ndarray, race: int) -> None:
    """Where the faster drone is, the slower one in the middle, flying to the right."""
    axes.add_patch(plt.Circle((0, 0), SEPARATION, color="#eeeeee"))
    axes.plot(0, 0, marker=">", color="black", markersize=9)
    axes.plot(*seen, color=GREY, linewidth=0.7)
    axes.plot(*seen[..., race], color=BLUE, linewidth=2.2)
    axes.set(xlabel="ahead of the slower drone [m]", xlim=(-4, 4), ylim=(-2.2, 2.2), aspect="equal")
    axes.spines[["top", "right"]].set_visible(False)


if __name__ == "__main__":
    draw(duel(list(CASES.values()), races=12), race=2, path=sys.argv[1])
