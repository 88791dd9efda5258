"""Kinematic calibration: a robot's own geometry from joint values and measured poses."""
