"""Floor 4: one file a calibration problem."""
