"""SE-IBR: a game-theoretic planner as a pilot."""

from cruise.pilots.se_ibr.options import Algorithm, Style, Weights
from cruise.pilots.se_ibr.pilot import SeIbrPilot

__all__ = ["Algorithm", "SeIbrPilot", "Style", "Weights"]
