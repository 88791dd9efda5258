"""Synthetic results: a Brown camera, a board seen from many sides, a robot that carries one of them; seeded noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.data import (
    CalibrationResult,
    Check,
    HeldOut,
    Measured,
    MethodResult,
    Missed,
    Observations,
    RobotPoses,
    SigmaRobot,
    View,
    ViewResult,
    as_transform,
)
from calibrant.geometry import se3, so3

IMAGE_SIZE = (1280, 1024)
SIGMA_PX = 0.1
TRUE = {"fx": 905.2, "fy": 904.1, "cx": 641.7, "cy": 509.3, "k1": -0.21, "k2": 0.08, "p1": 4e-4, "p2": -7e-4, "k3": 0.0}
SIGMA = {
    "fx": 0.26,
    "fy": 0.25,
    "cx": 0.31,
    "cy": 0.28,
    "k1": 4.2e-4,
    "k2": 9e-4,
    "p1": 3.1e-5,
    "p2": 3.3e-5,
    "k3": 0.0,
}


def camera() -> Camera:
    covariance = np.diag([SIGMA[name] ** 2 for name in TRUE])
    return Camera.create("brown", TRUE, image_size=IMAGE_SIZE, covariance=covariance)


def board_points() -> np.ndarray:
    x, y = np.meshgrid(np.arange(9) * 0.03, np.arange(6) * 0.03)
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=-1)


def poses_that_see(count: int, rng: np.random.Generator) -> np.ndarray:
    """T_camera_target (count, 4, 4) of boards wholly inside the image, tilted up to about 35 degrees."""
    cam, points, found = camera(), board_points(), []
    while len(found) < count:
        z = rng.uniform(0.35, 0.8)
        t = np.array([rng.uniform(-0.5, 0.5) * z, rng.uniform(-0.4, 0.4) * z, z])
        R = so3.exp(rng.normal(scale=[0.35, 0.35, 0.5]))
        T = se3.make(R, t - R @ points.mean(axis=0))
        uv = cam.project(se3.apply(T, points))
        if np.all(np.isfinite(uv)) and np.all(uv > 5) and np.all(uv < np.array(IMAGE_SIZE) - 6):
            found.append(T)
    return np.stack(found)


def observed(T_camera_target: np.ndarray, rng: np.random.Generator, *, sigma_px: float = SIGMA_PX) -> Observations:
    points, cam = board_points(), camera()
    views = []
    for i, T in enumerate(T_camera_target):
        uv = cam.project(se3.apply(T, points)) + rng.normal(scale=sigma_px, size=(len(points), 2))
        views.append(View(f"{i}.png", points, uv, np.arange(len(points))))
    return Observations(
        tuple(views), {"camera": IMAGE_SIZE}, "chessboard:9x6:30mm", (Missed("99.png", "no board found"),)
    )


def view_results(observations: Observations, T_camera_target: np.ndarray) -> tuple[ViewResult, ...]:
    rows = []
    for view, T in zip(observations.views, T_camera_target, strict=True):
        r = camera().project(se3.apply(T, view.points)) - view.uv
        rms = float(np.sqrt(np.mean(np.sum(r * r, axis=-1))))
        rows.append(ViewResult(view.id, True, len(view), rms, T_camera_target=T, camera="camera"))
    return tuple(rows)


def make_intrinsics(count: int = 13) -> CalibrationResult:
    rng = np.random.default_rng(7)
    T = poses_that_see(count, rng)
    observations = observed(T, rng)
    views = list(view_results(observations, T))
    views[3] = replace(views[3], used=False, reason="RMS 1.9 px, 9 times the others: the board moved")
    views[5] = replace(views[5], points_left_out=2, reason="2 points lie more than 4σ off")
    return CalibrationResult(
        "intrinsics",
        "warn",
        checks=(
            Check(
                "corner-coverage", "warn", "no points in the lower left corner: take a view with the board there", 0.6
            ),
            Check("tilt-range", "ok", "the board was tilted by 3 to 41 degrees", 41.0),
        ),
        cameras={"camera": camera()},
        rms_px=0.1412,
        sigma_px=0.1003,
        views=tuple(views),
        options={"model": "brown", "fix": ["k3"]},
        inputs=({"file": "images/0.png", "sha256": "ab" * 32},),
        observations=observations,
        created="2024-05-01T12:00:00Z",
        version="0.1.0",
    )


def make_hand_eye(setup: str = "eye-to-hand", count: int = 12) -> CalibrationResult:
    rng = np.random.default_rng(11)
    B = poses_that_see(count, rng)
    if setup == "eye-to-hand":
        X = se3.make(so3.exp([2.4, 0.2, -0.1]), [0.66, -0.25, 0.83])
        Z = se3.make(so3.exp([0.1, -0.3, 1.0]), [0.02, -0.05, 0.11])
        T_base_gripper = X @ B @ se3.inverse(Z)
        names = (("base", "camera"), ("gripper", "target"))
    else:
        X = se3.make(so3.exp([0.05, -0.1, 1.5]), [0.03, -0.07, 0.06])
        Z = se3.make(so3.exp([3.0, 0.1, 0.0]), [0.6, 0.1, 0.02])
        T_base_gripper = Z @ se3.inverse(B) @ se3.inverse(X)
        names = (("base", "target"), ("gripper", "camera"))[::-1]
    noise = np.concatenate(
        [rng.normal(scale=np.deg2rad(0.02), size=(count, 3)), rng.normal(scale=1e-4, size=(count, 3))], 1
    )
    T_base_gripper = se3.retract(T_base_gripper, noise)
    covariance = np.diag(
        np.concatenate([np.deg2rad([0.012, 0.011, 0.02]) ** 2, np.array([1.1e-4, 2.3e-4, 0.9e-4]) ** 2])
    )
    observations = observed(B, rng)
    views = list(view_results(observations, B))
    views[2] = replace(views[2], used=False, reason="the robot pose disagrees with the image by 41 mm")
    off = se3.retract(X, [0.001, 0, 0, 0.0005, 0, 0.0003])
    return CalibrationResult(
        "hand-eye",
        "ok",
        checks=(Check("rotation-diversity", "ok", "the gripper turned about axes 80 degrees apart", 80.0),),
        cameras={"camera": camera()},
        transforms=(as_transform(*names[0], X, covariance), as_transform(*names[1], Z, covariance)),
        rms_px=0.1501,
        sigma_px=0.0998,
        sigma_robot=SigmaRobot(0.1043, 0.0211, 0.012, 0.0021),
        views=tuple(views),
        methods={
            "park": MethodResult(off, 0.61, 0.052),
            "tsai": MethodResult(None, None, None, "no answer: the rotation axes are parallel"),
            "joint": MethodResult(X, 0.31, 0.031),
        },
        target_scale=Measured(1.0012, 0.0031),
        held_out=HeldOut(0.42, 0.041, 0.63),
        options={"setup": setup},
        observations=observations,
        robot_poses=RobotPoses(
            tuple(v.id for v in observations.views), T_base_gripper, "poses.csv, mm, quaternion xyzw"
        ),
        created="2024-05-01T12:00:00Z",
        version="0.1.0",
    )


@pytest.fixture(scope="session")
def intrinsics_result() -> CalibrationResult:
    return make_intrinsics()


@pytest.fixture(scope="session")
def hand_eye_result() -> Callable[[str], CalibrationResult]:
    """Hand-eye results by setup."""
    made = {setup: make_hand_eye(setup) for setup in ("eye-to-hand", "eye-in-hand")}
    return made.__getitem__
