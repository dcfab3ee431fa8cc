"""A vehicle as a picture: seen from above, to scale, and how its roll rate answers."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from cruise.config import Airframe, Vehicle
from cruise.dynamics.rotors import YAW, places
from cruise.errors import CruiseError
from cruise.palette import FAINT, GATE
from cruise.report.figure_style import BLUE, INK, new_figure, our_look, tidy, to_png
from cruise.vehicles.derived import figures

SAMPLES = 400
SHOWN = 6.0  # time constants of rotors and rate loop together


@our_look()
def draw_vehicle(vehicle: Vehicle) -> bytes:
    """A PNG picture. Raises CruiseError where there are no rotors to draw."""
    airframe = vehicle.airframe
    if airframe is None:
        raise CruiseError(f"vehicle {vehicle.name!r} has no rotors to draw: leave out --png")
    figure = new_figure(10.5, 5.0)
    above, answer = figure.subplots(1, 2, width_ratios=(1.0, 1.2))
    _from_above(above, airframe)
    _rate_answer(answer, airframe)
    said = "\n".join(f"{one.name} {one.value} {one.unit}".strip() for one in figures(vehicle))
    answer.text(0.97, 0.05, said, ha="right", va="bottom", transform=answer.transAxes, linespacing=1.5, color=INK)
    figure.suptitle(f"{vehicle.name}: {vehicle.mass:.4g} kg", fontsize=14, fontweight="bold", color=INK)
    return to_png(figure)


def _from_above(axes: Axes, airframe: Airframe) -> None:
    """Arms, propellers and which way they turn, its nose upwards; [mm]."""
    radius = 1000 * airframe.rotors.radius
    for number, ((forward, left, _), yaw) in enumerate(zip(places(airframe.rotors), YAW, strict=True), start=1):
        x, y = -1000 * left, 1000 * forward
        axes.plot([0, x], [0, y], color=GATE, linewidth=5, solid_capstyle="round", zorder=1)
        axes.add_patch(Circle((x, y), radius, facecolor=BLUE, alpha=0.25, zorder=2))
        label = f"{number} {'↻' if yaw > 0 else '↺'}"
        axes.text(1.25 * x, 1.25 * y, label, ha="center", va="center", fontsize=13, color=INK, zorder=3)
    size = 1000 * math.hypot(*airframe.rotors.offset)
    axes.annotate("", (0, 0.55 * size), (0, 0), arrowprops={"arrowstyle": "-|>", "color": INK}, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
    axes.margins(0.05)
    tidy(axes, "Seen from above (arrow: forward)", "to the right [mm]", "forward [mm]")


def _rate_answer(axes: Axes, airframe: Airframe) -> None:
    """From rest, while no rotor is at its limit."""
    loop, lag = airframe.rates.time_constant, airframe.rotors.time_constant
    time = np.linspace(0.0, SHOWN * (loop + lag), SAMPLES)
    axes.plot(1000 * time, rate_answer(time, loop, lag), color=BLUE, linewidth=2)
    axes.axhline(1.0, color=FAINT, linewidth=1)
    tidy(axes, "Roll rate after a step, over what is asked", "time [ms]", "")


def rate_answer(time: np.ndarray, loop: float, lag: float) -> np.ndarray:
    """The share of a step in the asked rate that is there after `time` [s]: t T w'' + t w' + w = 1.

    t is the time constant of the rate `loop`, T the `lag` of the rotors between it and the body.
    """
    if lag == 0:
        return np.asarray(1 - np.exp(-time / loop))
    root = np.sqrt(complex(1 - 4 * lag / loop)) + 1e-4  # of two roots that are one
    slow, fast = (-1 + root) / (2 * lag), (-1 - root) / (2 * lag)
    return np.asarray(np.real(1 - (fast * np.exp(slow * time) - slow * np.exp(fast * time)) / (fast - slow)))
