"""Floor 3: files of the outside world, one file a format."""
