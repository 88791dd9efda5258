"""Names of a cell's unknowns, factors and noise groups, and the least noise that is worth telling from none."""

from __future__ import annotations

PIXEL, ROBOT_ROTATION, ROBOT_TRANSLATION = "pixel", "robot rotation", "robot translation"
TARGET_ROTATION, TARGET_TRANSLATION = "target rotation", "target translation"
JOINTS, SCALE = "joints", "target scale"
ONLY_ROBOT = "robot"

PHOTO_FLOORS = {PIXEL: 1e-4, ROBOT_ROTATION: 1e-6, ROBOT_TRANSLATION: 1e-7, JOINTS: 1e-6}
PAIR_FLOORS = {TARGET_ROTATION: 1e-9, TARGET_TRANSLATION: 1e-10, ROBOT_ROTATION: 1e-9, ROBOT_TRANSLATION: 1e-10}
"""Noise worth telling from none, with images and without: pixels, radians, metres. No detector or robot comes within
100 times of these."""

TOUCH_FLOOR = 1e-7
"""Metres: as for robots with images."""


def pixel_group(camera: str) -> str:
    """Noise group of a camera's pixels."""
    return f"{PIXEL} {camera}"


def robot_groups(robot: str) -> tuple[str, str]:
    """Noise groups of a robot's rotations and translations."""
    return f"{ROBOT_ROTATION} {robot}", f"{ROBOT_TRANSLATION} {robot}"


def measured_groups(camera: str) -> tuple[str, str]:
    """Noise groups of target poses that were measured elsewhere."""
    return f"{TARGET_ROTATION} {camera}", f"{TARGET_TRANSLATION} {camera}"


def joint_group(robot: str) -> str:
    """Noise group of a robot's joints, where its readings are given."""
    return f"{JOINTS} {robot}"


def lens_variable(camera: str) -> str:
    """Name of a camera's intrinsics."""
    return f"lens of {camera}"


def extra_variable(camera: str) -> str:
    """Name of the target poses of a camera's views that belong to no robot pose."""
    return f"views of {camera} without a robot pose"


def geometry_variable(robot: str) -> str:
    """Name of a robot's free joint offsets and geometry."""
    return f"geometry of {robot}"


def errors_variable(robot: str) -> str:
    """Name of what a robot's joints did beyond their readings and its geometry."""
    return f"joint errors of {robot}"


def scale_variable(target: str) -> str:
    """Name of a target's scale, less 1."""
    return f"{SCALE} {target}"


def pictures_factor(i: int) -> str:
    """Name of the reprojection factor of list i."""
    return f"pictures {i}"
