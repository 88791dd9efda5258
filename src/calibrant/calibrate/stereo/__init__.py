"""Two cameras fixed to each other: a rig of two, and what is asked of a pair alone."""
