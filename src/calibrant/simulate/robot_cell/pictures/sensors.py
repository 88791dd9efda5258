"""Noise of pictures: what `CameraNoise` and `DepthNoise` do to a perfect colour and depth picture."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from calibrant.opencv import cv2
from calibrant.simulate.robot_cell.parts.noise import CameraNoise, DepthNoise
from calibrant.simulate.robot_cell.pictures.sensor_kernels import add_noise, bend, measure_depth

_STEP_PX = 0.3
"""Two surfaces in a matching window that differ by several times the disparity's noise spoil each other: a cube of 4 cm
stands out by 0.4 px at 2 m, by 0.9 px at 1.3 m."""
_FINE = 1e-6
"""In place of no rounding: pixels of disparity, metres; below what 32 bits hold."""
_SIDE = 1448
"""Of the square of numbers in a bank: two million."""


class NoiseBank:
    """Standard normal numbers drawn once a process; each picture reads them from a place of its own.

    A picture has a million: drawing them anew took longer than drawing the picture.
    """

    def __init__(self, rng: np.random.Generator, *, correlation_px: float) -> None:
        self._rng, self._correlation_px = rng, correlation_px

    def white(self, count: int) -> NDArray[np.float32]:
        """That many independent numbers."""
        if count > _SIDE * _SIDE:
            return self._rng.standard_normal(count, dtype=np.float32)
        start = int(self._rng.integers(_SIDE * _SIDE - count + 1))
        return _numbers(0.0).ravel()[start : start + count]

    def smooth(self, rows: int, columns: int) -> NDArray[np.float32]:
        """Numbers (rows * columns,) of a picture whose neighbours are alike."""
        if rows > _SIDE or columns > _SIDE:
            return self.white(rows * columns)
        r, c = (int(self._rng.integers(_SIDE - n + 1)) for n in (rows, columns))
        part = _numbers(self._correlation_px)[r : r + rows, c : c + columns]
        return np.ascontiguousarray(part).ravel()


@lru_cache(maxsize=4)
def _numbers(correlation_px: float) -> NDArray[np.float32]:
    """White noise blurred, and scaled to sigma 1."""
    white = np.random.default_rng(1).standard_normal((_SIDE, _SIDE), dtype=np.float32)
    if correlation_px <= 0.3:
        return white
    blurred = np.asarray(cv2.GaussianBlur(white, (0, 0), correlation_px), dtype=np.float32)
    return blurred / np.float32(blurred.std())


def noisy_colour(picture: NDArray[np.uint8], noise: CameraNoise, bank: NoiseBank) -> NDArray[np.uint8]:
    """Blur, then shot and read noise, then 8 bits, then compression."""
    out = picture
    if noise.blur_px > 0:
        out = np.asarray(cv2.GaussianBlur(picture, (0, 0), noise.blur_px), dtype=np.uint8)
    if noise.well_electrons > 0 or noise.read_grey > 0:
        out = np.ascontiguousarray(out) if out is not picture else picture.copy()
        add_noise(out.reshape(-1), _sigma(noise.well_electrons, noise.read_grey), bank.white(out.size))
    if noise.jpeg_quality:
        _, data = cv2.imencode(".jpg", out, [cv2.IMWRITE_JPEG_QUALITY, int(noise.jpeg_quality)])
        out = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)
    return out


@lru_cache(maxsize=8)
def _sigma(well_electrons: float, read_grey: float) -> NDArray[np.float32]:
    """1 sigma by grey (256,): of the electrons that a grey is, and of reading them."""
    shot = 255.0 / well_electrons if well_electrons > 0 else 0.0
    return np.sqrt(shot * np.arange(256) + read_grey**2).astype(np.float32)


def noisy_depth(
    depth: NDArray[np.float32],
    focal_px: float,
    noise: DepthNoise,
    bank: NoiseBank,
    *,
    offset_px: float,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """Depth as an active stereo camera measures it, NaN where it has none.

    depth (h, w): true, metres. A pixel of the left imager is hidden from the right one when another, to its right,
    meets the same place there: u - d(u) >= u' - d(u') for some u' > u. A matching window that holds a step of disparity
    beside its middle is lost; one that holds it farther out loses in half of the places, as a window takes the side
    with more texture. A slanted plane is no step: its disparity is linear in the picture.
    """
    if noise.perfect:
        return depth
    rows, columns = depth.shape
    fb = focal_px * noise.baseline_m
    disparity = np.divide(np.float32(fb), depth)
    near, wide = _steps(disparity, noise.edge_px)
    sure = rng.random((rows // 4 + 1, columns // 4 + 1), dtype=np.float32) < 0.5
    hole = float(ndtri(1 - noise.holes)) if noise.holes > 0 else np.inf
    largest = noise.largest_disparity_px if noise.largest_disparity_px > 0 else np.inf
    step = _STEP_PX if noise.edge_px > 0 else np.inf
    figures = np.array(
        [
            fb,
            largest,
            offset_px,
            step,
            noise.subpixel_px,
            noise.disparity_step_px or _FINE,
            hole,
            noise.unit_m or _FINE,
        ],
        dtype=np.float32,
    )
    out = np.empty_like(disparity)
    smooth = bank.smooth(rows, columns)
    measure_depth(out, disparity, near, wide, sure, smooth, bank.white(rows * columns), figures)
    return out


def _steps(disparity: NDArray[np.float32], edge_px: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """How far the disparity is from a plane's around each pixel, and the most of that within the window: two (h, w)."""
    if edge_px <= 0:
        return disparity, disparity
    near = np.empty_like(disparity)
    bend(near, disparity)
    size = 2 * round(edge_px) - 1
    wide = cv2.dilate(near, np.ones((size, size), np.uint8))
    return near, np.asarray(wide, dtype=np.float32)
