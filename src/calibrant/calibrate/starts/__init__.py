"""First guesses of any lens."""
