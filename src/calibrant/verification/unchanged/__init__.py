"""Is yesterday's calibration still good: one to three photos, with poses or a reference picture, against a result."""
