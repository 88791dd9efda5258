"""How poses are written, decided from the data."""
