"""Races to look at: the 3-D replay page, the live view, and films."""
