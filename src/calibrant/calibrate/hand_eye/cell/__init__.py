"""A cell of cameras, robots, targets and lists of pictures as one weighted problem."""
