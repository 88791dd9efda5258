"""Which points and views do not belong to the rest, and the words for it.

For two-dimensional Gaussian noise the norm of a residual is Rayleigh distributed: its median is 1.1774 sigma and
P(norm > k sigma) = exp(-k^2 / 2). The limit k is where a clean data set of N points would lose 0.01 points on average,
and never below 6, because detectors' errors have heavier tails than the Gaussian and a point at 6 sigma does no harm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array

CAUCHY_SCALE_SIGMAS = 2.385
"""95 % efficiency on Gaussian noise (Zhang 1997, "Parameter estimation techniques", table 1)."""
MINIMUM_POINTS = 4
"""Points of a view that determine the pose of a plane."""
RAYLEIGH_MEDIAN = np.sqrt(2 * np.log(2))
MINIMUM_LIMIT_SIGMAS = 6.0
EXPECTED_FALSE_POINTS = 0.01


@dataclass(frozen=True, eq=False)
class Marked:
    """keep (N,) points; drop_view (m,) views that do not fit as a whole; sigma, limit in pixels, residual norm."""

    keep: NDArray[np.bool_]
    drop_view: NDArray[np.bool_]
    sigma_px: float
    limit_px: float


def median(values: Array) -> float:
    """np.median (n,) without its checks, which take longer than the median of an ordinary calibration."""
    middle = len(values) // 2
    if len(values) % 2:
        return float(np.partition(values, middle)[middle])
    return float(0.5 * np.partition(values, [middle - 1, middle])[middle - 1 : middle + 1].sum())


def mark(norms: Array, offsets: NDArray[np.int64], *, max_error_px: float | None = None) -> Marked:
    """Judge residual norms (N,), pixels, of views laid end to end.

    A view goes as a whole when more than half of its points are outliers: a misread board, or one that moved.
    max_error_px lowers the limit to the user's own.
    """
    sigma = median(norms) / RAYLEIGH_MEDIAN
    limit = sigma * max(MINIMUM_LIMIT_SIGMAS, np.sqrt(2 * np.log(len(norms) / EXPECTED_FALSE_POINTS)))
    # Noise-free data have residuals of rounding, whose distribution means nothing: 1e-6 px is below any detector.
    limit = max(limit, 1e-6)
    if max_error_px is not None:
        limit = min(limit, max_error_px)
    keep = norms <= limit
    bad = np.add.reduceat((~keep).astype(np.int64), offsets[:-1])
    drop_view = bad > 0.5 * np.diff(offsets)
    return Marked(keep & ~np.repeat(drop_view, np.diff(offsets)), drop_view, sigma, float(limit))


def points_reason(left_out: int, total: int, limit_px: float) -> str:
    """Words for points left out of a view."""
    return f"{left_out} of {total} points left out: residual above {limit_px:.2g} px"


def view_reason(points: int, typical_px: float) -> str:
    """Words for a view left out as a whole."""
    return (
        f"most of its {points} points do not fit the other views (which have {typical_px:.2g} px rms); "
        "the board was misread, or moved while the picture was taken"
    )
