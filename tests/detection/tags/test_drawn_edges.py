"""Corners of blurred markers: true to a fraction of their blur, and no less certain or more than stated."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrant.detection.opencv import marker_cells
from calibrant.detection.tags.agreement import map_from_unit_square
from calibrant.detection.tags.detector import TagDetector
from calibrant.targets.registry import parse_target

FINE = 4
"""Drawn and blurred this many times finer, then averaged."""
CELL = 24
PAPER_CELLS = 2
"""Paper around the marker; beyond it lies a darker table."""


def picture(spec: str, truth: np.ndarray, *, blur: float, noise: float, seed: int, size: int = 160) -> np.ndarray:
    """A marker with corners truth (4, 2) px, its light falling off by a tenth across the picture."""
    target = parse_target(spec)
    cells = np.pad(marker_cells(target.dictionary, target.id), PAPER_CELLS, constant_values=True)
    art = np.kron(np.where(cells, 225.0, 30.0), np.ones((CELL, CELL))).astype(np.float32)
    edge = PAPER_CELLS / (len(cells) - 2 * PAPER_CELLS)
    sheet = np.array([[-edge, -edge], [1 + edge, -edge], [1 + edge, 1 + edge], [-edge, 1 + edge]])
    corners = FINE * map_from_unit_square(truth[None], sheet[None])[0] + 0.5 * (FINE - 1)
    high = len(art) - 0.5
    rim = np.array([[-0.5, -0.5], [high, -0.5], [high, high], [-0.5, high]], np.float32)
    H = cv2.getPerspectiveTransform(rim, corners.astype(np.float32))
    scene = cv2.warpPerspective(art, H, (size * FINE, size * FINE), borderValue=90.0)
    scene = scene * np.linspace(1.05, 0.95, size * FINE, dtype=np.float32)
    scene = cv2.resize(cv2.GaussianBlur(scene, (0, 0), FINE * blur), (size, size), interpolation=cv2.INTER_AREA)
    noisy = scene + noise * np.random.default_rng(seed).standard_normal(scene.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def quad(half: float, seed: int, *, slant: float = 0.25) -> np.ndarray:
    """Corners of a square seen at an angle, clockwise, turned by the seed."""
    rng = np.random.default_rng(seed)
    turn, tilt = rng.uniform(0, 2 * np.pi), 1.0 - rng.uniform(0, slant)
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * [1.0, tilt]
    return 79.5 + rng.uniform(-0.5, 0.5, 2) + half * corners @ R.T


@pytest.mark.parametrize(("blur", "half", "most_px"), [(0.7, 12.0, 0.03), (2.5, 35.0, 0.06), (3.5, 45.0, 0.08)])
def test_blurred_markers_err_as_stated(blur: float, half: float, most_px: float) -> None:
    error, scaled = [], []
    for seed in range(16):
        spec = f"marker:50mm:DICT_4X4_50:{seed}"
        truth = quad(half, seed)
        found = TagDetector().detect(picture(spec, truth, blur=blur, noise=2.0, seed=seed), parse_target(spec))
        if len(found.uv):
            error.append(found.uv - truth)
            scaled.append(error[-1] / found.sigma_px[:, None])
    assert len(error) >= 14
    # Found 0.018, 0.036 and 0.045 px; without the drawing 0.10, 0.09 and 0.13 at chi-squares of 2.9, 5.2 and 9.3.
    assert np.sqrt(np.mean(np.square(error))) < most_px
    # 112 values and more, each side's shared by two corners: a deviation of 0.17 of it. Where noise moves corners by
    # less than a print is good to, sigma states that.
    assert 0.3 < np.mean(np.square(scaled)) < 1.5


def test_what_is_around_a_marker_does_not_draw_it_aside() -> None:
    """Without noise the drawing is the picture: what is left is a hundredth of the blur."""
    spec, truth = "marker:50mm:DICT_4X4_50:7", quad(40.0, 3)
    found = TagDetector().detect(picture(spec, truth, blur=3.0, noise=0.2, seed=0), parse_target(spec))
    # 0.018 px; without the drawing 0.058.
    assert np.abs(found.uv - truth).max() < 0.03
