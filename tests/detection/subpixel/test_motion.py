"""Corners of pictures that moved while they were exposed: where they are, how certain along and across the motion."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from calibrant.cameras.camera import Camera
from calibrant.detection.chessboard.detector import ChessboardDetector
from calibrant.detection.detection import Detection
from calibrant.detection.images.moved import notes_on_motion
from calibrant.detection.registry import detector_for
from calibrant.detection.subpixel import saddle
from calibrant.detection.subpixel.first_stretch import first_stretches
from calibrant.detection.subpixel.motion import common_stretch
from calibrant.detection.subpixel.moved_edges import linearise_moved
from calibrant.geometry import se3, so3
from calibrant.simulate.render import Look, render
from calibrant.targets import Target
from calibrant.targets.chessboard import Chessboard
from calibrant.targets.registry import parse_target

CAMERA = Camera.create("pinhole", {"fx": 900.0, "fy": 900.0, "cx": 399.5, "cy": 299.5}, image_size=(800, 600))
BOARD = Chessboard(9, 6, 0.025)


def taken(target: Target, motion: tuple[float, float], seed: int, *, far: float = 0.5) -> tuple[Detection, np.ndarray]:
    """The detection of a picture taken on the move, and what it is off by (n, 2) px."""
    rng = np.random.default_rng(seed)
    R = so3.exp(np.array([*rng.uniform(-0.4, 0.4, 2), 0.0])) @ so3.exp(np.array([0.0, 0.0, rng.uniform(-0.2, 0.2)]))
    shift = np.array([*rng.uniform(-0.02, 0.02, 2), far])
    T = se3.make(R, shift - R @ target.points.mean(axis=0))
    look = Look(clutter=0, noise_grey=3.0, motion_px=motion)
    found = detector_for(target.kind).detect(render(target.artwork(), CAMERA, T, rng=rng, look=look), target)
    true = CAMERA.project(se3.apply(T, target.points[np.searchsorted(target.point_ids, found.point_ids)]))
    return found, found.uv - true


@njit
def call(window, p, J, r):  # type: ignore[no-untyped-def]
    return linearise_moved(window, p, J, r)


@pytest.mark.parametrize("stretch", [(0.0, 0.0), (1e-5, -2e-5), (0.5, -0.3), (-0.8, 0.6)])
def test_jacobian_of_the_moved_corner_against_central_differences(stretch: tuple[float, float]) -> None:
    v, u = np.mgrid[:13, :13].astype(float)
    window = np.stack([u.ravel(), v.ravel(), np.random.default_rng(0).uniform(50, 200, 169)])
    # Without the third moments, whose own slopes by the other parameters are left out.
    p = np.array([6.2, 5.9, 0.2, 1.7, 0.3, 120.0, 80.0, 0.5, -0.3, 0.0, 0.0, *stretch])
    J, r = np.empty((13, 169)), np.empty(169)
    cost = call(window, p, J, r)
    assert cost == pytest.approx(r @ r)
    for k in range(13):
        step = 1e-6 * max(1.0, abs(p[k]))
        ends = []
        for sign in (1, -1):
            moved, at = p.copy(), np.empty(169)
            moved[k] += sign * step
            call(window, moved, np.empty((13, 169)), at)
            ends.append(at)
        # Step and bell are polynomials good to 3e-6, their slopes to 2e-4: of a contrast of 80, over 3.5 deviations.
        np.testing.assert_allclose((ends[1] - ends[0]) / (2 * step), J[k], atol=1e-3 * np.abs(J[k]).max() + 0.06)


@pytest.mark.parametrize("length", [0.0, 2.0, 4.0])
def test_the_first_step_is_where_the_fit_ends(length: float) -> None:
    rng = np.random.default_rng(3)
    T = se3.make(so3.exp(np.array([0.2, -0.3, 0.1])), np.array([-0.1, -0.06, 0.5]))
    look = Look(clutter=0, noise_grey=3.0, motion_px=(0.8 * length, -0.6 * length))
    grey = render(BOARD.artwork(), CAMERA, T, rng=rng, look=look)
    true = CAMERA.project(se3.apply(T, BOARD.points)).reshape(6, 9, 2)
    uv = true[1:-1, 1:-1].reshape(-1, 2)
    steps = np.concatenate([(true[1:-1, 2:] - true[1:-1, 1:-1]), (true[2:, 1:-1] - true[1:-1, 1:-1])], axis=2)
    steps, dark = steps.reshape(-1, 4), np.add.outer(np.arange(4), np.arange(7)).ravel() % 2 == 0
    options = {"radius_px": 6.0, "blur_px": 1.0, "zero_zone_px": 0.0}
    fitted, sigma, _ = saddle.fit(grey, uv, steps, dark, **options)
    assert np.isfinite(sigma[:, 0]).all()
    begin = np.hstack([fitted, np.zeros((len(uv), 2))])
    ends = saddle.fit(grey, uv, steps, dark, **options, begin=begin)[0][:, -2:]
    first = first_stretches(grey, fitted, uv, steps, radius_px=6.0, zero_zone_px=0.0)
    away = np.hypot(*(first - ends).T)
    # To a tenth; and to what noise of 3 grey levels leaves of either, a few hundredths.
    assert np.all(away < 0.03 + 0.15 * np.hypot(*ends.T)), (first, ends)
    assert np.isnan(first_stretches(grey, fitted, uv, 0.1 * steps, radius_px=6.0, zero_zone_px=0.0)).all()


def test_a_stretch_is_motion_where_all_corners_share_it() -> None:
    rng = np.random.default_rng(1)
    shared = np.array([0.5, -0.3]) + 0.1 * rng.standard_normal((9, 2))
    assert common_stretch(shared) == pytest.approx(tuple(shared.mean(axis=0)))
    turned = 0.6 * np.stack([np.cos(np.arange(9) * 0.7), np.sin(np.arange(9) * 0.7)], axis=1)
    assert common_stretch(turned) is None
    assert common_stretch(0.1 * shared) is None
    assert common_stretch(shared[:4]) is None


def test_pictures_at_rest_are_rarely_taken_for_moved_ones() -> None:
    rng = np.random.default_rng(2)
    # Scatter so large that means beyond STRETCH come often: chance alone decides.
    moved = [common_stretch(2.0 * rng.standard_normal((9, 2))) is not None for _ in range(4000)]
    # A thousandth of 4000 is 4, with a deviation of 2.
    assert sum(moved) <= 12


def test_a_picture_at_rest_has_no_covariance() -> None:
    found, _ = taken(BOARD, (0.0, 0.0), 0)
    assert len(found.uv) == 54
    assert found.covariance_px is None


@pytest.mark.parametrize(
    "spec", ["chessboard:9x6:25mm", "charuco:8x6:30mm:22mm:5x5_100", "aprilgrid:4x3:40mm:0.3:36h11"]
)
def test_every_detector_states_the_covariance_of_a_moved_picture(spec: str) -> None:
    found, _ = taken(parse_target(spec), (5.0, 0.0), 3)
    assert found.covariance_px is not None
    assert found.sigma_px is not None
    along, across = np.sqrt(np.median(np.diagonal(found.covariance_px, axis1=1, axis2=2), axis=0))
    assert along > 1.3 * across
    np.testing.assert_allclose(found.sigma_px**2, 0.5 * np.trace(found.covariance_px, axis1=1, axis2=2))


@pytest.mark.statistics
@pytest.mark.parametrize("length", [0.0, 2.0, 6.0])
@pytest.mark.parametrize("angle", [0.0, 0.8])
def test_errors_along_and_across_the_motion_match_their_sigma(length: float, angle: float) -> None:
    along = np.array([np.cos(angle), np.sin(angle)])
    across = np.array([-along[1], along[0]])
    scaled: list[np.ndarray] = []
    for seed in range(8):
        found, error = taken(BOARD, (float(length * along[0]), float(length * along[1])), 100 + seed)
        assert found.sigma_px is not None
        C = found.sigma_px[:, None, None] ** 2 * np.eye(2) if found.covariance_px is None else found.covariance_px
        scaled.append(np.stack([error @ d / np.sqrt(np.einsum("i,nij,j->n", d, C, d)) for d in (along, across)]))
    rms = np.sqrt(np.mean(np.concatenate(scaled, axis=1) ** 2, axis=1))
    # 432 corners: 3 % by chance; the rest is what a smear is beside a Gaussian.
    assert np.all((rms > 0.8) & (rms < 1.25)), rms


def test_a_smear_beyond_half_a_square_is_named() -> None:
    small = Chessboard(17, 11, 0.009)  # squares of 16 px
    held, _ = taken(small, (4.0, 0.0), 5)
    assert held.covariance_px is not None
    assert not held.smeared
    found, _ = taken(small, (10.0, 0.0), 5)
    assert found.smeared
    (note,) = notes_on_motion([("a.png", found.smeared), ("b.png", held.smeared)])
    assert note.startswith("1 of 2 pictures moved by half a square or more while they were exposed: a.png.")
    assert notes_on_motion([("b.png", False)]) == ()


@pytest.mark.parametrize("length", [0.0, 6.0])
def test_a_smeared_tag_is_no_larger_than_it_is(length: float) -> None:
    """Its edges are 30 px from anything else: profiles see the whole smear, and no drawing is needed."""
    target = parse_target("marker:150mm:DICT_APRILTAG_36h11:10")
    T = se3.make(so3.exp(np.array([0.2, -0.3, 0.1])), np.array([0.0, 0.0, 0.5]))
    look = Look(clutter=0, noise_grey=0.1, motion_px=(length, 0.0))
    found = detector_for("marker").detect(
        render(target.artwork(), CAMERA, T, rng=np.random.default_rng(0), look=look), target
    )
    truth = CAMERA.project(se3.apply(T, target.points))
    outwards = truth - truth.mean(axis=0)
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    # Compared with drawings, whose blur is alike to all sides, they were 0.03 and 0.07 px outwards. A corner's own σ is
    # 0.022 px, that of their mean 0.011.
    assert abs(np.sum((found.uv - truth) * outwards, axis=1).mean()) < 0.02


def test_other_refinements_keep_their_own_sigma() -> None:
    from calibrant.detection.subpixel.refinement import Refinement

    rng = np.random.default_rng(4)
    T = se3.make(np.eye(3), np.array([-0.1, -0.0625, 0.5]))
    image = render(BOARD.artwork(), CAMERA, T, rng=rng, look=Look(clutter=0, noise_grey=3.0, motion_px=(5.0, 0.0)))
    found = ChessboardDetector(Refinement("foerstner")).detect(image, BOARD)
    assert found.found
    assert found.covariance_px is None
