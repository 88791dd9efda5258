"""What a pointer points at: two uncalibrated cameras, a working plane and a line."""
