"""Vehicles as objects and files."""
