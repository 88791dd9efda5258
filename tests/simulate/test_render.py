"""Rendered images against independent measures of where the edges lie."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.special import erf

from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.simulate.render import IDEAL, Look, pixel_rays, render
from calibrant.simulate.scenes import look_at_board, standard_camera
from calibrant.targets import Artwork, Disc, Polygon
from calibrant.targets.chessboard import Chessboard
from calibrant.targets.registry import parse_target
from calibrant.targets.target import Target


@pytest.fixture(scope="module")
def camera() -> Camera:
    return standard_camera()


@pytest.fixture(scope="module")
def board() -> Target:
    return parse_target("chessboard:9x6:30mm")


def saddle(patch: np.ndarray, start: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Corner of a chessboard in a blurred patch: least squares on I = m + a erf(n1.d / s) erf(n2.d / s).

    Two straight edges through c, blurred: the profile is the integral of a Gaussian. Free: c, both directions, s, m, a.
    """
    y, x = np.mgrid[: patch.shape[0], : patch.shape[1]]

    def residual(v: np.ndarray) -> np.ndarray:
        dx, dy = x - v[0], y - v[1]
        first = erf((np.cos(v[2]) * dx + np.sin(v[2]) * dy) / v[4])
        second = erf((np.cos(v[3]) * dx + np.sin(v[3]) * dy) / v[4])
        return (v[5] + v[6] * first * second - patch).ravel()

    normals = np.arctan2(axes[0], -axes[1])
    sign = np.sign(patch[0, 0] - patch.mean()) or 1.0
    fits = [
        least_squares(residual, [*start, *normals, 1.8, patch.mean(), s * np.ptp(patch) / 2]) for s in (sign, -sign)
    ]
    return min(fits, key=lambda f: f.cost).x[:2]


def test_corners_lie_where_the_camera_projects_them(camera: Camera, board: Target) -> None:
    rng = np.random.default_rng(1)
    errors = []
    for T in look_at_board(camera, board.points, 4, rng=rng, distance=(0.45, 0.7)):
        image = render(board.artwork(), camera, T, rng=rng, look=IDEAL)
        # A blur wider than a pixel makes the pixels' box shape negligible in the model of the edges.
        blurred = cv2.GaussianBlur(image.astype(np.float64), (0, 0), 1.2)
        uv = camera.project(se3.apply(T, board.points))
        along = [camera.project(se3.apply(T, board.points + d)) - uv for d in ([1e-4, 0, 0], [0, 1e-4, 0])]
        for k in range(0, len(uv), 5):
            c0, r0 = np.rint(uv[k]).astype(int) - 6
            patch = blurred[r0 : r0 + 13, c0 : c0 + 13]
            axes = np.array([[a[k, 0] for a in along], [a[k, 1] for a in along]])
            errors.append(saddle(patch, uv[k] - [c0, r0], axes) - (uv[k] - [c0, r0]))
    error = np.array(errors)
    # 190 grey levels of contrast rounded to 8 bits and 64 samples a pixel leave some thousandths of a pixel.
    assert np.abs(error.mean(axis=0)).max() < 0.003
    assert np.sqrt((error**2).mean()) < 0.006
    assert np.abs(error).max() < 0.02


def test_opencv_finds_the_corners_without_bias(camera: Camera, board: Target) -> None:
    rng = np.random.default_rng(2)
    errors = []
    for T in look_at_board(camera, board.points, 4, rng=rng, distance=(0.45, 0.7)):
        image = render(board.artwork(), camera, T, rng=rng, look=IDEAL)
        uv = camera.project(se3.apply(T, board.points))
        start = np.ascontiguousarray(uv[:, None], dtype=np.float32)
        blurred = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.0)
        found = cv2.cornerSubPix(blurred, start, (5, 5), (-1, -1), (3, 200, 1e-6))[:, 0]
        errors.append(found - uv)
    error = np.concatenate(errors)
    # The method's own error on exactly supersampled pictures is 0.02 px RMS; half a pixel of offset would show at once.
    assert np.abs(error.mean(axis=0)).max() < 0.004
    assert np.sqrt((error**2).mean()) < 0.03


