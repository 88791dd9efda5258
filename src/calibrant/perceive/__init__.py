"""Floor 6: what is seen through a calibrated camera."""
