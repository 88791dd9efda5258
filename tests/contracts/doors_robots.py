"""Files and options of the commands about robots, for the contract over every command's doors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from tests.contracts.doors import TARGET, Files, Options

import calibrant as cb
from calibrant.data import CalibrationResult, RobotPoses, as_transform
from calibrant.formats.robots.urdf import new_urdf
from calibrant.geometry import rotations, se3, so3
from calibrant.robots.arms import arm
from calibrant.simulate.cell import poses_csv
from calibrant.simulate.render import render
from calibrant.simulate.robot_errors import measure, simulate_arm
from calibrant.simulate.scenes import standard_camera
from calibrant.targets.registry import parse_target

Array = NDArray[np.float64]

TIP = np.array([0.012, -0.034, 0.151])
DOWN = so3.exp([np.pi, 0, 0])


def _kinematics(files: Files) -> Options:
    """A worn arm, its tool measured by a tracker, positions in mm."""
    robot, measured = files.folder / "arm.urdf", files.folder / "tracker.csv"
    robot.write_text(new_urdf(arm("ur5e")))
    rng = np.random.default_rng(11)
    worn = simulate_arm(arm("ur5e"), rng, sigma_mm=0.5, sigma_deg=0.1)
    data = measure(worn, worn.draw_joints(rng, 40), rng, sigma_mm=0.05, sigma_deg=None)
    lines = ["name,q1,q2,q3,q4,q5,q6,x[mm],y[mm],z[mm]"]
    for name, q, p in zip(data.ids, data.joints, data.positions):
        lines.append(",".join([name, *(f"{v:.9f}" for v in (*q, *(1e3 * p)))]))
    measured.write_text("\n".join(lines) + "\n")
    return {"robot": str(robot), "measurements": [measured], "identify": ["offsets"]}


def _next_pose(files: Files) -> Options:
    return {
        "robot": "ur5e",
        "camera": files.camera,
        "target": TARGET,
        "camera_at": "21mm,-64mm,47mm,0deg,0deg,23deg",
        "target_at": "620mm,110mm,20mm,180deg,0deg,17deg",
        "distance": "350mm:600mm",
        "count": 3,
    }


def _time_offset(files: Files) -> Options:
    """A sweep of 6 s; the camera's clock 80 ms behind."""
    rng = np.random.default_rng(0)

    def gripper(t: Array) -> Array:
        w = np.stack([0.5 * np.sin(1.3 * t), 0.4 * np.sin(0.9 * t + 1), 0.5 * np.cos(1.7 * t)], axis=-1)
        p = np.stack([0.5 + 0.15 * np.sin(1.1 * t), 0.2 * np.cos(0.8 * t), 0.4 + 0.1 * np.sin(1.9 * t)], axis=-1)
        return se3.make(so3.exp(w), p)

    X, Z = se3.exp([0.3, -0.2, 0.5, 0.03, -0.05, 0.1]), se3.exp([2.9, 0.1, 0.2, 0.6, 0.1, 0.0])
    robot, camera = np.arange(0, 8, 0.01), np.arange(1, 7, 0.033)
    seen = se3.retract(se3.inverse(gripper(camera) @ X) @ Z, rng.normal(scale=2e-4, size=(len(camera), 6)))
    return {
        "poses": _timed(files.folder / "robot.csv", robot, gripper(robot)),
        "target_poses": _timed(files.folder / "seen.csv", camera - 0.08, seen),
        "largest": "500ms",
    }


