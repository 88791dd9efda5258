"""Points carried from another camera's: Jacobians, and the error of a corner that is in both pictures."""

from __future__ import annotations

import numpy as np
from tests.calibrate.reprojection.slopes import check_slopes

from calibrant.calibrate.reprojection.carried import CarriedFactor
from calibrant.calibrate.reprojection.factor import ReprojectionFactor, stack
from calibrant.calibrate.reprojection.links import Link
from calibrant.simulate.projector.points import board_poses, carried_views, example_pair
from calibrant.simulate.scenes import grid

PAIR, POINTS, VIEWS = example_pair(), grid(5, 4, 0.03), 3
POSES = board_poses(PAIR, POINTS, VIEWS, np.random.default_rng(0), distance=(0.7, 1.0))
ONE, EACH = np.zeros(VIEWS, dtype=np.int64), np.arange(VIEWS)


def factor_of(*, corner_px: float, decoded_px: float = 0.0) -> tuple[CarriedFactor, list[np.ndarray]]:
    """The factor of the projector's views, and the true values of its slots."""
    seen = carried_views(
        PAIR, POINTS, POSES, np.random.default_rng(1), corner_px=corner_px, decoded_px=decoded_px
    ).of_camera("projector")
    carried = [v.carried for v in seen.views if v.carried is not None]
    views = stack(seen.views)
    own = ReprojectionFactor(
        "q", model=PAIR.projector.model, camera="projector", views=views,
        links=[Link("P", ONE, inverted=True), Link("T", EACH)],
    )  # fmt: skip
    there = stack(seen.views)
    there = type(there)(there.points, np.concatenate([c.uv for c in carried]), there.sigma, there.offsets)
    at = ReprojectionFactor("u", model=PAIR.camera.model, camera="camera", links=[Link("T", EACH)], views=there)
    slope = np.concatenate([c.slope for c in carried])
    values = [
        np.tile(PAIR.T_camera_projector, (VIEWS, 1, 1)), POSES,
        np.tile(PAIR.projector.values, (VIEWS, 1)), np.tile(PAIR.camera.values, (VIEWS, 1)),
    ]  # fmt: skip
    return CarriedFactor("q", seen=own, at=at, slope=slope), values


def test_both_pictures_share_the_target_poses_slot() -> None:
    factor, _ = factor_of(corner_px=0.0)
    assert factor.variables == ("P", "T", "projector", "camera")


def test_a_corners_error_leaves_no_residual() -> None:
    """Half a pixel of error in the corners: what is left is second order in it, the bend of the slopes."""
    factor, values = factor_of(corner_px=0.5)
    plain = np.abs(factor.seen.residuals(*values[:3])).max()
    assert plain > 0.5
    np.testing.assert_allclose(factor.residuals(*values), 0.0, atol=1e-7)


def test_the_decodings_error_is_all_that_is_left() -> None:
    factor, values = factor_of(corner_px=0.5, decoded_px=0.03)
    # 120 numbers tell a standard deviation to 6.5 per cent; three sigmas allowed.
    assert 0.8 < np.std(factor.residuals(*values)) / 0.03 < 1.2


def test_jacobians_against_central_differences() -> None:
    factor, values = factor_of(corner_px=0.2, decoded_px=0.1)
    check_slopes(factor, values)
