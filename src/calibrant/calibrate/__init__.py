"""Floor 5: one room a calibration problem, and rooms that they share."""
