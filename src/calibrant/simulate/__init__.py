"""Floor 3: rendered targets, noise, simulated robot cells."""
