"""calibrant: calibrate cameras and robots, and prove it."""

__version__ = "0.1.0"
