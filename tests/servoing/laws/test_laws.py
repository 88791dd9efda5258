"""The control laws: Jacobians against differences, and all pull the camera to where it was taught."""

from __future__ import annotations

import numpy as np
import pytest
from tests.servoing.cells import BOARD, CAMERA

from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.servoing.laws.law import Law
from calibrant.servoing.laws.registry import LAWS, law_of
from calibrant.servoing.sight.features import Features, features_of

WANTED = se3.make(so3.exp([0.1, -0.2, 0.05]), [-0.08, -0.06, 0.4])


def features(T_wanted_camera) -> Features:
    T = se3.inverse(T_wanted_camera) @ WANTED
    p = se3.apply(T, BOARD)
    ids = np.arange(len(p))
    return features_of(CAMERA, ids, CAMERA.project(p), np.full(len(p), 0.1), p[:, 2], points=BOARD, T_camera_target=T)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_the_error_changes_with_the_camera_as_its_jacobian_says(law: Law) -> None:
    start = se3.make(so3.exp([0.05, 0.1, -0.2]), [0.02, -0.03, 0.05])
    wanted, step = features(np.eye(4)), 1e-6
    here = law.pull(features(start), wanted, np.eye(3))
    for k in range(6):
        xi = np.zeros(6)
        xi[k] = step
        ahead, behind = (law.pull(features(start @ se3.exp(s * xi)), wanted, np.eye(3)) for s in (1, -1))
        numeric = (ahead.error - behind.error) / (2 * step)
        if law.name in ("position", "hybrid"):
            np.testing.assert_allclose(here.jacobian[:, k], numeric, atol=1e-5)
            continue
        # Of points in the picture the mean of the matrices here and at the goal is used: exact at the goal only.
        goal = law.pull(features(se3.exp(1e-3 * xi / step)), wanted, np.eye(3))
        np.testing.assert_allclose(goal.error, 1e-3 * goal.jacobian[:, k], atol=2e-3 * np.abs(goal.error).max())


@pytest.mark.parametrize("law", [LAWS[n] for n in ("image", "position", "hybrid")], ids=["image", "position", "hybrid"])
@pytest.mark.parametrize("turn", [(0.3, -0.3, 0.2), (0, 0, 2.5), (0.2, 0.4, -1.2)])
def test_following_the_pull_ends_at_the_goal(law: Law, turn: tuple[float, float, float]) -> None:
    T = se3.make(so3.exp(turn), [0.05, -0.1, -0.1])
    for _ in range(150):
        T = T @ se3.exp(0.1 * law.pull(features(T), features(np.eye(4)), np.eye(3)).twist)
    mm, deg = se3.deviation(np.eye(4), T)
    assert mm < 1e-3
    assert deg < 1e-3


def test_the_planar_law_moves_in_its_plane_alone() -> None:
    R_camera_gripper = so3.exp([0.3, -0.2, 0.4])  # the camera does not look along the approach axis
    law, R = LAWS["planar"], R_camera_gripper
    in_plane = se3.make(R @ so3.exp([0, 0, 0.4]) @ R.T, R @ np.array([0.05, -0.03, 0.0]))
    T = in_plane
    for _ in range(200):
        turned = T[:3, :3].T @ R
        twist = law.pull(features(T), features(np.eye(4)), turned).twist
        assert abs(turned[:, 2] @ twist[3:]) < 1e-12
        np.testing.assert_allclose(np.cross(turned[:, 2], twist[:3]), 0, atol=1e-12)
        T = T @ se3.exp(0.1 * twist)
    mm, deg = se3.deviation(np.eye(4), T)
    assert mm < 1e-3
    assert deg < 1e-3


def test_a_law_that_needs_a_pose_says_so() -> None:
    flat = features_of(
        CAMERA, np.arange(4), np.array([[10.0, 10], [90, 10], [90, 90], [10, 90]]), np.ones(4), np.ones(4)
    )
    for name in ("position", "hybrid"):
        with pytest.raises(InputError, match="pose"):
            LAWS[name].pull(flat, flat, np.eye(3))
    with pytest.raises(InputError, match="choose image"):
        law_of("fuzzy")
