"""Betaflight, the firmware that racing drones run, in the loop: it flies our rotors in lock-step."""
