"""ChArUco boards."""
