"""Depths come in steps (whole millimetres, 1/32 of a disparity), and rounding is no noise: it does not average out.

Rounding to steps h of values that scatter by s (noise, slope) leaves in their mean an error that depends on where
between two steps the truth lies. Over all such places its mean square is (Widrow and Kollar 2008, "Quantization noise",
ch. 4: the characteristic function at the multiples of 1 / h)

    b^2 = h^2 sum_k exp(-4 pi^2 k^2 (s / h)^2) / (2 pi^2 k^2)

h^2 / 12 for s = 0, and nothing to speak of from s = h / 2 on.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array

NEAR = 0.3
"""Of a distance: what is farther off is of another region, where disparities have other steps."""
_SAME_M = 1e-6
"""Metres: nearer depths are one and the same in single precision."""
_NOTHING = 1e-6
"""Of a step: less is none. The sum falls to 1e-160 where scatter is many steps, and weights of 1 / sigma^2 overflow."""
_TERMS = np.arange(1, 30)


def depth_step(depth: Array, around: float) -> float:
    """The least step between depths near `around`, metres; depths without steps give one of about a micrometre.

    >>> float(round(depth_step(np.array([0.218, 0.220, 0.221, 0.5, np.nan]), 0.22), 6))
    0.001
    """
    near = depth[np.abs(depth - around) <= NEAR * around]
    gaps = np.diff(np.unique(near))
    gaps = gaps[gaps > _SAME_M]
    return float(gaps.min()) if len(gaps) else 0.0


def rounding_error(step: float, scatter: float) -> float:
    """1 sigma of what rounding to a step leaves in a mean of values of that scatter, in the unit of both.

    >>> round(rounding_error(1.0, 0.0), 3), round(rounding_error(1.0, 0.2), 3), rounding_error(1.0, 0.5) < 0.002
    (0.286, 0.102, True)
    """
    if step <= 0:
        return 0.0
    k = _TERMS
    terms = np.exp(-4 * np.pi**2 * k**2 * (scatter / step) ** 2) / (2 * np.pi**2 * k**2)
    left = float(np.sqrt(terms.sum()))
    return step * left if left > _NOTHING else 0.0


def mean_rounding(depth: Array, inverse: Array, step: float | None = None) -> float:
    """1 sigma, 1/m, of what rounding leaves in the mean of inverse depths (n,) of one surface.

    They scattered, before they were rounded, by the square root of their variance less step^2 / 12.
    Args: depth: the whole picture, metres, from which the step is taken where it is not given, 1/m.
    """
    if not len(inverse):
        return 0.0
    middle = float(np.median(inverse))
    h = depth_step(depth, 1 / middle) * middle**2 if step is None else step
    return rounding_error(h, float(np.sqrt(max(float(np.var(inverse)) - h**2 / 12, 0.0))))
