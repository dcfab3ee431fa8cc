"""Colours, declared once in `palette.json`, which the build of viewer/ reads as well."""

import json
from importlib import resources
from typing import Any

COLOURS: dict[str, Any] = json.loads(resources.files("cruise").joinpath("palette.json").read_text(encoding="utf-8"))

# Okabe and Ito's colours, distinct to colour-blind eyes, without yellow, which white swallows.
DRONE_COLOURS: tuple[str, ...] = tuple(COLOURS["drones"])
BLUE, ORANGE, GREEN, PINK, SKY, VERMILION, BLACK = DRONE_COLOURS
# Of figures: writing and lines, what is said in passing, grids, gates, poles and walls.
INK, FAINT, GRID, GATE, SOLID = (COLOURS["figures"][name] for name in ("ink", "faint", "grid", "gate", "solid"))


def drone_colour(drone: int) -> str:
    """Colour of a drone; they repeat after seven."""
    return DRONE_COLOURS[drone % len(DRONE_COLOURS)]
