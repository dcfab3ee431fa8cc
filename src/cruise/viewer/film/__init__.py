"""Races as animated pictures and films, drawn by the processor alone."""
