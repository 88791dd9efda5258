"""Floor 1: kinematic chains."""
