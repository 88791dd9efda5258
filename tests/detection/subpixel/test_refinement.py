"""Foerstner's and Radon's refinement beside ours: error and stated sigma on rendered boards, and their options."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from calibrant.detection.chessboard.detector import ChessboardDetector
from calibrant.detection.registry import detector_for
from calibrant.detection.subpixel.refinement import Refinement
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import look_at_board, standard_camera
from calibrant.targets.registry import parse_target

BOARD = parse_target("chessboard:9x6:30mm")


@lru_cache
def pictures(noise_grey: float) -> list[tuple[np.ndarray, np.ndarray]]:
    look = Look(blur_px=0.7, noise_grey=noise_grey, uneven_light=0.2, vignetting=0.1, clutter=20)
    camera, rng = standard_camera(), np.random.default_rng(1)
    poses = look_at_board(camera, BOARD.points, 3, rng=rng, distance=(0.4, 0.8))
    return [
        (render(BOARD.artwork(), camera, T, rng=rng, look=look), camera.project(se3.apply(T, BOARD.points)))
        for T in poses
    ]


def errors(how: Refinement, noise_grey: float) -> tuple[float, float]:
    """RMS per axis, px, and chi-square per coordinate, of all corners."""
    error, sigma = [], []
    for image, truth in pictures(noise_grey):
        found = ChessboardDetector(how).detect(image, BOARD)
        assert found.sigma_px is not None
        assert len(found.uv) > 50
        here = truth if np.abs(found.uv - truth[found.point_ids]).max() < 5 else truth[::-1]
        error.append(found.uv - here[found.point_ids])
        sigma.append(found.sigma_px)
    e, s = np.concatenate(error), np.concatenate(sigma)[:, None]
    return float(np.sqrt((e**2).mean())), float((e**2 / s**2).mean())


@pytest.mark.statistics
@pytest.mark.parametrize(
    ("how", "most_px"),
    [
        (Refinement(), 0.012),
        (Refinement("saddle", 0.2), 0.012),
        (Refinement("saddle", zero_zone_px=1.0), 0.012),
        (Refinement("foerstner", 0.4), 0.016),
        (Refinement("foerstner", 0.4, zero_zone_px=(1.0, 2.0)), 0.02),
        (Refinement("radon"), 0.018),
    ],
)
def test_error_and_sigma_at_ordinary_noise(how: Refinement, most_px: float) -> None:
    rms, chi2 = errors(how, 2.0)
    # OpenCV's SB with CALIB_CB_ACCURACY has 0.020 px on such pictures.
    assert rms < most_px
    # 324 values scatter by 8 %; beyond that, Foerstner's gradients feel the pixels' raster.
    assert 0.7 < chi2 < 1.7


@pytest.mark.parametrize(("how", "most_px"), [(Refinement(), 0.035), (Refinement("radon"), 0.055)])
def test_error_and_sigma_at_strong_noise(how: Refinement, most_px: float) -> None:
    rms, chi2 = errors(how, 8.0)
    assert rms < most_px
    assert 0.7 < chi2 < 1.6


def test_the_window_is_what_it_says() -> None:
    image, _ = pictures(2.0)[0]
    small = ChessboardDetector(Refinement("foerstner", 0.15)).detect(image, BOARD)
    large = ChessboardDetector(Refinement("foerstner", 0.45)).detect(image, BOARD)
    assert small.sigma_px is not None
    assert large.sigma_px is not None
    # More pixels, more certainty.
    assert np.median(large.sigma_px) < 0.7 * np.median(small.sigma_px)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Refinement("harris"), "unknown refinement 'harris'"),
        (lambda: Refinement("foerstner", 0.9), "5% to 50%"),
        (lambda: Refinement("radon", zero_zone_px=1.0), "no zero zone"),
        (lambda: Refinement("saddle", zero_zone_px=(1.0, 30.0)), "got 1, 30 px"),
        (lambda: detector_for("circles", Refinement("radon")), "chessboard and charuco"),
    ],
)
def test_options_that_make_no_sense_are_named(make: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()  # type: ignore[operator]
