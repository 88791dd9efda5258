"""The step of an edge under a Gaussian blur, and its slope, as polynomials: what every fit to grey values evaluates.

erf(t) / t and exp(-t^2) are smooth in t^2; Chebyshev's approximation of them over the steep part of an edge takes a
dozen multiplications and no branch, so that a loop over pixels computes several at once.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.polynomial import Polynomial
from numpy.polynomial.chebyshev import Chebyshev

LIMIT = 2.5
"""Over 3.5 standard deviations of blur: beyond it a step is flat to one part in 2400, and is taken for flat."""
NODES = 0.5 + 0.5 * np.cos(np.pi * (np.arange(64) + 0.5) / 64)


def _coefficients(values: list[float], degree: int) -> tuple[float, ...]:
    """Of the powers of (t / LIMIT)^2, from a function's values at the nodes; good to 3e-6 at the degrees used here."""
    series = Chebyshev.fit(NODES, values, degree, domain=[0.0, 1.0])
    return tuple(float(c) for c in series.convert(kind=Polynomial).coef)


_T = LIMIT * np.sqrt(NODES)
S0, S1, S2, S3, S4, S5, S6, S7, S8 = _coefficients([math.erf(t) / t for t in _T], 8)
B0, B1, B2, B3, B4, B5, B6, B7, B8, B9 = _coefficients([math.exp(-(t**2)) for t in _T], 9)


@njit(inline="always")
def step_and_bell(t):  # type: ignore[no-untyped-def]
    """erf(t) and exp(-t^2). Without `**`, for callers that may reorder: calibrant.compiled says why."""
    inside = abs(t) < LIMIT
    t = t if t < LIMIT else LIMIT
    t = t if t > -LIMIT else -LIMIT
    x = t * t * (1.0 / (LIMIT * LIMIT))
    step = t * (S0 + x * (S1 + x * (S2 + x * (S3 + x * (S4 + x * (S5 + x * (S6 + x * (S7 + x * S8))))))))
    low = B0 + x * (B1 + x * (B2 + x * (B3 + x * B4)))
    fifth = x * x * x * x * x
    bell = low + fifth * (B5 + x * (B6 + x * (B7 + x * (B8 + x * B9))))
    return step, bell if inside else 0.0
