"""What tasks read: photos, points, poses, robots."""
