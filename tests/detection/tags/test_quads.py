"""Quadrilaterals are found where they are drawn, in either colour, and nothing else is."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrant.detection.tags.quads import find_quads


def drawn(quad: np.ndarray, *, ink: float = 40.0, paper: float = 210.0, blur_px: float = 0.8) -> np.ndarray:
    """A filled quadrilateral, anti-aliased by drawing at eight times the size."""
    fine = np.full((160 * 8, 200 * 8), paper, np.float32)
    cv2.fillConvexPoly(fine, np.rint((quad + 0.5) * 8 - 0.5).astype(np.int32), ink)
    small = cv2.resize(fine, (200, 160), interpolation=cv2.INTER_AREA)
    return np.rint(cv2.GaussianBlur(small, (0, 0), blur_px)).astype(np.uint8)


SLANTED = np.array([[60.0, 40.0], [140.0, 55.0], [130.0, 120.0], [50.0, 100.0]])


@pytest.mark.parametrize(("ink", "paper"), [(40.0, 210.0), (210.0, 40.0)])
def test_corners_lie_where_the_sides_meet(ink: float, paper: float) -> None:
    found = find_quads(drawn(SLANTED, ink=ink, paper=paper))
    aways = [np.linalg.norm(q[:, None] - SLANTED[None], axis=2).min(axis=1).max() for q in found]
    # Lines fitted to the middles of cracks average their half pixel out.
    assert min(aways) < 0.5
    outer = found[int(np.argmin(aways))]
    # Clockwise as seen, y down: the cross product of successive sides is positive.
    side = np.roll(outer, -1, axis=0) - outer
    after = np.roll(side, -1, axis=0)
    assert np.all(side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0] > 0)


def test_squares_that_touch_at_a_corner_stay_apart() -> None:
    image = np.full((100, 100), 220, np.uint8)
    image[20:50, 20:50] = image[50:80, 50:80] = 30
    centres = {tuple(np.rint(q.mean(axis=0)).astype(int)) for q in find_quads(image)}
    assert {(34, 34), (64, 64)} <= centres


@pytest.mark.parametrize("shape", ["disc", "triangle", "cross", "noise"])
def test_other_shapes_are_no_quadrilaterals(shape: str) -> None:
    image = np.full((160, 200), 210, np.uint8)
    if shape == "disc":
        cv2.circle(image, (100, 80), 40, 30, -1)
    elif shape == "triangle":
        cv2.fillConvexPoly(image, np.array([[60, 40], [150, 60], [80, 130]]), 30)
    elif shape == "cross":
        image[70:90, 60:140] = image[40:120, 90:110] = 30
    else:
        image = np.clip(np.random.default_rng(0).normal(128, 30, image.shape), 0, 255).astype(np.uint8)
        image = np.asarray(cv2.blur(image, (3, 3)), np.uint8)
    large = [q for q in find_quads(image) if min(np.ptp(q[:, 0]), np.ptp(q[:, 1])) > 30]
    assert large == []