@pytest.mark.parametrize("turn", [0.0, 0.4])
@pytest.mark.parametrize("shape", ["square", "disc"])
def test_centroid_and_area_are_exact(shape: str, turn: float) -> None:
    corners = ((-0.02, -0.02), (0.02, -0.02), (0.02, 0.02), (-0.02, 0.02))
    drawn = Polygon(corners) if shape == "square" else Disc((0.0, 0.0), 0.02)
    artwork = Artwork((-0.05, -0.05, 0.05, 0.05), (drawn,))
    pinhole = Camera.create("pinhole", {"fx": 1000, "fy": 1000, "cx": 320, "cy": 240}, image_size=(640, 480))
    T = se3.make(so3.exp([0, 0, turn]), [0.0123, 0.0077, 0.5])  # parallel to the image: the centroid is the centre
    look = Look(0.0, (0.0, 0.0), 0.0, 255.0, 0.0, 0.0, 0.0, 0)
    ink = 255.0 - render(artwork, pinhole, T, rng=np.random.default_rng(0), look=look)
    centre = pinhole.project(T[:3, 3])
    y, x = np.mgrid[:480, :640]
    ink[np.hypot(x - centre[0], y - centre[1]) > 75] = 0  # beyond the sheet
    area = 80.0**2 if shape == "square" else np.pi * 40**2
    assert ink.sum() / 255 == pytest.approx(area, abs=1.0)
    # 320 edge pixels of 1/128 coverage each, at 40 px from the centre, over 6400 px: some 1e-3 px.
    assert (ink * x).sum() / ink.sum() == pytest.approx(centre[0], abs=2e-3)
    assert (ink * y).sum() / ink.sum() == pytest.approx(centre[1], abs=2e-3)


@pytest.mark.long
def test_slanted_polygons_are_drawn_as_upright_ones(camera: Camera) -> None:
    """A turned square on a sheet, seen turned back, is the upright square."""
    turn = so3.exp([0, 0, 0.37])
    corners = np.array([[-0.02, -0.02, 0], [0.02, -0.02, 0], [0.02, 0.02, 0], [-0.02, 0.02, 0]])
    upright = Artwork((-0.05, -0.05, 0.05, 0.05), (Polygon(tuple((x, y) for x, y, _ in corners.tolist())),))
    slanted_corners = tuple((x, y) for x, y, _ in (corners @ turn.T).tolist())
    slanted = Artwork((-0.05, -0.05, 0.05, 0.05), (Polygon(slanted_corners),))
    T = se3.make(np.eye(3), [0.0, 0.0, 0.5])
    T_back = se3.make(turn.T, [0.0, 0.0, 0.5])
    rng = np.random.default_rng(0)
    a, b = (render(art, camera, pose, rng=rng, look=IDEAL) for art, pose in ((upright, T), (slanted, T_back)))
    window = np.s_[440:580, 580:720]
    difference = a[window].astype(float) - b[window]
    assert np.abs(difference).max() < 0.1 * 190  # a tenth of a pixel on single pixels of an edge
    assert abs(difference.mean()) < 0.05  # and none over the whole


def test_rays_between_the_nodes_are_those_of_the_model(camera: Camera) -> None:
    rays = pixel_rays(camera)
    rng = np.random.default_rng(0)
    column, row = rng.integers(1280, size=300), rng.integers(1024, size=300)
    back = camera.project(rays[row, column])
    assert np.abs(back - np.column_stack([column, row])).max() < 1e-4


def test_a_lens_whose_field_ends_inside_the_image(board: Target) -> None:
    strong = Camera.create(
        "brown", {"fx": 200, "fy": 200, "cx": 160, "cy": 120, "k1": -0.9, "k2": 0.0}, image_size=(320, 240)
    )
    assert np.isnan(strong.unproject([0.0, 0.0])).any()
    T = se3.make(np.eye(3), [-0.12, -0.075, 0.5])
    image = render(board.artwork(), strong, T, rng=np.random.default_rng(0), look=IDEAL)
    assert image[0, 0] == 120  # background: nothing of the sheet wraps around
    assert image.min() == 25
    assert image.max() == 215


