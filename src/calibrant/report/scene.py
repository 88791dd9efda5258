"""The 3D scene of a result: frames, cameras and targets in one world, for the page to draw.

Hand-eye results stand in the robot's base, z up. Intrinsics stand in the camera's frame, y down. Poses are given as the
twelve numbers of [R | t], row by row, metres.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.report.loop import LoopView, hand_eye_pair, target_outline

Array = NDArray[np.float64]

_DECIMALS = 7
"""A tenth of a micrometre: differences stay smooth when the page magnifies them a hundredfold."""
_MOST_POSES = 150
"""More poses hide each other; every k-th is drawn then."""


def scene(
    result: CalibrationResult, poses: Mapping[tuple[str, str], Array], loop: tuple[LoopView, ...]
) -> dict[str, Any] | None:
    """Frames, cameras, boards and layers of the 3D view, or None when the result holds no pose to show.

    Args: poses, T_camera_target by (camera, view id); loop, of a hand-eye result.
    """
    if loop:
        return _hand_eye_scene(result, loop)
    return _camera_scene(result, poses) if poses else None


def _hand_eye_scene(result: CalibrationResult, loop: tuple[LoopView, ...]) -> dict[str, Any]:
    pair = hand_eye_pair(result)
    in_hand = pair is not None and pair[0].parent == "gripper"
    drawn = loop[:: -(-len(loop) // _MOST_POSES)]
    corners = _frustum(result)
    frames = [{"label": "base", "T": _flat(np.eye(4)), "layer": "base", "view": None}]
    frames += [
        {"label": f"gripper {v.id}", "T": _flat(v.T_base_gripper), "layer": "gripper", "view": v.id} for v in drawn
    ]
    moving = [{"label": f"camera {v.id}", "T": _flat(v.T_base_camera), "view": v.id, "rays": corners} for v in drawn]
    still = [{"label": "camera", "T": _flat(drawn[0].T_base_camera), "view": None, "rays": corners}]
    by_robot = [{"T": _flat(v.T_base_target_by_robot), "view": v.id} for v in drawn]
    by_camera = [
        {"T": _flat(v.T_base_target_by_camera), "view": v.id} for v in drawn if v.T_base_target_by_camera is not None
    ]
    robot_label = "Target by the robot (base → target)" if in_hand else "Target carried by the robot"
    return {
        "up": [0, 0, 1],
        "frames": frames,
        "cameras": moving if in_hand else still,
        "outline": _outline(result),
        "boards": {"seen": by_camera, "robot": by_robot[:1] if in_hand else by_robot},
        "layers": {
            "base": "Robot base",
            "gripper": "Gripper poses",
            "camera": "Camera poses" if in_hand else "Camera",
            "seen": "Target as the camera sees it",
            "robot": robot_label,
        },
    }


def _camera_scene(result: CalibrationResult, poses: Mapping[tuple[str, str], Array]) -> dict[str, Any]:
    names = list(poses)[:: -(-len(poses) // _MOST_POSES)]
    return {
        "up": [0, -1, 0],
        "frames": [],
        "cameras": [{"label": "camera", "T": _flat(np.eye(4)), "view": None, "rays": _frustum(result)}],
        "outline": _outline(result),
        "boards": {"seen": [{"T": _flat(poses[key]), "view": key[1]} for key in names], "robot": []},
        "layers": {"camera": "Camera", "seen": "Target, one outline a view"},
    }


def _outline(result: CalibrationResult) -> list[list[float]]:
    corners = target_outline(result)
    if corners is None:
        # Target poses were given without points: a 100 mm square stands for the target.
        corners = 0.1 * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    return np.round(corners, _DECIMALS).tolist()


def _frustum(result: CalibrationResult) -> list[list[float]]:
    """Directions (4, 3) with z = 1 through the image's corners; 4:3 and 53 degrees wide without a camera."""
    camera: Camera | None = next(iter(result.cameras.values()), None)
    if camera is None:
        return [[-0.5, -0.375, 1.0], [0.5, -0.375, 1.0], [0.5, 0.375, 1.0], [-0.5, 0.375, 1.0]]
    width, height = camera.image_size
    pixels = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float64)
    rays = camera.unproject(pixels)
    if not np.all(np.isfinite(rays)) or np.any(rays[:, 2] <= 1e-3):
        rays = np.concatenate([pixels, np.ones((4, 1))], axis=1) @ np.linalg.inv(camera.K).T
    return np.round(rays / rays[:, 2:], 4).tolist()


def _flat(T: Array) -> list[float]:
    return np.round(T[:3].ravel(), _DECIMALS).tolist()
