"""Recorded sessions as devices: pictures play in turn, and the robot says where it was; it does not move."""
