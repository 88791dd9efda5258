"""A lens's uncertainty over its image, against a derivation by hand and drawn lenses."""

from __future__ import annotations

import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.diagnose.budget.image import GRID, image_uncertainty, working_distance


def test_a_focal_length_s_sigma_grows_from_the_middle() -> None:
    """u = f x/z + c: sigma_u = |u - c| sigma_f / f; across a plane at z, sigma_x = sigma_u z / f."""
    C = np.diag([4.0, 0.0, 0.0, 0.0])
    terms = {"fx": 800.0, "fy": 800.0, "cx": 319.5, "cy": 239.5}
    found = image_uncertainty(Camera.create("pinhole", terms, image_size=(640, 480), covariance=C), distance_m=2.0)
    u = (np.arange(GRID[0]) + 0.5) * 640 / GRID[0] - 0.5
    expected = np.tile(np.abs(u - 319.5) * 2.0 / 800.0, GRID[1])
    assert np.allclose(found.sigma_px, expected, atol=1e-12)
    assert np.allclose(found.sigma_mm, 1e3 * expected * 2.0 / 800.0, atol=1e-12)


def test_the_working_distance_is_the_median_depth() -> None:
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, 2, 3] = [0.5, 0.7, 3.0]
    assert working_distance(T) == pytest.approx(0.7)
    assert working_distance([]) is None
