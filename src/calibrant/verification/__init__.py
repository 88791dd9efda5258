"""Floor 7: whether a calibration holds, shown by what is seen now; it never learns whether a robot is simulated."""
