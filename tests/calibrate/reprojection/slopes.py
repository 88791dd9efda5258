"""The slopes that a factor states, against central differences of its residuals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.geometry import se3
from calibrant.optimize.factors import Factor


def check_slopes(factor: Factor, values: Sequence[np.ndarray]) -> None:
    """Residuals of `linearize` are those of `residuals`, and its Jacobians their slopes, slot by slot."""
    r, jacobians = factor.linearize(*values)
    np.testing.assert_allclose(factor.residuals(*values), r, atol=1e-9)
    for slot, J in enumerate(jacobians):
        pose = values[slot].ndim == 3
        for column in range(J.shape[-1]):
            scale = 1.0 if pose else max(1.0, float(np.abs(values[slot][0, column])))
            step = np.zeros(J.shape[-1])
            step[column] = h = 1e-6 * scale
            moved = []
            for sign in (1, -1):
                v = list(values)
                v[slot] = se3.retract(v[slot], sign * step) if pose else v[slot] + sign * step
                moved.append(factor.residuals(*v))
            # 1e3 pixels round to 1e-13: 1e-7 after the division; truncation is h^2 times third derivatives.
            np.testing.assert_allclose((moved[0] - moved[1]) / (2 * h), J[..., column], rtol=2e-6, atol=2e-5)
