"""CRUISE: learning to race drones against drones."""

__version__ = "0.1.0"
