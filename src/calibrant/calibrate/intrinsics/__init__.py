"""A camera from views of a target."""
