"""Races in perspective, for films and for `render`: Pillow paints them, without a graphics card."""
