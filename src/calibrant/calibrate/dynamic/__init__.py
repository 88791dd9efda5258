"""A camera beside the robot, located through the wrist camera."""
