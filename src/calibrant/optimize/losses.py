"""Robust losses: how much a residual of whitened norm r (in units of its sigma) costs, s = r^2.

    squared        rho(s) = s                                  weight 1
    Huber          s for s <= k^2, else 2 k sqrt(s) - k^2      weight min(1, k / r)
    Cauchy         k^2 log(1 + s / k^2)                        weight 1 / (1 + s / k^2)
    Geman-McClure  m s / (m + s), m = mu k^2                   weight (m / (m + s))^2

The solver minimises 1/2 sum rho(s) by iteratively reweighted Gauss-Newton steps: weight = d rho / d s is the exact
gradient's weight. Graduated non-convexity (Yang et al. 2020, "Graduated non-convexity for robust spatial perception")
starts Geman-McClure at a large mu, where it is convex over the data, and shrinks mu to 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError

SQUARED, HUBER, CAUCHY, GEMAN_MCCLURE = range(4)


@dataclass(frozen=True)
class Loss:
    """One of the losses of this module; build it with `squared`, `huber`, `cauchy`, `geman_mcclure`."""

    kind: int = SQUARED
    scale_sq: float = 1.0

    @property
    def is_plain(self) -> bool:
        """True for least squares: every residual has weight 1."""
        return self.kind == SQUARED

    def evaluate(self, s: Array) -> tuple[Array, Array]:
        """rho(s) and its derivative, the weight, of squared whitened norms s >= 0."""
        k2 = self.scale_sq
        if self.kind == HUBER:
            r = np.sqrt(np.maximum(s, k2))
            k = np.sqrt(k2)
            return np.where(s <= k2, s, 2 * k * r - k2), np.where(s <= k2, 1.0, k / r)
        if self.kind == CAUCHY:
            return k2 * np.log1p(s / k2), 1 / (1 + s / k2)
        if self.kind == GEMAN_MCCLURE:
            ratio = k2 / (k2 + s)
            return s * ratio, ratio * ratio
        return s, np.ones_like(s)


def squared() -> Loss:
    """Least squares."""
    return Loss()


def _scaled_loss(kind: int, k: float) -> Loss:
    if not (np.isfinite(k) and k > 0):
        raise InputError(f"a robust loss needs a scale above 0 (in sigmas), got {k}")
    return Loss(kind, float(k) ** 2)


def huber(k: float) -> Loss:
    """Quadratic within k sigmas, linear beyond."""
    return _scaled_loss(HUBER, k)


def cauchy(k: float) -> Loss:
    """Logarithmic beyond k sigmas."""
    return _scaled_loss(CAUCHY, k)


def geman_mcclure(k: float, *, mu: float = 1.0) -> Loss:
    """Bounded: a gross error costs at most mu k^2 and pulls no more."""
    return Loss(GEMAN_MCCLURE, _scaled_loss(GEMAN_MCCLURE, k).scale_sq * mu)
