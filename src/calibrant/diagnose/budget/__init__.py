"""What the result's errors come to where the tool works."""
