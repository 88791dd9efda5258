"""The cell: cameras, robots, targets and what the cameras saw, as one weighted problem with one pipeline."""
