"""Tasks that run experiments."""
