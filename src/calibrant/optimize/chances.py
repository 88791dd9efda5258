"""Chances of the F, t and chi-square distributions, from the incomplete beta and gamma functions.

    I_x(a, b) = x^a (1 - x)^b / (a B(a, b)) * 1 / (1 + d_1 / (1 + d_2 / (1 + ...))),
    d_2m = m (b - m) x / ((a + 2m - 1)(a + 2m)),   d_2m+1 = -(a + m)(a + b + m) x / ((a + 2m)(a + 2m + 1))

converges in O(sqrt(max(a, b))) terms for x < (a + 1) / (a + b + 2), and elsewhere by I_x(a, b) = 1 - I_1-x(b, a)
(Abramowitz and Stegun 1964, 26.5.8; evaluated by the method of Lentz 1976 as modified by Thompson and Barnett 1986).
The gamma function's is the series x^a e^-x / Gamma(a + 1) (1 + x / (a + 1) + ...) below x = a + 1, and above it the
fraction 6.5.31 of the same book.

scipy.special has the same, and takes as long to load as the calibration of twenty poses takes.
"""

from __future__ import annotations

from math import exp, inf, lgamma, log, sqrt

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array

MAXWELL_MEDIAN = 1.5382
"""Median of the norm of a three-dimensional Gaussian vector, in sigmas."""
CHI2_6_MEDIAN = 5.348
"""Median of chi-square with 6 degrees of freedom."""
CHI2_6_LIMIT = 27.86
"""chi-square of 6 degrees of freedom at P = 1e-4: in a thousand views, 0.1 would be left out by chance."""
NORMAL_95 = 1.959964
"""What a normal variable stays within, in sigmas, with 95 %."""
TERMS = 2000
"""Far beyond what a and b of a million need."""
_TINY = 1e-300
_SETTLED = 1e-15


def f_tail(numerator: float, denominator: float, F: ArrayLike) -> Array:
    """P(F' > F) of the F distribution with these degrees of freedom, both above 0. Args: F (...), >= 0."""
    value = np.asarray(F, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        x = np.where(np.isposinf(value), 0.0, denominator / (denominator + numerator * value))
        y = np.where(np.isposinf(value), 1.0, numerator * value / (denominator + numerator * value))
    return _incomplete_beta(denominator / 2, numerator / 2, x, y)


def share_tail(explained: float, squares: float, *, unknowns: int, freedom: float, least: float = 0.0) -> float:
    """Chance that so many unknowns explain as much, or more, of the squares by luck: the F distribution's tail of

        F = (Q / q) / max((R - Q) / (D - q), s^2).

    Args: explained, Q; squares, R >= Q; unknowns, q; freedom, D > q, of the squares; least, s^2, a variance that is
    known to be noise, below which what is left never lies (what is left within R's rounding is rounding).

    >>> round(share_tail(8.0, 10.0, unknowns=2, freedom=6.0), 4)
    0.04
    """
    rest = max(squares - explained, np.finfo(float).eps * squares, np.finfo(float).tiny) / (freedom - unknowns)
    return float(f_tail(unknowns, freedom - unknowns, explained / unknowns / max(rest, least)))


def t_tail(freedom: float, t: ArrayLike) -> Array:
    """P(T > t) of Student's distribution. Args: t (...), >= 0."""
    return 0.5 * f_tail(1.0, freedom, np.square(np.asarray(t, dtype=np.float64)))


def chi2_tail(freedom: float, value: float) -> float:
    """P(chi-square > value) with these degrees of freedom. Args: value >= 0."""
    a, x = freedom / 2, value / 2
    if x <= 0:
        return 1.0
    if x == inf:
        return 0.0
    front = exp(a * log(x) - x - lgamma(a))
    terms = TERMS + int(10 * sqrt(a))
    if x < a + 1:
        term = total = 1 / a
        for k in range(1, terms):
            term *= x / (a + k)
            total += term
            if term < _SETTLED * total:
                break
        return 1 - front * total
    b, c = x + 1 - a, 1 / _TINY
    d = h = 1 / b
    for k in range(1, terms):
        b += 2
        d = 1 / (k * (a - k) * d + b)
        c = b + k * (a - k) / c
        h *= c * d
        if abs(c * d - 1) < _SETTLED:
            break
    return front * h


def _incomplete_beta(a: float, b: float, x: Array, y: Array) -> Array:
    """I_x(a, b) with y = 1 - x, given apart because it may be small."""
    flat_x, flat_y = x.reshape(-1), y.reshape(-1)
    swap = flat_x > (a + 1) / (a + b + 2)
    out = np.empty_like(flat_x)
    out[~swap] = _lower(a, b, flat_x[~swap], flat_y[~swap])
    out[swap] = 1 - _lower(b, a, flat_y[swap], flat_x[swap])
    return out.reshape(x.shape)


def _lower(a: float, b: float, x: Array, y: Array) -> Array:
    """The continued fraction and what stands before it, where it converges fast."""
    if len(x) == 0:
        return x
    with np.errstate(divide="ignore"):
        log_front = a * np.log(x) + b * np.log(y) + lgamma(a + b) - lgamma(a) - lgamma(b) - np.log(a)
    c, d = np.ones_like(x), _above(1 - (a + b) * x / (a + 1))
    d = 1 / d
    h = d.copy()
    for m in range(1, TERMS):
        for term in (
            m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            d = 1 / _above(1 + term * d)
            c = _above(1 + term / c)
            change = c * d
            h *= change
        if np.all(np.abs(change - 1) < _SETTLED):
            break
    return np.exp(log_front) * h


def _above(value: Array) -> Array:
    """The value, kept off zero, by which the next step divides."""
    return np.where(np.abs(value) < _TINY, _TINY, value)


def t_interval(freedom: float) -> float:
    """t that |T| stays below with 95 %, Student's distribution with these degrees of freedom, 2 or more, to 1 %.

    The expansion by 1 / freedom about the normal distribution's 1.96 (Abramowitz and Stegun 1964, 26.7.5).

    >>> round(t_interval(10), 3)
    2.228
    """
    x, n = NORMAL_95, freedom
    terms = (
        (x**3 + x) / 4,
        (5 * x**5 + 16 * x**3 + 3 * x) / 96,
        (3 * x**7 + 19 * x**5 + 17 * x**3 - 15 * x) / 384,
        (79 * x**9 + 776 * x**7 + 1482 * x**5 - 1920 * x**3 - 945 * x) / 92160,
    )
    return x + sum(term / n ** (k + 1) for k, term in enumerate(terms))
