"""The unknowns and equations of a cell: its frames, its cameras, its robots, its factors."""
