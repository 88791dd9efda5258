"""Robot poses in any notation."""
