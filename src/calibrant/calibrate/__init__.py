"""Floor 4: one room a calibration problem, and rooms that they share."""
