"""What users have, drawn at random with its truth: a simulator that shares nothing with the calibrator but NumPy."""
