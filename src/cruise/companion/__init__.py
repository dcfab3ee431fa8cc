"""A policy on the computer aboard a drone: odometry in, sticks or attitude targets out, and what keeps that safe."""
