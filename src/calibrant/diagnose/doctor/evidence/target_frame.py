"""What measured target poses look like: a camera's target in front of it, or something else.

The loop closes as well with T_target_camera in the other setup, and with robot and target poses in each other's place:
only what a camera can see tells them apart. But not every camera's frame has z ahead (ROS body: x; OpenGL: -z), and a
track (visual odometry, SLAM, a phone) whose target frame is its own first pose has no target to stand in front of.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.geometry import se3

HALF_FIELD = np.deg2rad(45)
"""A target stands within 45 degrees of the axis, its origin included, with any but a fisheye lens."""
CONE = 0.5 * (1 - np.cos(HALF_FIELD))
"""Share of the sphere within that."""
SEEN = 0.9
NOT_SEEN = 0.5
"""Shares of poses that lie within that: nearly all of them should. A wide lens sees some origins, the boards' corners,
farther off its axis, so that only most of them elsewhere say that this is no optical camera's frame."""
AT_ORIGIN = 0.02
"""A pose is the frame that a track is told in when it lies within 2 % of the track's size from it, and is turned by no
more than that part of a radian: odometry starts at its own frame exactly, a target is never inside the camera."""
AXES = {"+x": (1, 0, 0), "-x": (-1, 0, 0), "+y": (0, 1, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}
"""Where a camera may look that is not optical."""


def visible(B: Array, axis: tuple[int, int, int] = (0, 0, 1)) -> NDArray[np.bool_]:
    """Target poses (n, 4, 4) that a camera looking along the axis could see: in front of it and near the axis."""
    t = B[:, :3, 3]
    return np.asarray(t @ np.array(axis, dtype=float) > np.cos(HALF_FIELD) * np.linalg.norm(t, axis=1))


def look_inverted(robot: Array, B: Array) -> bool:
    """True for target poses B that no camera sees, while it would see their inverses, and not the robot poses instead.

    T_target_camera in the other setup closes the loop just as well (B^-1 for B exchanges X and Z): only sense can tell.
    """
    return bool(
        visible(B).mean() < NOT_SEEN
        and visible(se3.inverse(B)).mean() >= SEEN
        and visible(robot).mean() < SEEN
        and not is_track(B)
    )


def is_track(B: Array) -> bool:
    """True for poses (n, 4, 4) of which one is the frame that all are told in, as odometry begins with it."""
    distance = np.linalg.norm(B[:, :3, 3], axis=1)
    turned = np.deg2rad(se3.deviation(np.eye(4), B)[1])
    size = float(distance.max())
    return bool(size > 0 and ((distance <= AT_ORIGIN * size) & (turned <= AT_ORIGIN)).any())


def other_axis(B: Array) -> str | None:
    """The axis of its frame that a camera looks along when that is not z, by where its targets (n, 4, 4) are."""
    if is_track(B) or visible(B).mean() >= NOT_SEEN:
        return None
    return next((name for name, axis in AXES.items() if visible(B, axis).mean() >= SEEN), None)
