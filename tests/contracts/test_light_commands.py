"""What the commands that a person waits for must not load: each of these takes a tenth of a second and more."""

from __future__ import annotations

import csv
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calibrant.data.result_file import write_observations
from calibrant.geometry import so3
from calibrant.simulate.scenes import HandEyeScene, hand_eye_scene

BOARD = "chessboard:9x6:25mm"
HEAVY = (
    "cv2",
    "jinja2",
    "matplotlib",
    "mujoco",
    *(f"scipy.{m}" for m in ("optimize", "sparse", "spatial", "special", "stats")),
)
"""scipy.linalg is not among them: Numba loads it where nothing is compiled yet."""


def loaded(arguments: list[str], folder: Path, unwanted: tuple[str, ...], *, status: int = 0) -> list[str]:
    """Which of the libraries a command has loaded when it is done. It must end with the exit status."""
    code = (
        "import sys; from calibrant.cli.application import run\n"
        f"status = run({arguments!r})\n"
        f"print('LOADED', *[m for m in {unwanted!r} if m in sys.modules], file=sys.stderr)\n"
        "sys.exit(status)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=250)
    assert done.returncode == status, done.stderr
    return done.stderr.split("LOADED")[1].split()


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


def test_input_that_cannot_be_used_is_said_before_anything_is_loaded(tmp_path: Path) -> None:
    libraries = (*HEAVY, "numba", "scipy", "calibrant.detection.pipeline")
    assert loaded(["intrinsics", "nothing.jpg", "--target", BOARD], tmp_path, libraries, status=2) == []


def test_a_board_is_drawn_without_what_calibrates(tmp_path: Path) -> None:
    libraries = (*HEAVY, "numba", "scipy")
    assert loaded(["target", BOARD, "--out", "board.svg"], tmp_path, libraries) == ["cv2"]


@pytest.mark.long
def test_intrinsics_loads_the_detector_of_its_board_alone_and_none_for_photos_searched_before(
    tmp_path: Path, shared_data: Callable[[str], Path]
) -> None:
    """What is loaded is compiled on a first run."""
    photos = [str(p) for p in sorted(shared_data("opencv_stereo_9x6").glob("left*.jpg"))]
    arguments = ["intrinsics", *photos, "--target", BOARD, "--cache", "kept", "--quiet"]
    others = (
        *("calibrant.detection.subpixel.radon", "calibrant.detection.subpixel.foerstner"),
        *("calibrant.detection.tags.quads", "calibrant.detection.tags.codes", "calibrant.detection.circles.ellipse"),
        *("calibrant.calibrate.reprojection.local_kernels", "calibrant.cameras.kernels.brown_rays"),
    )
    own = ("calibrant.detection.chessboard.detector", "calibrant.detection.subpixel.saddle")
    libraries = tuple(m for m in HEAVY if m != "cv2")
    assert loaded(arguments, tmp_path, (*libraries, *others, *own)) == [*own]
    assert loaded(arguments, tmp_path, (*libraries, *others, *own)) == []
