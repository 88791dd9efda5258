"""Rotation (and focal length) of a camera from the straight edges of a scene of three orthogonal directions."""
