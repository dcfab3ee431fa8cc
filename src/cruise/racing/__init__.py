"""The sport: tracks and gates, what a drone can hit, where it starts."""
