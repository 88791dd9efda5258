"""Depth and stereo cameras: the calibration that their makers deliver."""
