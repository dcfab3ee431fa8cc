"""Races in environments as pictures, in a window, and as text."""

import time
import warnings
from collections import deque
from typing import Any, NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from cruise.adapters.races import Races
from cruise.adapters.setup import Setup
from cruise.config import Track
from cruise.racing.motion import gates_at
from cruise.racing.shapes import footprint
from cruise.racing.solids import outlines
from cruise.viewer.painting import look
from cruise.viewer.painting.scene import Drone, Scene, make_scene, paint_scene
from cruise.viewer.painting.scenery import track_scenery

TRAIL = 25  # control steps that a drone's trail goes back
SIZE = (640, 480)  # of pictures [px]
TEXT, ROW, EDGE, CHIP = 12, 16, 10, 9  # of what is written [px]
MOST_ROWS = 8
COLUMNS, ROWS = 64, 22  # of the map in text


class Frame(NamedTuple):
    """One race at a moment; N drones."""

    time: float  # [s]
    position_w: np.ndarray  # [N, 3]
    velocity_w: np.ndarray  # [N, 3]
    rotation: np.ndarray  # [N, 3, 3] from body to world
    next_gate: np.ndarray  # [N]
    gates_passed: np.ndarray  # [N]
    out: np.ndarray  # [N]
    finished: np.ndarray  # [N]
    trail: np.ndarray  # [K, N, 3] where the drones were, oldest first


