"""Hand-eye from a single point that a depth camera sees."""
