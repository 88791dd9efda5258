"""Noise of pictures: what `CameraNoise` and `DepthNoise` do to a perfect colour and depth picture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.opencv import cv2
from calibrant.simulate.robot_cell.parts.noise import CameraNoise, DepthNoise

_BANK = 1 << 21
_STEP_PX = 0.3
"""Two surfaces in a matching window that differ by several times the disparity's noise spoil each other: a cube of 4 cm
stands out by 0.4 px at 2 m, by 0.9 px at 1.3 m."""


class NoiseBank:
    """Standard normal numbers drawn once; each picture reads them from a place of its own.

    A picture has a million: drawing them anew took longer than drawing the picture.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._numbers = rng.standard_normal(_BANK, dtype=np.float32)

    def take(self, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """Numbers in this shape (fewer than the bank holds)."""
        count = int(np.prod(shape))
        start = int(self._rng.integers(_BANK - count)) if count < _BANK else 0
        return np.resize(self._numbers[start : start + count], shape)


def noisy_colour(picture: NDArray[np.uint8], noise: CameraNoise, bank: NoiseBank) -> NDArray[np.uint8]:
    """Blur, then shot and read noise, then 8 bits, then compression."""
    image = picture.astype(np.float32)
    if noise.blur_px > 0:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), noise.blur_px))
    shot = 255.0 / noise.well_electrons if noise.well_electrons > 0 else 0.0
    if shot > 0 or noise.read_grey > 0:
        sigma = np.sqrt(image * np.float32(shot) + np.float32(noise.read_grey**2))
        image += sigma * bank.take(image.shape)
    out = np.asarray(cv2.convertScaleAbs(np.maximum(image, 0.0)), dtype=np.uint8)
    if noise.jpeg_quality:
        _, data = cv2.imencode(".jpg", out, [cv2.IMWRITE_JPEG_QUALITY, int(noise.jpeg_quality)])
        out = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), dtype=np.uint8)
    return out


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
    meets the same place there: u - d(u) >= u' - d(u') for some u' > u.
    """
    fb = focal_px * noise.baseline_m
    disparity = np.float32(fb) / depth
    width = depth.shape[1]
    lost = np.zeros(depth.shape, dtype=bool)
    if noise.largest_disparity_px > 0:
        right = np.arange(width, dtype=np.float32) - disparity
        least = np.minimum.accumulate(right[:, ::-1], axis=1)[:, ::-1]
        lost[:, :-1] = right[:, :-1] >= least[:, 1:]
        lost |= disparity > noise.largest_disparity_px
    measured = disparity + np.float32(offset_px)
    if noise.edge_px > 0:
        lost |= _near_steps(disparity, noise.edge_px, rng)
    if noise.subpixel_px > 0:
        measured = measured + np.float32(noise.subpixel_px) * _smooth_noise(bank, depth.shape, noise.correlation_px)
    if noise.disparity_step_px > 0:
        step = np.float32(noise.disparity_step_px)
        measured = np.rint(measured / step) * step
    if noise.holes > 0:
        lost |= bank.take(depth.shape) > _quantile(noise.holes)
    with np.errstate(divide="ignore", invalid="ignore"):
        out = np.float32(fb) / measured
        if noise.unit_m > 0:
            out = np.rint(out / np.float32(noise.unit_m)) * np.float32(noise.unit_m)
    out[lost | ~(measured > 0)] = np.nan
    return out.astype(np.float32)


def _near_steps(disparity: NDArray[np.float32], edge_px: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Pixels whose matching window holds two surfaces: a step of disparity within reach.

    The reach differs from place to place by half, as a window takes the side with more texture.
    """
    size = 2 * round(edge_px) + 1
    kernel = np.ones((size, size), np.uint8)
    spread = cv2.dilate(disparity, kernel) - cv2.erode(disparity, kernel)
    near = cv2.dilate(disparity, np.ones((3, 3), np.uint8)) - cv2.erode(disparity, np.ones((3, 3), np.uint8))
    coarse = rng.random((disparity.shape[0] // 4 + 1, disparity.shape[1] // 4 + 1)) < 0.5
    sure = np.kron(coarse, np.ones((4, 4), dtype=bool))[: disparity.shape[0], : disparity.shape[1]]
    return np.asarray((near > _STEP_PX) | ((spread > _STEP_PX) & sure))


def _smooth_noise(bank: NoiseBank, shape: tuple[int, ...], correlation_px: float) -> NDArray[np.float32]:
    """Normal noise of sigma 1 whose neighbours are alike: white noise blurred, times 2 sqrt(pi) of the blur."""
    white = bank.take(shape)
    if correlation_px <= 0.3:
        return white
    blurred = cv2.GaussianBlur(white, (0, 0), correlation_px)
    return np.asarray(blurred * np.float32(2 * np.sqrt(np.pi) * correlation_px))


def _quantile(share: float) -> float:
    from scipy.special import ndtri

    return float(ndtri(1 - share))
