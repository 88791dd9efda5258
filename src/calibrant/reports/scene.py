"""The 3D scene of a result: frames, cameras and targets in one world, for the page to draw.

Hand-eye results stand in the robot's base, z up. Intrinsics stand in the camera's frame, y down. Poses are given as the
twelve numbers of [R | t], row by row, metres.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.diagnose.look import Look
from calibrant.diagnose.loop import LoopView, target_outline

_DECIMALS = 7
"""A tenth of a micrometre: differences stay smooth when the page magnifies them a hundredfold."""
_MOST_POSES = 150
"""More poses hide each other; every k-th is drawn then."""


def scene(look: Look) -> dict[str, Any] | None:
    """Frames, cameras, boards and layers of the 3D view, or None when the result holds no pose to show."""
    if look.loop:
        return _hand_eye_scene(look)
    return _camera_scene(look.result, look.poses) if look.poses else None


def _hand_eye_scene(look: Look) -> dict[str, Any]:
    result, loop = look.result, look.loop
    drawn = loop[:: -(-len(loop) // _MOST_POSES)]
    frames = [{"label": "base", "T": _flat(np.eye(4)), "layer": "base", "view": None}, *_other_bases(look)]
    grippers = {v.id: v for v in drawn}
    frames += [
        {"label": f"gripper {v.id}", "T": _flat(v.T_base_gripper), "layer": "gripper", "view": v.key}
        for v in grippers.values()
    ]
    robot, of = _boards_by_robot(drawn)
    seen = [
        {"T": _flat(v.T_base_target_by_camera), "view": v.key, "label": _label(result, v), "of": of[v.key]}
        for v in drawn
        if v.T_base_target_by_camera is not None
    ]
    stands, carried = any(not v.target_carried for v in loop), any(v.target_carried for v in loop)
    words = ["it stands"] * stands + ["the robot carries it"] * carried
    return {
        "up": [0, 0, 1],
        "frames": frames,
        "cameras": _cameras(look, drawn),
        "outline": _outline(result),
        "boards": {"seen": seen, "robot": robot},
        "layers": {
            "base": "Robot base",
            "gripper": "Gripper poses",
            "camera": "Camera poses" if any(v.in_hand for v in loop) else "Camera",
            "seen": "Target as the camera sees it" if len(result.cameras) < 2 else "Target as each camera sees it",
            "robot": f"Target by the robot ({' or '.join(words)})",
        },
    }


def _label(result: CalibrationResult, v: LoopView) -> str:
    """A view for people: with its camera, where there are several."""
    return v.view if len(result.cameras) < 2 else f"{v.camera}, {v.view}"


def _other_bases(look: Look) -> list[dict[str, Any]]:
    return [{"label": b, "T": _flat(T), "layer": "base", "view": None} for b, T in look.other_bases.items()]


def _cameras(look: Look, drawn: Sequence[LoopView]) -> list[dict[str, Any]]:
    """A frustum a pose for cameras that are carried, one for each that stands still."""
    result = look.result
    out: list[dict[str, Any]] = []
    still: dict[str, Array] = {}
    for v in drawn:
        if not v.in_hand:
            still.setdefault(v.camera, v.T_base_camera)
            continue
        rays = _frustum(result.cameras.get(v.camera))
        out.append({"label": f"camera {_label(result, v)}", "T": _flat(v.T_base_camera), "view": v.key, "rays": rays})
    for name, T in look.standing_cameras.items():
        still.setdefault(name, T)
    out += [
        {"label": name or "camera", "T": _flat(T), "view": None, "rays": _frustum(result.cameras.get(name))}
        for name, T in still.items()
    ]
    return out


def _boards_by_robot(drawn: Sequence[LoopView]) -> tuple[list[dict[str, Any]], dict[str, int]]:
    """The targets by the robot: one for each that stands still, one a pose for those carried; and which of them belongs
    to each view, by its key."""
    boards: list[dict[str, Any]] = []
    at: dict[tuple[object, ...], int] = {}
    of = {}
    for v in drawn:
        T = _flat(v.T_base_target_by_robot)
        place = tuple(T)
        if place not in at:
            at[place] = len(boards)
            boards.append(
                {"T": T, "view": v.key if v.target_carried else None, "label": v.id if v.target_carried else ""}
            )
        of[v.key] = at[place]
    return boards, of


def _camera_scene(result: CalibrationResult, poses: Mapping[tuple[str, str], Array]) -> dict[str, Any]:
    """Boards before the camera, or before each of several in the frame of the first one of their rig."""
    places = _rig(result)
    several = len(places) > 1
    names = [k for k in poses if k[0] in places][:: -(-len(poses) // _MOST_POSES)]
    boards = [
        {
            "T": _flat(places[k[0]] @ poses[k]),
            "view": f"{k[0]}/{k[1]}",
            "label": f"{k[0]}, {k[1]}" if several else k[1],
            "of": None,
        }
        for k in names
    ]
    cameras = [
        {
            "label": name if several else "camera",
            "T": _flat(T),
            "view": None,
            "rays": _frustum(result.cameras.get(name)),
        }
        for name, T in places.items()
    ]
    return {
        "up": [0, -1, 0],
        "frames": [],
        "cameras": cameras,
        "outline": _outline(result),
        "boards": {"seen": boards, "robot": []},
        "layers": {"camera": "Cameras" if several else "Camera", "seen": "Target, one outline a view"},
    }


def _rig(result: CalibrationResult) -> dict[str, Array]:
    """Where each camera stands to the first one that others are placed by; the first of those that nothing places."""
    places = {t.parent: np.eye(4) for t in result.transforms[:1] if t.parent in result.cameras}
    places = places or dict.fromkeys(list(result.cameras)[:1] or ["camera"], np.eye(4))
    root = next(iter(places))
    return places | {t.child: t.matrix for t in result.transforms if t.parent == root and t.child in result.cameras}


def _outline(result: CalibrationResult) -> list[list[float]]:
    corners = target_outline(result)
    if corners is None:
        # Target poses were given without points: a 100 mm square stands for the target.
        corners = 0.1 * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    return np.round(corners, _DECIMALS).tolist()


def _frustum(camera: Camera | None) -> list[list[float]]:
    """Directions (4, 3) with z = 1 through the image's corners; 4:3 and 53 degrees wide without a camera."""
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