class Screen:
    """Keeps what a picture needs beside the state, and the window."""

    def __init__(self, races: Races) -> None:
        """Nothing is drawn yet."""
        self._races = races
        self._trail: deque[np.ndarray] = deque(maxlen=TRAIL)
        self._scene: Scene | None = None
        self._window: _Window | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Without scene and window, which are drawn anew."""
        return self.__dict__ | {"_scene": None, "_window": None}

    def begin(self) -> None:
        """Races begin anew."""
        self._trail.clear()

    def follow(self) -> None:
        """Remember where the drones are."""
        self._trail.append(np.asarray(self._races.state.drones.position_w).T)  # [E, N, 3]

    def frame(self, race: int) -> Frame:
        """What there is to draw of a race."""
        state, dynamics = self._races.state, self._races.setup.env.dynamics
        rotation = np.moveaxis(np.asarray(dynamics.rotation(state.drones))[..., race], -1, 0)
        position, velocity = (np.asarray(v)[..., race].T for v in (state.drones.position_w, state.drones.velocity_w))
        counted = (state.next_gate, state.gates_passed, state.out, state.finished)
        gate, passed, out, finished = (np.asarray(value)[..., race] for value in counted)
        steps = int(np.asarray(state.step)[race])
        trail = [places[race] for places in self._trail][-steps - 1 :]
        seconds = steps * dynamics.control_dt
        return Frame(seconds, position, velocity, rotation, gate, passed, out, finished, np.array(trail or [position]))

    def shown(self, mode: str, race: int) -> Any:
        """A race as text for `ansi`, or else as a picture [H, W, 3] uint8."""
        frame = self.frame(race)
        return ansi(self._races.setup, frame) if mode == "ansi" else self.picture(frame)

    def picture(self, frame: Frame) -> np.ndarray:
        """[H, W, 3] uint8."""
        setup, track = self._races.setup, self._races.choices.track
        lines = status(setup, frame)[:MOST_ROWS]
        if self._scene is None:
            margins = (EDGE, EDGE + ROW * (len(lines) + 1.5), EDGE, EDGE)
            self._scene = make_scene(track_scenery(track), SIZE, margins)
        picture = paint_scene(self._scene, _drones(frame), _strips(track, frame), frame.time)
        _write(picture, f"{track.name}   {frame.time:.1f} s", lines)
        return np.asarray(picture)

    def show(self, race: int) -> None:
        """Draw in a window, in real time."""
        if self._window is None:
            self._window = _Window(self._races.choices.vehicle.control_dt)
        self._window.show(self.picture(self.frame(race)))

    def close(self) -> None:
        """Close the window."""
        if self._window is not None:
            self._window.close()
            self._window = None


def _drones(frame: Frame) -> list[Drone]:
    """What there is to paint; trails fade with their age."""
    age = np.linspace(1.0, 0.0, len(frame.trail))
    return [
        Drone(k, place, frame.rotation[k], _fate(frame, k) or "flying", frame.trail[:, k], age)
        for k, place in enumerate(frame.position_w)
    ]


def _strips(track: Track, frame: Frame) -> list[look.Colour]:
    """The gate that drone 1 flies to is lit."""
    following = int(frame.next_gate[0])
    return [look.HIGHLIGHT if gate == following else look.STRIP for gate in range(len(track.gates))]


def _write(picture: Image.Image, title: str, lines: list[str]) -> None:
    draw = ImageDraw.Draw(picture)
    draw.text((EDGE, EDGE), title, look.INK, look.font(TEXT, bold=True))
    for row, line in enumerate(lines, start=1):
        top = EDGE + ROW * row
        draw.rectangle((EDGE, top + 2, EDGE + CHIP, top + 2 + CHIP), fill=look.colour_of(row - 1))
        draw.text((EDGE + 2 * CHIP, top), line, look.INK, look.font(TEXT))


def _fate(frame: Frame, drone: int) -> str:
    return "finished" if frame.finished[drone] else "out" if frame.out[drone] else ""


class _Window:
    """A window of matplotlib, which is installed in any case."""

    def __init__(self, interval: float) -> None:
        import matplotlib.pyplot as plt  # noqa: PLC0415  (slow to import)

        self.plt, self.interval, self.shown_at = plt, interval, 0.0
        self.figure: Any = None
        if plt.get_backend().lower() == "agg":
            warnings.warn('no window can be shown here; render_mode="rgb_array" gives the picture', stacklevel=2)

    def show(self, picture: np.ndarray) -> None:
        """Put up a picture and wait until it is time for the next."""
        if self.figure is None:
            self.figure = self.plt.figure("CRUISE", figsize=(picture.shape[1] / 100, picture.shape[0] / 100), dpi=100)
            axes = self.figure.add_axes((0, 0, 1, 1))
            axes.axis("off")
            self.image = axes.imshow(picture)
        self.image.set_data(picture)
        self.figure.canvas.draw_idle()
        self.figure.canvas.flush_events()
        rest = self.interval - (time.monotonic() - self.shown_at)
        if self.plt.get_backend().lower() != "agg":
            self.plt.pause(max(rest, 1e-3))
        self.shown_at = time.monotonic()

    def close(self) -> None:
        """Close it."""
        if self.figure is not None:
            self.plt.close(self.figure)


def status(setup: Setup, frame: Frame) -> list[str]:
    """A line for every drone."""
    lines = []
    for drone, name in enumerate(setup.names):
        fate = _fate(frame, drone)
        speed = float(np.linalg.norm(frame.velocity_w[drone]))
        words = fate or f"{speed:4.1f} m/s, to gate {int(frame.next_gate[drone]) + 1}"
        lines.append(f"{drone + 1} {name}: {int(frame.gates_passed[drone])} gates, {words}")
    return lines


def ansi(setup: Setup, frame: Frame) -> str:
    """The race from above, in characters: gates by letter, drones by number, solids as #; then a line per drone."""
    gates = np.array([gate.position_w for gate in gates_at(setup.env.track.gates, frame.time)])
    points = np.concatenate([gates, frame.position_w])[:, :2]
    low = np.minimum(points.min(axis=0), gates[:, :2].min(axis=0)) - 2.0
    span = np.maximum(points.max(axis=0) + 2.0 - low, 1e-6)
    grid = [[" "] * COLUMNS for _ in range(ROWS)]

    def put(place: np.ndarray, sign: str) -> None:
        column, row = ((place[:2] - low) / span * (COLUMNS - 1, ROWS - 1)).round().astype(int)
        grid[ROWS - 1 - row][column] = sign

    for solid in outlines(setup.env.track.obstacles):
        for place in (np.array(solid.centre_w), *footprint(solid)):
            if (np.abs(place[:2] - low - span / 2) <= span / 2).all():
                put(place, "#")
    for number, gate in enumerate(gates):
        put(gate, chr(ord("A") + number % 26))
    for drone in range(len(frame.position_w)):
        put(frame.position_w[drone], str((drone + 1) % 10))
    title = f"{setup.env.track.name}, {frame.time:.1f} s"
    return "\n".join([title, *("".join(row).rstrip() for row in grid), *status(setup, frame)]) + "\n"
