"""The loop from the target through camera and robot back to it: its motion, its errors, its noise."""
