"""How fast the planner flies: as the paper's planner did, or as fast as the vehicle can."""

import functools
import json
import math
from pathlib import Path
from typing import Literal

from cruise.config import Track, Vehicle
from cruise.errors import CruiseError
from cruise.pilots.se_ibr.centre_line import make_centre_line
from cruise.pilots.se_ibr.options import Style
from cruise.presets import PAPER_TRACKS

Setting = Literal["paper", "tuned"]

TUNED = Path(__file__).parent / "tuned.json"  # written by `cruise tune-planner`
STYLE_KEYS = ("speed", "acceleration", "margin", "separation", "sensitivity", "lead")
CAREFUL = {"speed": min, "acceleration": min, "sensitivity": min, "margin": max, "separation": max, "lead": max}

# What the paper's planner flew under the caps of its repository, 3 m/s horizontally and 2 m/s vertically [m/s].
PAPER_SPEEDS = {"ring": 2.29, "figure-eight": 1.85}
HORIZONTAL_CAP, VERTICAL_CAP = 3.0, 2.0
PAPER_TURNING = 0.567  # v^2 kappa: the geometric mean of 0.53 on the ring and 0.61 on the figure-eight [m/s^2]
PAPER_ACCELERATION = 1.5  # [m/s^2]

UNTRIED_SPEED, UNTRIED_ACCELERATION = 0.75, 0.5  # of what a vehicle can do, where nobody tuned the planner


def style_of(setting: Setting, track: Track, vehicle: Vehicle) -> Style:
    """How to fly a track with a vehicle in a setting."""
    if setting == "paper":
        return paper_style(track)
    return tuned_style(track) if vehicle.flown_by == "cascade" else style_for(vehicle)


def paper_style(track: Track) -> Style:
    """The speed of the paper's planner; on other tracks the speed at which they turn it as much as those of the paper.

    That is v with v^2 kappa = `PAPER_TURNING`, kappa the mean curvature of the centre line, within the caps. The same
    rule gives 2.37 m/s on the ring and 1.79 m/s on the figure-eight, 4 % from what was measured there.
    """
    name = built_in(track)
    speed = PAPER_SPEEDS[name] if name in PAPER_SPEEDS else turning_speed(track)
    return Style(speed, PAPER_ACCELERATION)


def turning_speed(track: Track) -> float:
    """The speed of the rule in `paper_style` [m/s]."""
    line = make_centre_line(track)
    curvature = max(float(line.curvature.mean()), PAPER_TURNING / HORIZONTAL_CAP**2)
    steepest = max(float(abs(line.tangent_w[2]).max()), VERTICAL_CAP / HORIZONTAL_CAP)
    return min(math.sqrt(PAPER_TURNING / curvature), VERTICAL_CAP / steepest)


def tuned_style(track: Track) -> Style:
    """What was found best for a track; where nobody looked, the most careful of what was found elsewhere."""
    found = read_tuned(TUNED)
    name = built_in(track)
    if name in found:
        return found[name]
    return Style(*(CAREFUL[key](getattr(style, key) for style in found.values()) for key in STYLE_KEYS))


def style_for(vehicle: Vehicle) -> Style:
    """A share of what a vehicle can do, for vehicles that nobody tuned the planner for.

    Three quarters of the speed that its velocity loop is meant for, and half of the acceleration that its thrust leaves
    beside its weight.
    """
    return Style(UNTRIED_SPEED * vehicle.tracking.speed, UNTRIED_ACCELERATION * level_acceleration(vehicle))


def level_acceleration(vehicle: Vehicle) -> float:
    """What the thrust of a vehicle with rotors leaves beside its weight [m/s^2]."""
    return math.sqrt(max(vehicle.agility**2 - vehicle.gravity**2, 0.0))


@functools.lru_cache(maxsize=8)
def read_tuned(path: Path) -> dict[str, Style]:
    """Styles by track from a file that `cruise tune-planner` wrote. Raises CruiseError where it is not one."""
    try:
        tracks = json.loads(path.read_bytes())["tracks"]
        return {name: Style(*(float(entry["style"][key]) for key in STYLE_KEYS)) for name, entry in tracks.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise CruiseError(f"{path} is no file of `cruise tune-planner`: {error!r}") from None


def built_in(track: Track) -> str | None:
    """Name of the built-in track with the same gates, whatever this one is called."""
    return next((name for name, known in PAPER_TRACKS.items() if known.gates == track.gates), None)
