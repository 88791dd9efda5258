"""Two clocks: the offset between the camera's and the robot's time."""
