"""Pilots compared by the logs of their races."""
