"""Time-optimal laps: how fast a vehicle could fly a track at all."""
