"""Corners of dark squares by their edges: what lies beside the square must not reach into them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrant.detection.tags.quad_edges import refine_quads

FINE = 8
"""Drawn this many times finer, then averaged: edges between pixels keep their place."""


def picture(quads: list[tuple[np.ndarray, float]], noise: float = 1.0) -> np.ndarray:
    """A grey desk with convex polygons (n, 2) px on it, each of a brightness, blurred by 0.7 px."""
    fine = np.full((160 * FINE, 160 * FINE), 120.0, dtype=np.float32)
    for corners, brightness in quads:
        cv2.fillConvexPoly(fine, np.round(corners * FINE + (FINE - 1) / 2).astype(np.int32), brightness)
    image = cv2.resize(fine, (160, 160), interpolation=cv2.INTER_AREA)
    image = cv2.GaussianBlur(image, (0, 0), 0.7) + np.random.default_rng(0).normal(0, noise, image.shape)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


def square(half: float, *, slant: float = 0.0) -> np.ndarray:
    """Corners clockwise around (80, 80), leaning over by `slant`."""
    corners = half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return 80.0 + np.stack([corners[:, 0] + slant * corners[:, 1], corners[:, 1]], axis=-1)


def found_from(image: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors (4, 2) px and sigma (4,), from corners a pixel off, as a contour gives them."""
    start = truth + np.array([[1.0, -0.5], [-0.7, 0.8], [0.5, 1.0], [-1.0, -0.6]])
    uv, sigma = refine_quads(image, start[None], reach=0.1)
    return uv[0] - truth, sigma[0]


@pytest.mark.parametrize("margin", [3.5, 4.0, 6.0, 20.0])
def test_a_narrow_white_margin_on_a_darker_table(margin: float) -> None:
    truth = square(30.0)
    error, sigma = found_from(picture([(square(30.0 + margin), 220.0), (truth, 40.0)]), truth)
    # Two lines, each of 24 profiles good to a tenth of a pixel; drawn to an eighth of one.
    assert np.abs(error).max() < 0.15
    assert sigma.max() < 0.1


@pytest.mark.parametrize("slant", [1.0, 1.4])
def test_a_pattern_inside_a_slanted_border(slant: float) -> None:
    """A border an eighth wide, as a tag's: across a long slanted side it is much narrower than the side is long."""
    truth, paper, pattern = (square(half, slant=slant) for half in (24.0, 34.0, 18.0))
    error, sigma = found_from(picture([(paper, 220.0), (truth, 40.0), (pattern, 220.0)]), truth)
    # A corner of 35 degrees stretches what its lines are known to by two.
    assert np.abs(error).max() < 0.3
    assert sigma.max() < 0.2
