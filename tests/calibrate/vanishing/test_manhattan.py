"""Rotation and focal length from edges: exact without noise, true to their sigmas with it, refused by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calibrant.calibrate.vanishing.circles import great_circles, point_noise, straight
from calibrant.calibrate.vanishing.fit import LineFactor
from calibrant.calibrate.vanishing.manhattan import Manhattan, default_camera, manhattan_rotation, vanishing_point
from calibrant.calibrate.vanishing.result import vanishing_result
from calibrant.cameras import Camera
from calibrant.detection.line_segments import Segments, find_segments, from_parts
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import so3
from calibrant.simulate.manhattan import render_room, room
from calibrant.simulate.truth import chi_square

Array = NDArray[np.float64]
SIZE = (640, 480)
PINHOLE = Camera.create("pinhole", {"fx": 520.0, "fy": 520.0, "cx": 319.5, "cy": 239.5}, image_size=SIZE)
BROWN = Camera.create(
    "brown",
    {"fx": 520.0, "fy": 522.0, "cx": 325.0, "cy": 236.0, "k1": -0.28, "k2": 0.09, "p1": 1e-3, "p2": -5e-4},
    image_size=SIZE,
)
FISHEYE = Camera.create(
    "kannala_brandt", {"fx": 210.0, "fy": 210.0, "cx": 320.0, "cy": 238.0, "k1": 0.02, "k2": -0.01}, image_size=SIZE
)
CAMERAS = pytest.mark.parametrize("camera", [PINHOLE, BROWN, FISHEYE], ids=["pinhole", "brown", "kannala_brandt"])


def edges(
    camera: Camera, R: Array, counts: tuple[int, int, int], *, clutter: int = 0, sigma_px: float = 0.0, seed: int = 0
) -> Segments:
    """Edges along the columns of R at random places, and clutter in random directions, as points every 4 px or so."""
    rng = np.random.default_rng(seed)
    width, height = camera.image_size
    parts: list[Array] = []
    wanted = [k for k, n in enumerate(counts) for _ in range(n)] + [-1] * clutter
    for k in wanted:
        for _ in range(1000):
            direction = R[:, k] if k >= 0 else so3.random(rng, 1)[0][:, 0]
            middle = 4 * camera.unproject(rng.uniform((40, 40), (width - 40, height - 40)))
            line = middle + np.linspace(-0.7, 0.7, 25)[:, None] * direction
            uv = camera.project(line)
            inside = np.all(np.isfinite(uv)) and np.all((uv > 3) & (uv < np.array([width, height]) - 4))
            if inside and np.linalg.norm(uv[-1] - uv[0]) > 60:
                parts.append(uv + sigma_px * rng.standard_normal(uv.shape))
                break
    assert len(parts) == len(wanted)
    return from_parts(parts)


def turned(seed: int, reach: float = 0.5) -> Array:
    return so3.exp(np.random.default_rng(seed).uniform(-reach, reach, 3))


def error(found: Manhattan, R: Array) -> Array:
    return so3.log(R @ found.R_camera_scene.T)


@CAMERAS
def test_exact_without_noise(camera: Camera) -> None:
    """The inverse of the lens is exact to 1e-9 px of 500."""
    R = turned(1)
    found = manhattan_rotation(edges(camera, R, (8, 8, 8), clutter=6), camera)
    assert np.abs(error(found, R)).max() < 1e-9
    assert found.supported == (True, True, True)
    assert np.bincount(found.member[:24], minlength=3).tolist() == [8, 8, 8]


def test_the_focal_length_is_exact_without_noise() -> None:
    R = turned(2) @ so3.exp([0.3, 0.5, 0.0])
    found = manhattan_rotation(edges(PINHOLE, R, (8, 8, 8)), default_camera(SIZE), focal="unknown")
    assert found.camera.parameters["fx"] == pytest.approx(520.0, rel=1e-7)
    # The axes are named anew when the scene is turned by more than 45 degrees: R is one of the 24 namings.
    relabelled = R.T @ found.R_camera_scene
    np.testing.assert_allclose(np.sort(np.abs(relabelled), axis=0)[:2], 0.0, atol=1e-7)


@pytest.mark.statistics
@CAMERAS
def test_sigmas_of_edges_with_noise_and_clutter_are_true(camera: Camera) -> None:
    """Normalised squared errors of 3 values average 3."""
    squares = []
    for seed in range(20):
        R = turned(seed)
        found = manhattan_rotation(edges(camera, R, (10, 9, 8), clutter=5, sigma_px=0.3, seed=seed), camera)
        e = error(found, R)
        squares.append(chi_square(e, found.covariance))
    # The mean of 20 chi-squares with 3 degrees scatters by sqrt(6 / 20) = 0.55; three times that is allowed.
    assert np.mean(squares) == pytest.approx(3.0, abs=1.65)


@pytest.mark.statistics
def test_the_sigma_of_the_focal_length_is_true() -> None:
    z = []
    for seed in range(20):
        R = so3.exp([0.35, 0.6, 0.1]) @ turned(seed, 0.15)
        segments = edges(PINHOLE, R, (8, 8, 8), sigma_px=0.3, seed=seed)
        found = manhattan_rotation(segments, default_camera(SIZE), focal="unknown")
        assert found.sigma_focal is not None
        z.append(np.log(found.camera.parameters["fx"] / 520.0) / found.sigma_focal)
    # The rms of 20 normal values scatters by 1 / sqrt(40) = 0.16; three times that is allowed.
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=0.48)


@pytest.mark.statistics
def test_the_cameras_uncertainty_counts() -> None:
    sigma = np.array([4.0, 4.0, 5.0, 5.0, 0.01, 0.01, 1e-3, 1e-3, 0.0])
    squares, without = [], []
    for seed in range(12):
        rng, R = np.random.default_rng(seed), turned(seed)
        values = BROWN.values + sigma * rng.standard_normal(9)
        believed = replace(BROWN, values=values, covariance=np.diag(sigma**2))
        found = manhattan_rotation(edges(BROWN, R, (6, 6, 6), sigma_px=0.2, seed=seed), believed)
        assert found.of_camera is not None
        e = error(found, R)
        squares.append(chi_square(e, found.covariance))
        without.append(chi_square(e, found.covariance - found.of_camera))
    # The mean of 12 scatters by sqrt(6 / 12) = 0.71; three times that is allowed.
    assert np.mean(squares) == pytest.approx(3.0, abs=2.1)
    assert np.mean(without) > 9


@CAMERAS
def test_pictures_of_a_room(camera: Camera) -> None:
    """Edges found in rendered pictures with noise and blur: hundredths of a degree, and the sigmas true."""
    squares = []
    for seed in range(4):
        rng = np.random.default_rng(100 + seed)
        R = so3.exp(rng.uniform(-0.5, 0.5, 3))
        picture = render_room(room(rng), camera, R, rng=rng)
        found = manhattan_rotation(find_segments(picture), camera)
        e = error(found, R)
        assert np.rad2deg(np.linalg.norm(e)) < 0.06
        assert found.sigma_px < 0.15
        squares.append(chi_square(e, found.covariance))
    # The mean of 4 scatters by sqrt(6 / 4) = 1.2; three times that is allowed.
    assert np.mean(squares) < 3.0 + 3.7


def test_a_wrong_camera_shows_in_the_angles() -> None:
    """The angles between the directions tell a focal length that is 4 % off, and are right for the true one."""
    R = so3.exp([0.35, 0.6, 0.1])
    segments = edges(PINHOLE, R, (12, 12, 12), sigma_px=0.1)
    right = vanishing_result(manhattan_rotation(segments, PINHOLE))
    angles = [c for c in right.checks if c.name.startswith("orthogonality-")]
    assert len(angles) == 3
    assert all(c.status == "ok" for c in angles)
    off = replace(PINHOLE, values=PINHOLE.values * [1.04, 1.04, 1, 1])
    wrong = vanishing_result(manhattan_rotation(segments, off))
    assert any(c.status == "warn" for c in wrong.checks if c.name.startswith(("orthogonality-", "edges")))


def test_walls_a_degree_off_and_blurred_edges_are_said() -> None:
    R = so3.exp([0.35, 0.6, 0.1])
    slanted = R.copy()
    slanted[:, 1] = np.cos(np.deg2rad(1)) * R[:, 1] + np.sin(np.deg2rad(1)) * R[:, 0]
    found = vanishing_result(manhattan_rotation(edges(PINHOLE, slanted, (12, 12, 12), sigma_px=0.1), PINHOLE))
    assert any(c.status == "warn" for c in found.checks if c.name.startswith("orthogonality-"))
    blurred = vanishing_result(manhattan_rotation(edges(PINHOLE, R, (12, 12, 12), sigma_px=0.8), PINHOLE))
    assert "more than a sharp edge's" in blurred.check("edges").message
    assert all(c.status == "ok" for c in blurred.checks if c.name.startswith("orthogonality-"))


def test_two_directions_give_the_third() -> None:
    R = turned(5)
    found = manhattan_rotation(edges(PINHOLE, R, (9, 8, 0), sigma_px=0.1), PINHOLE)
    assert np.rad2deg(np.linalg.norm(error(found, R))) < 0.2
    assert found.supported[:2] == (True, True)
    assert "too few to say" in vanishing_result(found).check("direction-z").message


@pytest.mark.parametrize(
    ("counts", "clutter", "said"),
    [
        ((15, 0, 0), 0, "show one direction that is more than chance"),
        ((0, 0, 0), 25, "show no direction that is more than chance"),
        ((12, 0, 0), 20, "show one direction that is more than chance"),
        ((2, 1, 0), 0, "3 straight edges found, 4 are needed"),
    ],
)
def test_too_few_directions_are_refused(counts: tuple[int, int, int], clutter: int, said: str) -> None:
    for seed in range(5):
        segments = edges(PINHOLE, turned(seed), counts, clutter=clutter, sigma_px=0.3, seed=seed)
        with pytest.raises(RefusedError, match=said):
            manhattan_rotation(segments, PINHOLE)


def test_no_edges_at_all() -> None:
    blank = find_segments(np.full((480, 640), 90, np.uint8))
    assert len(blank) == 0
    with pytest.raises(RefusedError, match="0 straight edges found"):
        manhattan_rotation(blank, PINHOLE)


def test_a_focal_length_that_cannot_be_known_is_refused() -> None:
    """Two directions parallel to the picture vanish at infinity for every focal length; a third one does not help."""
    R = so3.exp([0.0, 0.0, 0.2])
    segments = edges(PINHOLE, R, (10, 10, 6), sigma_px=0.2)
    with pytest.raises(RefusedError, match=r"parallel to the image .* at infinity whatever the focal length"):
        manhattan_rotation(segments, default_camera(SIZE), focal="unknown")
    # The rotation alone is known well.
    assert np.rad2deg(np.linalg.norm(error(manhattan_rotation(segments, PINHOLE), R))) < 0.2


def test_cameras_that_do_not_suit() -> None:
    segments = edges(PINHOLE, turned(0), (5, 5, 5))
    flat = Camera.create("orthographic", {"fx": 1e4, "fy": 1e4, "cx": 320, "cy": 240}, image_size=SIZE)
    with pytest.raises(InputError, match="vanish nowhere"):
        manhattan_rotation(segments, flat)
    with pytest.raises(InputError, match="this one is brown"):
        manhattan_rotation(segments, BROWN, focal="unknown")


def test_edges_meet_at_their_vanishing_point() -> None:
    R = so3.exp([0.1, 0.2, 0.0])
    uv = vanishing_point(BROWN, R[:, 2])
    assert uv is not None
    np.testing.assert_allclose(uv, BROWN.project(R[:, 2]))
    assert vanishing_point(PINHOLE, np.array([1.0, 0.0, 0.0])) is None


def test_great_circles_know_their_noise_and_tell_what_is_bent() -> None:
    segments = edges(BROWN, turned(1), (10, 10, 10), sigma_px=0.25)
    circles = great_circles(BROWN.model, BROWN.values, segments)
    assert point_noise(circles) == pytest.approx(0.25, rel=0.1)  # 1 / sqrt(2 * 690) is 3 %
    bow = np.column_stack([np.linspace(100, 300, 25), 200 + 12 * np.sin(np.linspace(0, np.pi, 25))])
    with_bow = from_parts([*np.split(segments.uv, segments.offsets[1:-1]), bow])
    keep = straight(great_circles(BROWN.model, BROWN.values, with_bow))
    assert not keep[-1]
    assert keep[:-1].all()


def test_jacobians_against_central_differences() -> None:
    segments = edges(PINHOLE, turned(3), (3, 3, 3), sigma_px=0.5)
    circles = great_circles(PINHOLE.model, PINHOLE.values, segments)
    factor = LineFactor(circles, np.arange(9) // 3, np.ones(9))
    R, x, h = turned(4)[None].repeat(9, axis=0), np.full((9, 1), 0.2), 1e-6
    _, (turn, zoom) = factor.linearize(R, x)
    for axis in range(3):
        step = h * np.eye(3)[axis]
        ends = [factor.residuals(so3.exp(k * step) @ R, x) for k in (1, -1)]
        np.testing.assert_allclose(turn[:, :, axis], (ends[0] - ends[1]) / (2 * h), atol=1e-9)
    ends = [factor.residuals(R, x + k * h) for k in (1, -1)]
    np.testing.assert_allclose(zoom[:, :, 0], (ends[0] - ends[1]) / (2 * h), atol=1e-9)
