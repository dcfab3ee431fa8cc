"""Named protocols: how others measure, as data, so that their numbers and ours can stand side by side."""

import itertools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cruise.config import EXACT, Randomisation, Sensing, StartPlaces, Track
from cruise.errors import CruiseError
from cruise.tracks import on_arc


class StartGrid(NamedTuple):
    """Fixed starts: every combination of a few offsets, the same for all drones of a race.

    Drones wait on the level circle around the first gate through the track's first place, so far apart along it, and
    the offsets are turned along: into the gate's frame and by each drone's bearing from it.
    """

    reach: tuple[float, float, float]  # largest offset forward, to the left and up [m]
    each: int  # offsets per axis, evenly from -reach to reach
    spacing: float  # of neighbours, along the arc [m]
    centred_from: int  # more drones than this spread to both sides

    def places(self, track: Track, drones: int) -> tuple[np.ndarray, np.ndarray]:
        """Positions [3, N, E] and headings [N, E]. Raises CruiseError where the track has no places to start from."""
        if not isinstance(track.start, StartPlaces):
            raise CruiseError(f"{track.name} does not say where drones wait, which this protocol needs")
        first, gate = track.start.places[0], track.gates[track.start_gate]
        shift = max(0, drones - self.centred_from) / 2
        along = [self.spacing * (slot - shift) for slot in range(drones)]
        waiting = on_arc(gate, first.position_w, first.yaw, along)
        axes = (np.linspace(-most, most, self.each) for most in self.reach)
        offsets = np.array(list(itertools.product(*axes)))
        position = np.empty((3, drones, len(offsets)))
        for drone, place in enumerate(waiting):
            x, y, z = place.position_w
            turn = gate.yaw + math.atan2(y - gate.position_w[1], x - gate.position_w[0])
            forward, left, up = offsets.T
            position[0, drone] = x + math.cos(turn) * forward - math.sin(turn) * left
            position[1, drone] = y + math.sin(turn) * forward + math.cos(turn) * left
            position[2, drone] = z + up
        heading = np.repeat(np.array([place.yaw for place in waiting])[:, None], len(offsets), axis=1)
        return position, heading


NOTHING_RANDOM = Randomisation()


@dataclass(frozen=True)
class Protocol:
    """How somebody measures pilots."""

    name: str
    about: str  # whose it is
    tracks: tuple[str, ...]
    fields: tuple[int, ...]  # how many drones race each other, each flown by the same pilot
    races: int  # of every field, on every track
    measures: tuple[str, ...]  # names of `measures.MEASURES`
    laps: int | None = None  # None: the track's
    time_limit: float | None = None  # None: as every race [s]
    grid: StartGrid | None = None  # in place of starts by chance; its starts are the races
    randomisation: Randomisation = NOTHING_RANDOM
    sensing: Sensing = EXACT
    line_ups: int = 0  # of `line_up` pilots drawn from a pool with replacement, where one is given
    line_up: int = 4


PAPER = Protocol(
    name="paper",
    about="Akgün, Curriculum-Based Iterative Self-Play for Scalable Multi-Drone Racing: three laps from random starts",
    tracks=("ring", "figure-eight"),
    fields=(2, 3, 4),
    races=100,
    measures=("finished", "speed"),
    laps=3,
)
UZH = Protocol(
    name="uzh",
    about="uzh-rpg/marl-racing, 1c27b79: three laps of 22 gate passages, 20 s, 64 starts on a grid; line-ups of four",
    tracks=("uzh-2026",),
    fields=(1, 2, 3, 4, 5, 6, 7, 8),
    races=64,
    measures=("finished", "gates", "rank", "hit_gate", "hit_world", "hit_drone", "best_lap", "overtakes"),
    laps=3,
    time_limit=20.0,
    grid=StartGrid(reach=(0.33, 0.33, 0.2), each=4, spacing=1.0, centred_from=4),
    line_ups=1000,
)
LSY = Protocol(
    name="lsy",
    about="utiasDSL/lsy_drone_racing, eb891d0, level 2, in our simulator: gates and poles stand elsewhere every time",
    tracks=("lsy-2",),
    fields=(1,),
    races=100,
    measures=("finished", "gates", "time", "hit_gate", "hit_world"),
    randomisation=Randomisation(gate_shift=0.15, gate_turn=0.2, gate_tilt=0.1, solid_shift=0.15, mass_spread=0.115),
    sensing=Sensing(
        "range", 0.7, sensor_rate=50.0, sensor_latency=0.0, velocity_bias=0.0, drift_share=0.0, fix_error=0.0
    ),
)
PROTOCOLS: dict[str, Protocol] = {protocol.name: protocol for protocol in (PAPER, UZH, LSY)}
