"""Poses of the target in every notation people write, read without a word on what they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calibrant.diagnose.conventions.decide import Setup, robot_side
from calibrant.diagnose.doctor.target_notation import decide_target_notation
from calibrant.errors import RefusedError
from calibrant.formats.poses.read import PoseNotation, notations, read_poses
from calibrant.geometry import se3, so3

Array = NDArray[np.float64]
CAMERA = se3.make(so3.exp([0.3, -1.2, 0.5]), [0.06, -0.03, 0.09])
TARGET = se3.make(so3.exp([2.9, 0.4, -0.2]), [0.5, 0.2, 0.1])


def cell(n: int, setup: Setup) -> tuple[Array, Array]:
    """Poses that turn by some 30 degrees, and target poses with 0.5 mm and 0.1 degrees of noise."""
    rng = np.random.default_rng(11)
    X, Z = (CAMERA, TARGET) if setup == "eye-in-hand" else (se3.inverse(TARGET), se3.inverse(CAMERA))
    middle = np.broadcast_to(se3.make(so3.exp([3.0, 0.3, 0.2]), [0.5, 0.1, 0.6]), (n, 4, 4))
    robot = se3.retract(middle, rng.normal(size=(n, 6)) * [0.5, 0.5, 0.5, 0.12, 0.12, 0.12])
    target = se3.inverse(X) @ se3.inverse(robot_side(robot, setup)) @ Z
    return robot, se3.retract(target, rng.normal(size=(n, 6)) * [*[np.deg2rad(0.1)] * 3, *[5e-4] * 3])


def numbers(T: Array, notation: str, angle: str) -> Array:
    turn = Rotation.from_matrix(T[:, :3, :3])
    degrees = angle == "deg"
    if notation == "rotvec":
        return np.asarray(turn.as_rotvec(degrees=degrees))
    return np.asarray(turn.as_euler(notation.removeprefix("euler:"), degrees=degrees))


def written(path: Path, T: Array, notation: str, angle: str, per_metre: float, header: str) -> tuple[PoseNotation, ...]:
    table = np.column_stack([T[:, :3, 3] * per_metre, numbers(T, notation, angle)])
    path.write_text("\n".join([header, *(",".join(f"{v:.9f}" for v in row) for row in table)]) + "\n")
    direction = "base-gripper" if path.stem == "target" else "auto"
    return notations(read_poses(path), direction=direction)


@pytest.mark.long
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize(
    ("robot_is", "target_is", "angle", "per_metre"),
    [
        ("euler:xyz", "euler:xyz", "deg", 1.0),
        ("euler:ZYX", "rotvec", "rad", 1.0),
        ("rotvec", "euler:ZYX", "deg", 1000.0),
        ("euler:xyz", "euler:XYZ", "rad", 1000.0),
    ],
)
def test_both_notations_are_found_together(
    tmp_path: Path, setup: Setup, robot_is: str, target_is: str, angle: str, per_metre: float
) -> None:
    header = "x,y,z,a,b,c" if setup == "eye-in-hand" else "x,y,z,rx,ry,rz"
    robot, target = cell(14, setup)
    complete = written(tmp_path / "robot.csv", robot, robot_is, angle, 1000.0, header)
    of_target = written(tmp_path / "target.csv", target, target_is, angle, per_metre, header)
    found = decide_target_notation(complete, of_target)
    np.testing.assert_allclose(found.notation.T_base_gripper, target, atol=1e-6)
    if found.notation is not of_target[0]:
        assert found.finding is not None
        assert "instead of" in found.finding.message


@pytest.mark.long
def test_poses_that_fit_nothing_are_read_as_they_are_usually_meant(tmp_path: Path) -> None:
    robot, target = cell(14, "eye-in-hand")
    complete = written(tmp_path / "robot.csv", robot, "euler:xyz", "deg", 1000.0, "x,y,z,a,b,c")
    mixed = target[np.random.default_rng(3).permutation(14)]
    of_target = written(tmp_path / "target.csv", mixed, "rotvec", "rad", 1.0, "x,y,z,a,b,c")
    found = decide_target_notation(complete, of_target)
    assert found.notation is of_target[0]
    assert found.finding is None


def test_notations_that_nothing_tells_apart_are_refused_with_the_option_that_settles_it(tmp_path: Path) -> None:
    # Four poses that turn by some degrees, and errors as large: most notations close the loop as badly.
    rng = np.random.default_rng(2)
    robot, target = cell(4, "eye-in-hand")
    robot = se3.retract(np.broadcast_to(robot[0], (4, 4, 4)), 0.2 * rng.normal(size=(4, 6)))
    target = se3.inverse(CAMERA) @ se3.inverse(robot) @ TARGET
    target = se3.retract(target, 0.02 * rng.normal(size=(4, 6)))
    complete = written(tmp_path / "robot.csv", robot, "euler:xyz", "deg", 1000.0, "x,y,z,a,b,c")
    of_target = written(tmp_path / "target.csv", target, "euler:xyz", "deg", 1.0, "x,y,z,a,b,c")
    with pytest.raises(RefusedError, match="--target-pose-rotation"):
        decide_target_notation(complete, of_target)
