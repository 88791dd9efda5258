"""Error and stated sigma of every target's points on rendered pictures that nothing was tuned on."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from calibrant.detection.registry import detector_for
from calibrant.detection.subpixel.refinement import Refinement
from calibrant.geometry import se3
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import look_at_board, standard_camera
from calibrant.targets.registry import parse_target

VIEWS = 4
SPECS = (
    "chessboard:9x6:30mm",
    "charuco:9x7:30mm:20mm:DICT_5X5_100",
    "circles:9x7:30mm",
    "circles:10x10:25.4mm:bigdot",
    "aprilgrid:6x6:30mm:0.3:36h11",
)


@lru_cache
def views(spec: str, blur_px: float, noise_grey: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Pictures of 1280x1024 and true pixels, tilts to 55 degrees."""
    target, camera, rng = parse_target(spec), standard_camera(), np.random.default_rng(7)
    look = Look(blur_px=blur_px, noise_grey=noise_grey, uneven_light=0.2, vignetting=0.1, clutter=20)
    poses = look_at_board(camera, target.points, VIEWS, rng=rng, distance=(0.35, 0.9), tilt_deg=55.0, roll_deg=30.0)
    return [
        (render(target.artwork(), camera, T, rng=rng, look=look), camera.project(se3.apply(T, target.points)))
        for T in poses
    ]


def accuracy(spec: str, blur_px: float, noise_grey: float, how: str = "saddle") -> tuple[float, float]:
    """RMS error per point over both axes, px, and chi-square of the stated sigma per coordinate."""
    target = parse_target(spec)
    error, scaled = [], []
    for image, truth in views(spec, blur_px, noise_grey):
        found = detector_for(target.kind, Refinement(how)).detect(image, target)
        assert found.sigma_px is not None
        assert len(found.uv) > 0.9 * len(truth)
        # A board without an origin may be counted from its other end.
        e = min((found.uv - way[found.point_ids] for way in (truth, truth[::-1])), key=lambda d: np.abs(d).max())
        error.append(e)
        scaled.append(e / found.sigma_px[:, None])
    e, z = np.concatenate(error), np.concatenate(scaled)
    return float(np.sqrt((e**2).sum(axis=1).mean())), float((z**2).mean())


@pytest.mark.statistics
@pytest.mark.parametrize("spec", SPECS)
def test_error_and_sigma_of_every_target(spec: str) -> None:
    rms, chi2 = accuracy(spec, 0.7, 2.0)
    assert rms < (0.012 if spec.startswith("circles") else 0.03)
    # 400 values and more scatter by 7 %, and the ratio that each picture's misfits give by 10 %.
    assert 0.75 < chi2 < 1.3


@pytest.mark.statistics
@pytest.mark.parametrize("spec", ["chessboard:9x6:30mm", "circles:9x7:30mm"])
@pytest.mark.parametrize(("blur_px", "noise_grey"), [(1.5, 1.0), (0.6, 5.0)])
def test_sigma_comes_from_the_picture(spec: str, blur_px: float, noise_grey: float) -> None:
    assert 0.7 < accuracy(spec, blur_px, noise_grey)[1] < 1.35


@pytest.mark.parametrize("how", ["foerstner", "radon"])
def test_other_refinements_know_what_the_raster_adds(how: str) -> None:
    # Without it chi-square is 1.4 to 4 at little noise.
    assert 0.65 < accuracy("chessboard:9x6:30mm", 0.7, 2.0, how)[1] < 1.4
