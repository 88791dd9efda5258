"""Commands that show whether a calibration holds."""
