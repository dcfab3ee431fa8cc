"""Colours, declared once: of drones, of series in figures, of the scene in films, in `render` and on the page."""

# Okabe and Ito's colours, distinct to colour-blind eyes, without yellow, which white swallows.
BLUE, ORANGE, GREEN, PINK, SKY, VERMILION, BLACK = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#CC79A7",
    "#56B4E9",
    "#D55E00",
    "#000000",
)
DRONE_COLOURS = (BLUE, ORANGE, GREEN, PINK, SKY, VERMILION, BLACK)

INK, FAINT, GRID = "#222222", "#8a8a8a", "#e6e6e6"  # of figures: writing and lines, what is said in passing, grids


def drone_colour(drone: int) -> str:
    """Colour of a drone; they repeat after seven."""
    return DRONE_COLOURS[drone % len(DRONE_COLOURS)]
