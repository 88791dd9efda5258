"""A calibration that runs beside a robot: samples taken while it stands still, the result and the live estimate.

Nothing here knows where pictures and transforms come from: `calibrant.ros` brings them.
"""
