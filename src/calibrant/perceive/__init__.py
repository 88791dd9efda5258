"""Floor 5: what is seen through a calibrated camera."""
