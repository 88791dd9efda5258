"""Floor 8: what every command does, without a terminal."""
