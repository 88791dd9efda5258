"""Hand-eye and robot-world calibration: where the camera and the target sit, from robot poses and target poses."""
