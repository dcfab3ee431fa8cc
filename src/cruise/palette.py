"""Colours of drones, the same in every picture, film and page."""

# Okabe and Ito's colours, distinct to colour-blind eyes, without yellow, which white swallows.
DRONE_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#000000")


def drone_colour(drone: int) -> str:
    """Colour of a drone; they repeat after seven."""
    return DRONE_COLOURS[drone % len(DRONE_COLOURS)]
