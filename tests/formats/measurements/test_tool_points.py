"""Three points a pose, as a tracker sees them, are poses of the tool: in columns and in rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibrant.calibrate.kinematics.identify import calibrate_kinematics
from calibrant.errors import InputError
from calibrant.formats.measurements.read import read_measurements
from calibrant.geometry import se3
from calibrant.robots.arms import arm

ROBOT = arm("ur5e")
BODY = np.array([[0.0, 0.0, 0.15], [0.08, 0.0, 0.13], [0.0, 0.07, 0.16]])
T_WORLD_BASE = se3.exp(np.array([0.1, 0.2, 0.3, 1.0, 2.0, 0.5]))
JOINTS = [f"q{k}" for k in range(1, 7)]


def seen(poses: int = 40, *, sigma: float = 0.0, body: np.ndarray = BODY) -> tuple[np.ndarray, np.ndarray]:
    """Joints (n, 6) and points (n, k, 3) in the tracker's frame."""
    rng = np.random.default_rng(5)
    q = rng.uniform(-1.5, 1.5, (poses, 6))
    T = T_WORLD_BASE @ ROBOT.forward(q)
    points = np.stack([se3.apply(T_i, body) for T_i in T])
    return q, points + sigma * rng.standard_normal(points.shape)


def in_columns(folder: Path, q: np.ndarray, points: np.ndarray, factor: float = 1e3) -> Path:
    header = ["name", *JOINTS, *(f"{axis}{k + 1}" for k in range(points.shape[1]) for axis in "xyz")]
    rows = [
        [f"p{i}", *map(repr, q[i].tolist()), *map(repr, (factor * points[i]).ravel().tolist())] for i in range(len(q))
    ]
    file = folder / "wide.csv"
    file.write_text("\n".join(",".join(row) for row in [header, *rows]))
    return file


def in_rows(folder: Path, q: np.ndarray, points: np.ndarray) -> Path:
    header = ["name", *JOINTS, "point", "x[mm]", "y[mm]", "z[mm]"]
    rows = [
        [f"p{i}", *map(repr, q[i].tolist()), f"SMR{k}", *map(repr, (1e3 * points[i, k]).tolist())]
        for i in range(len(q))
        for k in range(points.shape[1])
        if np.isfinite(points[i, k, 0])
    ]
    file = folder / "long.csv"
    file.write_text("\n".join(",".join(row) for row in [header, *rows]))
    return file


@pytest.mark.parametrize("write", [in_columns, in_rows])
def test_points_of_a_pose_are_its_pose_exactly(write, tmp_path: Path) -> None:
    q, points = seen()
    found = read_measurements(write(tmp_path, q, points), robot=ROBOT)
    assert found.rotations is not None
    assert len(found) == 40
    assert np.allclose(found.joints, q, atol=1e-12)
    assert np.allclose(found.positions, points.mean(axis=1), atol=1e-9)
    turns = (T_WORLD_BASE @ ROBOT.forward(q))[:, :3, :3].swapaxes(1, 2) @ found.rotations
    assert np.allclose(turns, turns[0], atol=1e-7)
    assert "3 points a pose" in found.source


def test_a_robot_is_identified_from_them(tmp_path: Path) -> None:
    q, points = seen(60, sigma=3e-5)
    calibration = calibrate_kinematics(read_measurements(in_columns(tmp_path, q, points), robot=ROBOT), ROBOT)
    assert calibration.held_out is not None
    assert np.sqrt(np.mean(calibration.held_out.mm**2)) < 0.1
    errors = [p.correction / p.sigma for p in calibration.fitted if p.parameter.group in ("offsets", "geometry")]
    assert 0.5 < np.mean(np.square(errors)) < 2.0


def test_a_pose_with_two_points_is_left_out(tmp_path: Path) -> None:
    q, points = seen(12)
    points[3, 1] = np.nan
    assert read_measurements(in_rows(tmp_path, q, points), robot=ROBOT).ids == tuple(
        f"p{i}" for i in range(12) if i != 3
    )


def test_points_that_are_no_body_are_refused(tmp_path: Path) -> None:
    q, points = seen(12)
    points[6:] = points[6:, ::-1]
    with pytest.raises(InputError, match="off one rigid body"):
        read_measurements(in_columns(tmp_path, q, points), robot=ROBOT)
    line = np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.2], [0.0, 0.0, 0.3]])
    with pytest.raises(InputError, match="stand in a line"):
        read_measurements(in_columns(tmp_path, *seen(12, body=line)), robot=ROBOT)
    with pytest.raises(InputError, match=r"2 point\(s\) a pose"):
        read_measurements(in_columns(tmp_path, *seen(12, body=BODY[:2])), robot=ROBOT)
