"""Hand-eye from one point: on the gripper, seen by a depth camera that stands, or in the scene, seen from the arm."""