def _timed(path: Path, times: Array, T: Array) -> Path:
    rows = np.column_stack([T[:, :3, 3], rotations.quaternion_xyzw_from_matrix(T[:, :3, :3])])
    lines = ["timestamp,x,y,z,qx,qy,qz,qw"]
    lines += [",".join([f"{t:.6f}", *(f"{v:.9f}" for v in row)]) for t, row in zip(times, rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


def _dynamic(files: Files) -> Options:
    """The wrist camera's photos, and one more that stands for a camera beside the robot."""
    wrist = files.folder / "hand-eye.json"
    cb.hand_eye(images=files.images, poses=files.poses, target=TARGET, camera=files.camera).write(wrist)
    return {
        "wrist": wrist,
        "camera": files.camera,
        "wrist_images": [files.images / f"{i:02d}.png" for i in range(3)],
        "external_images": [files.images / "05.png"],
        "poses": [files.poses],
        "target": TARGET,
    }


def _servo_teach(files: Files) -> Options:
    """One photo of the calibration stands for the wanted place."""
    hand = files.folder / "hand.json"
    cb.hand_eye(images=files.images, poses=files.poses, target=TARGET, camera=files.camera).write(hand)
    return {"result": hand, "images": [files.images / "02.png"], "target": TARGET}


def _tool_touch(files: Files) -> Options:
    rng = np.random.default_rng(0)
    R = DOWN @ so3.exp(0.5 * rng.uniform(-1, 1, (6, 3)))
    T = se3.make(R, np.array([0.5, 0.1, 0.05]) - R @ TIP)
    T[:, :3, 3] += 1e-4 * rng.standard_normal((6, 3))
    return {"poses": [_poses(T, files.folder / "touches.csv")], "pose_rotation": "quat-xyzw"}


def _tool_seen(files: Files) -> Options:
    rng, camera = np.random.default_rng(2), standard_camera()
    X = se3.make(DOWN, [0.5, 0.0, 1.0])
    R = DOWN @ so3.exp(0.7 * rng.uniform(-1, 1, (5, 3)))
    T = se3.make(R, rng.uniform((0.35, -0.15, 0.25), (0.65, 0.15, 0.45), (5, 3)))
    uv = camera.project(se3.apply(se3.inverse(X) @ T, TIP)) + 0.1 * rng.standard_normal((5, 2))
    standing = (as_transform("base", "camera", X, 1e-8 * np.eye(6)),)
    known = CalibrationResult("hand-eye", "ok", cameras={"camera": camera}, transforms=standing)
    pixels = files.folder / "tip.csv"
    pixels.write_text("image,u,v\n" + "\n".join(f"{i}.png,{u:.4f},{v:.4f}" for i, (u, v) in enumerate(uv)))
    return {
        "poses": [_poses(T, files.folder / "sights.csv")],
        "pixels": pixels,
        "result": known.write(files.folder / "standing.json"),
    }


def _tool_self_visibility(files: Files) -> Options:
    camera, board = standard_camera(), parse_target("chessboard:9x6:12mm")
    T = se3.make(so3.exp([0.4, -0.1, 0.1]), [-0.05, -0.03, 0.25])
    T_target_gripper = se3.make(so3.exp([0, 0, 0.6]), [0.05, 0.09, 0.0])
    features = np.array([[0.02, 0.0, -0.003], [-0.02, 0.001, -0.003]])
    uv = camera.project(se3.apply(T @ T_target_gripper, features))
    image, table = files.folder / "gripper.png", files.folder / "features.csv"
    cv2.imwrite(str(image), render(board.artwork(), camera, T, rng=np.random.default_rng(0)))
    lines = [f"{u:.3f},{v:.3f},{x},{y},{z}" for (u, v), (x, y, z) in zip(uv, 1e3 * features)]
    table.write_text("u,v,x_mm,y_mm,z_mm\n" + "\n".join(lines))
    known = CalibrationResult("intrinsics", "ok", cameras={"camera": camera})
    return {
        "image": image,
        "features": table,
        "camera": known.write(files.folder / "hand-camera.json"),
        "target": "chessboard:9x6:12mm",
        "sigma_px": "0.3px",
    }


def _poses(T: Array, path: Path) -> Path:
    path.write_text(poses_csv(RobotPoses.from_matrices(T, ids=[f"{i}.png" for i in range(len(T))])))
    return path


ROBOT_CASES: Mapping[str, Callable[[Files], Mapping[str, Any]]] = {
    "kinematics": _kinematics,
    "next-pose": _next_pose,
    "time-offset": _time_offset,
    "dynamic": _dynamic,
    "servo teach": _servo_teach,
    "tool touch": _tool_touch,
    "tool seen": _tool_seen,
    "tool self-visibility": _tool_self_visibility,
}
