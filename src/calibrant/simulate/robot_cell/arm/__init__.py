"""The arm with its gripper, and the controller that moves it."""
