"""Views that the simulated arm takes: reachable, in view, and enough to calibrate with."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.robots.arms import arm
from calibrant.simulate.arm import choose_views
from calibrant.simulate.scenes import Setup, grid, standard_camera, standard_mounting, target_poses


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_views_are_reached_and_seen(setup: Setup) -> None:
    chain, camera, points = arm("ur5e"), standard_camera(), grid(9, 7, 0.03)
    X, Z = standard_mounting(setup)
    rng = np.random.default_rng(0)
    views = choose_views(chain, camera, points, 12, setup=setup, X=X, Z=Z, rng=rng)
    assert np.all(chain.within_limits(views.q))
    assert np.abs(chain.forward(views.q) - views.T_base_gripper).max() < 1e-8  # the tolerance of the inverse
    assert np.abs(target_poses(setup, X, Z, views.T_base_gripper) - views.T_camera_target).max() < 1e-12
    uv = camera.project(se3.apply(views.T_camera_target[:, None], points))
    assert np.all((uv > 0) & (uv < np.array(camera.image_size) - 1))
    turns = so3.log(views.T_base_gripper[1:, :3, :3] @ views.T_base_gripper[0, :3, :3].T)
    assert np.linalg.svd(turns, compute_uv=False)[2] > 0.3  # rotations about every axis


def test_a_board_out_of_reach_is_said() -> None:
    X, Z = standard_mounting("eye-in-hand")
    far = Z.copy()
    far[:3, 3] = [4.0, 0.0, 0.0]
    with pytest.raises(InputError, match="reaches only 0 of the 3"):
        choose_views(
            arm("ur5e"), standard_camera(), grid(9, 7, 0.03), 3,
            setup="eye-in-hand", X=X, Z=far, rng=np.random.default_rng(0),
        )  # fmt: skip