def test_markers_are_those_of_the_dictionary(camera: Camera) -> None:
    target = parse_target("charuco:5x7:36mm:27mm:DICT_5X5_100")
    T = look_at_board(camera, target.points, 1, rng=np.random.default_rng(4), tilt_deg=10, distance=(0.45, 0.5))[0]
    image = render(target.artwork(), camera, T, rng=np.random.default_rng(5))
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(image)
    assert sorted(ids.ravel().tolist()) == list(range(17))
    expected = {
        art.id: camera.project(se3.apply(T, [*art.top_left, 0.0]))
        for art in target.artwork().shapes
        if hasattr(art, "id")
    }
    for marker, corner in zip(ids.ravel().tolist(), corners):
        # Unrefined corners lie on whole pixels; a turned or mirrored marker would be a side, 50 px, off.
        assert np.linalg.norm(corner[0, 0] - expected[marker]) < 4


def test_same_seed_same_image_and_noise_of_the_asked_size(camera: Camera, board: Target) -> None:
    T = look_at_board(camera, board.points, 1, rng=np.random.default_rng(0))[0]
    looks = [render(board.artwork(), camera, T, rng=np.random.default_rng(seed)) for seed in (7, 7, 8)]
    assert np.array_equal(looks[0], looks[1])
    assert not np.array_equal(looks[0], looks[2])
    flat = Look(noise_grey=3.0, uneven_light=0.0, vignetting=0.0, clutter=0)
    noisy = render(board.artwork(), camera, T, rng=np.random.default_rng(0), look=flat)
    quiet = Look(noise_grey=0.0, uneven_light=0.0, vignetting=0.0, clutter=0)
    clean = render(board.artwork(), camera, T, rng=np.random.default_rng(0), look=quiet)
    # Rounding adds 1/12 of a grey squared to 9; 1.3 million pixels leave 0.1 %.
    assert np.std(noisy.astype(float) - clean) == pytest.approx(np.sqrt(9 + 2 / 12), rel=0.01)


def test_a_moved_picture_is_the_mean_of_those_along_the_way() -> None:
    small = Camera.create("pinhole", {"fx": 300.0, "fy": 300.0, "cx": 119.5, "cy": 89.5}, image_size=(240, 180))
    board, motion = Chessboard(5, 4, 0.02), np.array([3.6, -2.1])
    artwork = board.artwork()
    # Wide enough that what the pixels' raster makes of edges is smaller than the rounding of greys.
    look = Look(blur_px=1.6, noise_grey=0.0, uneven_light=0.0, vignetting=0.0, clutter=0)

    def taken(shift: np.ndarray, how: Look) -> np.ndarray:
        T = se3.make(np.eye(3), [-0.04 + shift[0] / 1000, -0.03 + shift[1] / 1000, 0.3])  # 1 mm is 1 px
        return render(artwork, small, T, rng=np.random.default_rng(0), look=how).astype(float)

    still = taken(np.zeros(2), look)
    moved = taken(np.zeros(2), replace(look, motion_px=(float(motion[0]), float(motion[1]))))
    # Eight places over 4.2 px, by the rule of midpoints.
    mean = np.mean([taken(((i + 0.5) / 8 - 0.5) * motion, look) for i in range(8)], axis=0)
    assert np.abs(moved - mean).max() < 3.0
    assert np.abs(moved - mean).mean() < 0.3
    assert np.abs(still - mean).max() > 10.0
    down, across = np.gradient(mean)
    shift = np.linalg.lstsq(np.stack([across.ravel(), down.ravel()], axis=1), (moved - mean).ravel())[0]
    assert np.abs(shift).max() < 1e-3  # px: the pose is that of mid-exposure


def test_a_board_behind_or_out_of_view_leaves_the_background(camera: Camera, board: Target) -> None:
    rng = np.random.default_rng(0)
    away = se3.make(np.eye(3), [5.0, 0.0, 0.5])
    from_behind = se3.make(so3.exp([0, np.pi, 0]), [0.1, 0.0, 0.5])
    behind_camera = se3.make(np.eye(3), [0.0, 0.0, -0.5])
    for T in (away, from_behind, behind_camera):
        assert np.all(render(board.artwork(), camera, T, rng=rng, look=IDEAL) == 120)


def test_a_pose_that_is_no_transform_is_refused(camera: Camera, board: Target) -> None:
    with pytest.raises(InputError, match="T_camera_target"):
        render(board.artwork(), camera, 2 * np.eye(4), rng=np.random.default_rng(0))


def test_a_look_that_cannot_be(camera: Camera) -> None:
    with pytest.raises(InputError, match="at least 0"):
        Look(blur_px=-1)
    with pytest.raises(InputError, match="0 to below 1"):
        Look(vignetting=1.5)
