from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrant.cameras import Camera

SIZE = (1280, 1024)
LENSES = {
    "none": [0.0, 0.0, 0.0, 0.0, 0.0],
    "barrel": [-0.28, 0.09, 0.0008, -0.0011, -0.012],
    "pincushion": [0.12, -0.04, -0.002, 0.0015, 0.006],
}


def camera(lens: str) -> Camera:
    terms = dict(zip(("k1", "k2", "p1", "p2", "k3"), LENSES[lens]))
    return Camera.create("brown", {"fx": 900, "fy": 905, "cx": 645, "cy": 507, **terms}, image_size=SIZE)


@pytest.mark.parametrize("lens", LENSES)
def test_projection_is_opencvs(lens: str) -> None:
    rng = np.random.default_rng(24)
    z = rng.uniform(0.3, 3, (300, 1))
    p = np.concatenate([rng.uniform(-0.6, 0.6, (300, 2)) * z, z], axis=-1)
    ours = camera(lens)
    theirs, _ = cv2.projectPoints(p, np.zeros(3), np.zeros(3), ours.K, np.array(LENSES[lens]))
    np.testing.assert_allclose(ours.project(p), theirs.reshape(-1, 2), atol=1e-9, rtol=0)


def test_tangential_terms_stand_in_opencvs_order() -> None:
    """At x = 0.1, y = 0 the model gives x' = x + 3 p2 x^2 and y' = y + p1 x^2; p1 and p2 swapped would show here."""
    lens = Camera.create("brown", {"fx": 1000, "fy": 1000, "cx": 0, "cy": 0, "p1": 0.01, "p2": 0.02}, image_size=SIZE)
    np.testing.assert_allclose(lens.project([0.1, 0.0, 1.0]), [100 + 0.6, 0.1], atol=1e-12)


@pytest.mark.parametrize("lens", LENSES)
def test_the_whole_image_has_rays(lens: str) -> None:
    grid = np.stack(np.meshgrid(np.linspace(0, 1279, 41), np.linspace(0, 1023, 33)), axis=-1)
    ours = camera(lens)
    # Newton stops at 1e-14 of ideal coordinates, 1e-11 px; the corners of the barrel lens stretch that a little.
    np.testing.assert_allclose(ours.project(ours.unproject(grid)), grid, atol=1e-9)


def test_pixels_beyond_the_fold_have_no_ray() -> None:
    """k1 = -0.3 alone folds at r = sqrt(1 / 0.9) = 1.054, where the image ends at r' = 2/3 r = 0.703."""
    lens = Camera.create("brown", {"fx": 1000, "fy": 1000, "cx": 0, "cy": 0, "k1": -0.3}, image_size=SIZE)
    assert np.all(np.isfinite(lens.unproject([702.0, 0.0])))
    assert np.all(np.isnan(lens.unproject([704.0, 0.0])))
