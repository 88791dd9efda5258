"""Grids of circles and dots."""
