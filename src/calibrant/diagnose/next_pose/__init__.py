"""Which poses to take next."""
