"""Data made by hand that do not fit together are refused where they are made, with what was expected."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.data import Observations, RobotPoses, View
from calibrant.data.joint_measurements import JointMeasurements
from calibrant.errors import InputError

JOINTS, POSITIONS = np.zeros((2, 6)), np.zeros((2, 3))
NAN = np.array([[0.0, 0, 0], [0, np.nan, 0]])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"joints": np.zeros((3, 6))}, r"2 measurements with joints of shape \(3, 6\).*expected \(n, joints\)"),
        ({"positions": np.zeros((2, 2))}, r"positions of shape \(2, 2\); expected \(n, joints\) and \(n, 3\)"),
        ({"rotations": np.eye(3)}, r"rotations of shape \(3, 3\); expected \(n, 3, 3\)"),
        ({"positions": NAN}, "measurement b: NaN or infinity; leave it out"),
    ],
)
def test_joint_measurements(given: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(InputError, match=message):
        JointMeasurements(("a", "b"), **{"joints": JOINTS, "positions": POSITIONS, **given})


def test_robot_poses() -> None:
    with pytest.raises(InputError, match=r"3 pose names but poses of shape \(2, 4, 4\); expected \(n, 4, 4\)"):
        RobotPoses(("a", "b", "c"), np.stack([np.eye(4)] * 2))
    with pytest.raises(InputError, match="pose names occur twice: a; every pose needs its own name"):
        RobotPoses(("a", "a"), np.stack([np.eye(4)] * 2))


def test_covariances_of_points() -> None:
    points, uv, ids = np.zeros((2, 3)), np.ones((2, 2)), np.arange(2)
    C = np.tile([[0.04, 0.01], [0.01, 0.02]], (2, 1, 1))
    view = View("a", points, uv, ids, covariance_px=C)
    np.testing.assert_allclose(view.sigma_px, np.sqrt(0.03))
    part = view.subset(np.array([True, False]))
    np.testing.assert_array_equal(part.covariance_px, C[:1])
    with pytest.raises(InputError, match="view 'a': sigma_px must be the root of half of covariance_px's trace"):
        View("a", points, uv, ids, sigma_px=np.full(2, 0.1), covariance_px=C)
    for wrong in ([[1.0, 1.0], [1.0, 1.0]], [[1.0, 0.5], [0.0, 1.0]], [[-1.0, 0.0], [0.0, -1.0]]):
        with pytest.raises(InputError, match="covariance_px must be symmetric and positive definite"):
            View("a", points, uv, ids, covariance_px=np.tile(wrong, (2, 1, 1)))
    with pytest.raises(InputError, match=r"covariance_px: expected shape \(2, 2, 2\), got \(2, 2\)"):
        View("a", points, uv, ids, covariance_px=np.eye(2))


def test_observations() -> None:
    points, uv = [np.zeros((4, 3))] * 2, [np.ones((4, 2))] * 2
    with pytest.raises(InputError, match="points has 2 views and uv has 1; give one of each a view"):
        Observations.from_points(points, uv[:1], image_size=(640, 480))
    with pytest.raises(InputError, match="ids has 1 names for 2 views"):
        Observations.from_points(points, uv, image_size=(640, 480), ids=["a"])
    with pytest.raises(InputError, match=r"expected shape \(4, 2\), got \(4, 3\)"):
        View("a", np.zeros((4, 3)), np.zeros((4, 3)), np.arange(4))
