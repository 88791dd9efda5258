"""Several cameras rigid to each other."""
