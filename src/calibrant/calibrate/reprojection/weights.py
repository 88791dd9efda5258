"""How much each point weighs: the detector's own sigma, and what the detector cannot know.

A detector's sigma speaks of grey-level noise. Boards that are not flat, lenses that the model does not follow and blur
add an error of their own, the same for all points: var_i = s_0^2 + s_i^2. The excess s_0 is found from the residuals of
a first fit, so that it is 0 where the detector's word suffices and dominates where it does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.data import View


def excess_sigma(squares: Array, sigma: Array, *, freedom: float) -> float:
    """s_0 >= 0 with sum_i squares_i / (s_0^2 + s_i^2) = freedom; 0 when the sigmas explain the residuals already.

    Args: squares (N,) squared residual norms, px^2; sigma (N,) stated per axis, px; freedom: number of scalar residuals
    minus unknowns. Medians would be robust, but the points that do not belong have been left out before.
    """

    def surplus(variance: float) -> float:
        return float(np.sum(squares / (variance + sigma**2))) - freedom

    if surplus(0.0) <= 0:
        return 0.0
    low, high = 0.0, float(squares.sum() / freedom)
    for _ in range(60):  # bisection: 60 halvings reach rounding
        middle = 0.5 * (low + high)
        low, high = (middle, high) if surplus(middle) > 0 else (low, middle)
    return float(np.sqrt(high))


def reweighted(views: Sequence[View], squares: Array, *, unknowns: int) -> tuple[View, ...]:
    """The views with sigma_px, and covariance_px where it is stated, completed by the excess, which is the same to all
    sides; as they are when no view states a sigma.

    Args: squares (N,) squared residual norms of all points, in order, px^2.
    """
    return completed(views, squares, keep=np.ones(len(squares), dtype=bool), unknowns=unknowns)


def completed(views: Sequence[View], squares: Array, *, keep: NDArray[np.bool_], unknowns: int) -> tuple[View, ...]:
    """As `reweighted`, with the excess taken from the points where keep (N,) is true: the others do not belong."""
    if not any(v.sigma_px is not None for v in views):
        return tuple(views)
    stated = np.concatenate([np.zeros(len(v)) if v.sigma_px is None else v.sigma_px for v in views])
    freedom = max(2.0 * keep.sum() - unknowns, 1.0)
    excess = excess_sigma(squares[keep], np.maximum(stated[keep], 1e-6), freedom=freedom)
    variance = excess**2 + stated**2
    ends = np.cumsum([len(v) for v in views])[:-1]
    parts = np.split(np.sqrt(np.maximum(variance, 1e-18)), ends)
    return tuple(
        replace(v, sigma_px=s)
        if v.covariance_px is None
        else replace(v, sigma_px=None, covariance_px=v.covariance_px + excess**2 * np.eye(2))
        for v, s in zip(views, parts)
    )
