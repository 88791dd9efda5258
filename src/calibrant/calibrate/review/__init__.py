"""What a finished calibration is asked of its own observations: coverage, and structure of the residuals."""
