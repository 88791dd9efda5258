"""What the commands that a person waits for must not load: each of these takes a tenth of a second and more."""

from __future__ import annotations

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np

from calibrant.data.result_file import write_observations
from calibrant.geometry import so3
from calibrant.simulate.scenes import HandEyeScene, hand_eye_scene

HEAVY = ("cv2", "jinja2", "matplotlib", "mujoco", *(f"scipy.{m}" for m in ("optimize", "spatial", "special", "stats")))
"""scipy.linalg is not among them: Numba loads it where nothing is compiled yet."""


def loaded(arguments: list[str], folder: Path, unwanted: tuple[str, ...]) -> list[str]:
    """Which of the libraries a command has loaded when it is done. It must end well."""
    code = (
        "import sys; from calibrant.cli.application import run\n"
        f"status = run({arguments!r})\n"
        f"print(*[m for m in {unwanted!r} if m in sys.modules], file=sys.stderr)\n"
        "sys.exit(status)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=250)
    assert done.returncode == 0, done.stderr
    return done.stderr.split()


def poses_file(path: Path, T: np.ndarray) -> str:
    with open(path, "w", newline="", encoding="utf-8") as stream:
        out = csv.writer(stream)
        out.writerow(["x", "y", "z", "qx", "qy", "qz", "qw"])
        out.writerows(np.hstack([T[:, :3, 3], so3.quaternion_wxyz(T[:, :3, :3])[:, [1, 2, 3, 0]]]).tolist())
    return path.name


def scene() -> HandEyeScene:
    return hand_eye_scene("good", views=12, seed=3)


def test_hand_eye_from_pose_pairs_loads_nothing_for_photos(tmp_path: Path) -> None:
    data = scene()
    robot = poses_file(tmp_path / "robot.csv", data.robot_poses.T_base_gripper)
    target = poses_file(tmp_path / "target.csv", data.measured_T_camera_target)
    arguments = ["hand-eye", "--poses", robot, "--target-poses", target, "--out", "result.json", "--quiet"]
    loops = (
        "calibrant.calibrate.reprojection.kernels",
        "calibrant.calibrate.classical.planar_kernels",
        "calibrant.detection",
    )
    assert loaded(arguments, tmp_path, (*HEAVY, *loops)) == []


def test_hand_eye_from_points_loads_neither_opencv_nor_the_report(tmp_path: Path) -> None:
    data = scene()
    write_observations(data.observations, tmp_path / "observations.json")
    robot = poses_file(tmp_path / "robot.csv", data.robot_poses.T_base_gripper)
    arguments = ["hand-eye", "--poses", robot, "--observations", "observations.json", "--out", "result.json", "--quiet"]
    assert loaded(arguments, tmp_path, (*HEAVY, "calibrant.detection", "calibrant.reports.html")) == []


def test_one_command_loads_no_other(tmp_path: Path) -> None:
    others = ("calibrant.cli.study", "calibrant.cli.capture", "calibrant.cli.kinematics")
    assert loaded(["hand-eye", "--help"], tmp_path, (*HEAVY, "numpy", *others)) == []
