"""What other libraries answer silently with numbers: each row is refused by name, or named and undone."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant import calibrate_hand_eye
from calibrant.cli.application import run
from calibrant.diagnose.doctor.diagnosis import diagnose_poses
from calibrant.diagnose.doctor.repair import calibrate_repaired
from calibrant.formats.poses.raw import RawPoses
from calibrant.formats.poses.read import notations
from calibrant.geometry import rotations
from calibrant.simulate.scenes import hand_eye_scene
from calibrant.simulate.truth import normalised

Array = NDArray[np.float64]
HEADER = ("x", "y", "z", "qx", "qy", "qz", "qw")


def written(path: Path, T: Array) -> str:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(HEADER)
        writer.writerows(np.column_stack([T[:, :3, 3], rotations.quaternion_xyzw_from_matrix(T[:, :3, :3])]).tolist())
    return str(path)


@pytest.mark.parametrize(
    ("scene", "status", "words"),
    [
        ("parallel-axes", 1, "parallel-axes: all rotations turn about one axis"),
        ("pure-translation", 1, "pure-translation: the poses do not rotate beyond the noise"),
        ("shifted-pairs", 1, "poses-shifted: the poses stand one row too early"),
        ("two-poses", 1, "2 distinct poses; hand-eye calibration needs at least 3"),
        ("inverted-poses", 0, "pose-direction"),
        ("one-flip", 0, "board-flipped"),
    ],
)
def test_every_row_is_named_on_the_command_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], scene: str, status: int, words: str
) -> None:
    data = hand_eye_scene(scene, views=12)
    poses = written(tmp_path / "poses.csv", data.robot_poses.T_base_gripper)
    target = written(tmp_path / "target.csv", data.measured_T_camera_target)
    arguments = ["hand-eye", "--poses", poses, "--target-poses", target, "--setup", "eye-in-hand", "--json"]
    assert run(arguments) == status
    out, err = capfd.readouterr()
    assert words in (err if status else out)


def test_a_method_by_position_is_refused_and_not_ignored() -> None:
    scene = hand_eye_scene("good", views=6)
    with pytest.raises(TypeError, match="positional argument"):
        calibrate_hand_eye(scene.robot_poses, scene.measured_T_camera_target, "park")  # type: ignore[misc]


@pytest.mark.statistics
def test_one_flip_in_fifteen_views_is_undone_to_within_the_stated_sigma() -> None:
    errors = []
    for seed in range(12):
        scene = hand_eye_scene("one-flip", views=15, seed=seed)
        T = scene.robot_poses.T_base_gripper
        raw = RawPoses(T[:, :3, 3], T[:, :3, :3], None, tuple(str(i) for i in range(15)))
        found = diagnose_poses(notations(raw), scene.measured_T_camera_target, setup="eye-in-hand")
        assert [f.name for f in found.findings if f.status != "ok"] == ["board-flipped"]
        repaired = calibrate_repaired(found).transforms[0]
        assert repaired.covariance is not None
        errors.append(normalised(repaired, scene.X) / 6)
    # Normalised errors average 1; the mean of 12 scatters by sqrt(2 / 72) = 0.17.
    assert np.mean(errors) < 1.6
