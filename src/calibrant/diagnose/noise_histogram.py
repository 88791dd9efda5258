"""Residuals of the used points beside the noise that the result states: a histogram and what lies far out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult
from calibrant.optimize.chances import chi2_tail

BINS = 41
"""Odd, so that one is about zero; 5 sigma to each side, the outermost with all that lies beyond."""
_REACH = 5.0
_FAR = 3.0


@dataclass(frozen=True, eq=False)
class NoiseHistogram:
    """One camera's residuals, both axes, pixels: edges (n + 1,), counts (n,), and expected (n,) of Gaussian noise of
    sigma_px per axis. far, far_expected: the share beyond 3 sigma."""

    camera: str
    sigma_px: float
    edges: Array
    counts: Array
    expected: Array
    far: float
    far_expected: float

    @property
    def total(self) -> int:
        """Number of residuals, two a point."""
        return int(self.counts.sum())


def noise_histograms(result: CalibrationResult, residuals: Sequence[tuple[str, Array]]) -> tuple[NoiseHistogram, ...]:
    """By camera whose noise the result states. Args: residuals, camera and (n, 2) px of each used view, the points that
    were left out not among them."""
    stated = {} if result.cell is None else result.cell.sigma_px
    out = []
    for camera in dict.fromkeys(name for name, _ in residuals):
        sigma = stated.get(camera, result.sigma_px)
        values = np.concatenate([r.ravel() for name, r in residuals if name == camera])
        if not sigma or not len(values):
            continue
        edges = np.linspace(-_REACH * sigma, _REACH * sigma, BINS + 1)
        counts = np.histogram(np.clip(values, edges[0], edges[-1]), edges)[0].astype(np.float64)
        below = np.array([_below(e / sigma) for e in edges])
        below[0], below[-1] = 0.0, 1.0
        far = float(np.mean(np.abs(values) > _FAR * sigma))
        expected = len(values) * np.diff(below)
        out.append(NoiseHistogram(camera, sigma, edges, counts, expected, far, chi2_tail(1, _FAR**2)))
    return tuple(out)


def _below(z: float) -> float:
    """Of the standard normal distribution."""
    tail = 0.5 * chi2_tail(1, z * z)
    return tail if z < 0 else 1.0 - tail
