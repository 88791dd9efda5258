"""Floor 3: what is seen through a calibrated camera."""
