"""`calibrant hand-eye-point`: poses and points of one file each, the camera's place with sigma, bad input named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.data import RobotPoses
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.simulate.cell import poses_csv

X = se3.make(so3.exp([0.0, np.deg2rad(115), 0.0]) @ so3.exp([0, 0, 1.5]), [-0.6, 0.0, 0.7])
B = np.array([0.01, 0.02, 0.11])


def _files(folder: Path, *, turn: float = 0.6, noise: float = 3e-4) -> tuple[Path, Path]:
    rng = np.random.default_rng(5)
    A = se3.make(
        so3.exp(rng.uniform(-turn, turn, (15, 3))), np.array([0.5, 0.0, 0.4]) + rng.uniform(-0.2, 0.2, (15, 3))
    )
    p = se3.apply(se3.inverse(X), se3.apply(A, B))
    assert p[:, 2].min() > 0.2
    p = p + rng.normal(0, noise, p.shape)
    names = [f"{i:02d}" for i in range(15)]
    poses, points = folder / "poses.csv", folder / "points.csv"
    poses.write_text(poses_csv(RobotPoses.from_matrices(A, ids=names)))
    rows = [f"{n},{x:.7f},{y:.7f},{z:.7f}" for n, (x, y, z) in zip(names, p)]
    points.write_text("\n".join(["image,x,y,z", *reversed(rows)]) + "\n")
    return poses, points


def test_the_camera_is_where_it_is_whatever_the_order_of_rows(tmp_path: Path) -> None:
    poses, points = _files(tmp_path)
    result = cb.hand_eye_point(poses=[poses], points=points)
    found = result.transform("base", "camera")
    delta = se3.local(X, found.matrix)
    assert delta @ np.linalg.solve(found.covariance, delta) < 22.5  # chi-square of 6, once in a thousand
    assert result.figures["point_x_in_gripper"].value == pytest.approx(10.0, abs=3.0)
    assert "Hand-eye from one point" in result.summary()


def test_points_of_a_camera_on_the_gripper_are_not_those_of_one_beside_it(tmp_path: Path) -> None:
    poses, points = _files(tmp_path)
    with pytest.raises(RefusedError, match=r"no reading|belong together|agree on one point"):
        cb.hand_eye_point(poses=[poses], points=points, setup="eye-in-hand")
    with pytest.raises(InputError, match="eye-to-hand or eye-in-hand"):
        cb.hand_eye_point(poses=[poses], points=points, setup="front")


def test_an_arm_that_never_turned_is_refused(tmp_path: Path) -> None:
    poses, points = _files(tmp_path, turn=0.0)
    with pytest.raises(RefusedError, match="same orientation"):
        cb.hand_eye_point(poses=[poses], points=points)


def test_millimetres_and_points_behind_the_camera_are_named(tmp_path: Path) -> None:
    poses, points = _files(tmp_path)
    table = np.loadtxt(points, delimiter=",", skiprows=1)
    for factor, says in ((1e3, "millimetres"), (-1.0, "z > 0")):
        rows = [f"{int(n):02d},{x},{y},{z}" for n, x, y, z in table * [1, factor, factor, factor]]
        points.write_text("\n".join(["image,x,y,z", *rows]) + "\n")
        with pytest.raises(InputError, match=says):
            cb.hand_eye_point(poses=[poses], points=points)


def test_a_slipped_point_is_set_aside_and_the_scale_found(tmp_path: Path) -> None:
    poses, points = _files(tmp_path)
    table = np.loadtxt(points, delimiter=",", skiprows=1)
    table[:, 1:] *= 1.03
    table[4, 1:] += [0.05, 0.0, -0.1]
    rows = [f"{int(n):02d},{x},{y},{z}" for n, x, y, z in table]
    points.write_text("\n".join(["image,x,y,z", *rows]) + "\n")
    result = cb.hand_eye_point(poses=[poses], points=points)
    lost = [v.id for v in result.views if not v.used]
    # A good pose may go with it: it does once in some twenty-five calibrations.
    assert f"{int(table[4, 0]):02d}" in lost
    assert len(lost) <= 2
    assert result.check("outliers").status == "warn"
    scale = result.figures["depth_scale"]
    assert scale.value == pytest.approx(3.0, abs=4 * scale.sigma)
    assert result.check("scale").status == "warn"
