"""Measurements of a robot: joint values, and where a device beside it saw the tool."""
