"""The closed-form start: homographies, focal lengths and poses of exact and of bad views."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.calibrate.classical import planar as planar_start
from calibrant.calibrate.reprojection.factor import stack
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.simulate.scenes import grid, look_at_board, observe

CAMERA = Camera.create("pinhole", {"fx": 900.0, "fy": 890.0, "cx": 639.5, "cy": 511.5}, image_size=(1280, 1024))
POINTS = grid(8, 6, 0.03)
K = np.array([[900.0, 0, 639.5], [0, 890.0, 511.5], [0, 0, 1]])
CENTRE = np.array([639.5, 511.5])


def exact_views(n: int, *, tilt_deg: float = 40.0):
    rng = np.random.default_rng(2)
    T = look_at_board(CAMERA, POINTS, n, rng=rng, tilt_deg=tilt_deg)
    return T, stack(observe(CAMERA, POINTS, T, sigma_px=0, rng=rng).views)


def test_exact_views_give_the_focal_lengths_and_the_poses() -> None:
    T, views = exact_views(6)
    H, good = planar_start.homographies(views.points[:, :2].copy(), views.uv, views.offsets)
    assert good.all()
    focal = planar_start.focal_lengths(H, CENTRE)
    assert focal == pytest.approx((900.0, 890.0), rel=1e-8)
    assert np.abs(planar_start.poses(H, K) - T).max() < 1e-8


def test_boards_that_face_the_camera_show_no_focal_length() -> None:
    _, views = exact_views(5, tilt_deg=0.0)
    H, _ = planar_start.homographies(views.points[:, :2].copy(), views.uv, views.offsets)
    focal = planar_start.focal_lengths(H, CENTRE)
    # Rounding may leave a number, but then one that no lens has; None is the honest answer.
    assert focal is None or focal != pytest.approx((900.0, 890.0), rel=0.01)


def test_a_misread_board_does_not_bend_the_focal_lengths() -> None:
    _, views = exact_views(8)
    uv = views.uv.copy()
    first = slice(views.offsets[0], views.offsets[1])
    uv[first] = np.roll(uv[first].reshape(6, 8, 2), 1, axis=0).reshape(-1, 2)  # rows numbered from the second on
    H, _ = planar_start.homographies(views.points[:, :2].copy(), uv, views.offsets)
    assert planar_start.focal_lengths(H, CENTRE) == pytest.approx((900.0, 890.0), rel=0.05)


def test_points_on_a_line_determine_no_homography() -> None:
    _, views = exact_views(1)
    row = slice(0, 8)
    offsets = np.array([0, 8])
    _, good = planar_start.homographies(views.points[row, :2].copy(), views.uv[row].copy(), offsets)
    assert not good.any()


def test_a_plane_anywhere_in_space_is_found() -> None:
    T = se3.make(so3.exp([0.4, -0.9, 0.2]), [0.3, 0.1, -0.2])
    moved = se3.apply(T, POINTS)
    plane = planar_start.in_plane(moved)
    back = se3.apply(plane.T_plane_target, moved)
    assert np.abs(back[:, 2]).max() < 1e-12
    assert np.abs(back[:, :2] - plane.xy).max() < 1e-12


def test_a_target_with_depth_is_refused() -> None:
    deep = POINTS + np.random.default_rng(0).normal(0, 0.01, POINTS.shape)
    with pytest.raises(InputError, match="do not lie in a plane"):
        planar_start.in_plane(deep)
