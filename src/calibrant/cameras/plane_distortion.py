"""Distortion within the image plane: OpenCV's fourteen terms, of which most models use the first few.

    x, y ideal, r2 = x^2 + y^2, g = (1 + k1 r2 + k2 r2^2 + k3 r2^3) / (1 + k4 r2 + k5 r2^2 + k6 r2^3)
    x' = x g + 2 p1 x y + p2 (r2 + 2 x^2) + s1 r2 + s2 r2^2
    y' = y g + p1 (r2 + 2 y^2) + 2 p2 x y + s3 r2 + s4 r2^2
    (x'', y'', 1) ~ M (x', y', 1),  M the homography of a sensor tilted by tx, ty

Order of the terms: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tx ty (OpenCV 4 manual, "Camera Calibration and 3D
Reconstruction"; Louhichi et al. 2007 for the tilt).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.arrays import Array

TERMS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tx", "ty")
_NUMERATOR, _DENOMINATOR = [0, 1, 4], [5, 6, 7]
_ITERATIONS = 100


class Plane(NamedTuple):
    """Distorted coordinates and their derivatives by the ideal ones."""

    x: Array
    y: Array
    xx: Array
    xy: Array
    yx: Array
    yy: Array


def padded(terms: Array) -> Array:
    """All fourteen terms (14,), those that a model does not have being 0."""
    out = np.zeros(len(TERMS))
    out[: len(terms)] = terms
    return out


def distort(terms: Array, x: Array, y: Array) -> Plane:
    """Distorted coordinates x'', y'' and derivatives. terms (14,)."""
    p1, p2, s1, s2, s3, s4 = terms[[2, 3, 8, 9, 10, 11]]
    r2 = x * x + y * y
    g, h, _ = _radial(terms, r2)
    q1, q3 = 2 * (s1 + 2 * s2 * r2), 2 * (s3 + 2 * s4 * r2)
    plane = Plane(
        x * g + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) + r2 * (s1 + s2 * r2),
        y * g + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y + r2 * (s3 + s4 * r2),
        g + 2 * h * x * x + 2 * p1 * y + 6 * p2 * x + q1 * x,
        2 * h * x * y + 2 * p1 * x + 2 * p2 * y + q1 * y,
        2 * h * x * y + 2 * p1 * x + 2 * p2 * y + q3 * x,
        g + 2 * h * y * y + 6 * p1 * y + 2 * p2 * x + q3 * y,
    )
    if terms[12] == 0 and terms[13] == 0:
        return plane
    M, _, _ = tilt(terms[12], terms[13])
    u, v, E = _tilted(M, plane.x, plane.y)
    return Plane(
        u,
        v,
        E[0] * plane.xx + E[1] * plane.yx,
        E[0] * plane.xy + E[1] * plane.yy,
        E[2] * plane.xx + E[3] * plane.yx,
        E[2] * plane.xy + E[3] * plane.yy,
    )


def term_columns(terms: Array, count: int, x: Array, y: Array) -> Array:
    """Derivatives (..., 2, count) of x'', y'' by the first `count` terms."""
    r2 = x * x + y * y
    g, _, D = _radial(terms, r2)
    zero = np.zeros_like(x)
    radial = [r2 / D, r2**2 / D, r2**3 / D, -g * r2 / D, -g * r2**2 / D, -g * r2**3 / D]
    columns = [
        (x * radial[0], y * radial[0]),
        (x * radial[1], y * radial[1]),
        (2 * x * y, r2 + 2 * y * y),
        (r2 + 2 * x * x, 2 * x * y),
        *((x * c, y * c) for c in radial[2:]),
        (r2, zero),
        (r2 * r2, zero),
        (zero, r2),
        (zero, r2 * r2),
    ]
    J = np.stack([np.stack(c, axis=-1) for c in columns[:count]], axis=-1)
    if count <= 12:
        return J
    flat = terms.copy()
    flat[12:] = 0
    plane = distort(flat, x, y)
    M, by_tx, by_ty = tilt(terms[12], terms[13])
    u, v, E = _tilted(M, plane.x, plane.y)
    J = np.stack([np.stack(E[:2], axis=-1), np.stack(E[2:], axis=-1)], axis=-2) @ J
    w = M[2, 0] * plane.x + M[2, 1] * plane.y + M[2, 2]
    tilts = []
    for d in (by_tx, by_ty):
        a, b, c = (d[i, 0] * plane.x + d[i, 1] * plane.y + d[i, 2] for i in range(3))
        tilts.append(np.stack([(a - u * c) / w, (b - v * c) / w], axis=-1))
    return np.concatenate([J, np.stack(tilts, axis=-1)], axis=-1)


def tilt(tx: float, ty: float) -> tuple[Array, Array, Array]:
    """Homography (3, 3) of a sensor turned by tx about x, then ty about y, with its derivatives.

    R = Ry(ty) Rx(tx), M = [[R33, 0, -R13], [0, R33, -R23], [0, 0, 1]] R, multiplied out.
    """
    s, c, S, C = np.sin(tx), np.cos(tx), np.sin(ty), np.cos(ty)
    M = np.array([[c, 0, 0], [-s * S, C, 0], [S, -C * s, C * c]])
    by_tx = np.array([[-s, 0, 0], [-c * S, 0, 0], [0, -C * c, -C * s]])
    by_ty = np.array([[0, 0, 0], [-s * C, -S, 0], [C, S * s, -S * c]])
    return M, by_tx, by_ty


def _tilted(M: Array, x: Array, y: Array) -> tuple[Array, Array, tuple[Array, Array, Array, Array]]:
    """Coordinates after the tilt and their derivatives uu, uv, vu, vv by those before it."""
    w = M[2, 0] * x + M[2, 1] * y + M[2, 2]
    u, v = M[0, 0] * x / w, (M[1, 0] * x + M[1, 1] * y) / w
    return (
        u,
        v,
        ((M[0, 0] - u * M[2, 0]) / w, -u * M[2, 1] / w, (M[1, 0] - v * M[2, 0]) / w, (M[1, 1] - v * M[2, 1]) / w),
    )


def _radial(terms: Array, r2: Array) -> tuple[Array, Array, Array]:
    """g, dg / d r2 and the denominator."""
    k1, k2, k3 = terms[_NUMERATOR]
    k4, k5, k6 = terms[_DENOMINATOR]
    D = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    g = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / D
    h = (k1 + r2 * (2 * k2 + 3 * r2 * k3) - g * (k4 + r2 * (2 * k5 + 3 * r2 * k6))) / D
    return g, h, D


def radius_limit(terms: Array) -> float:
    """Radius of the disc on which the distortion is one to one; inf when nothing bounds it.

    The radial part has the slopes g across and d(r g)/dr along the radius; decentering and prism terms add a matrix of
    norm 6 |p| r + 2 |s13| r + 4 |s24| r^3 at most. While both slopes exceed that, the Jacobian is positive definite,
    and a map that is so on a convex region is one to one. Without these terms it is the fold itself.
    """
    return _limit(tuple(np.asarray(terms, dtype=np.float64).tolist()))


@lru_cache(maxsize=256)
def _limit(numbers: tuple[float, ...]) -> float:
    """`radius_limit` of these terms; a lens is asked for it with every view."""
    terms = np.array(numbers)
    r = np.polynomial.Polynomial([0.0, 1.0])
    even = r * r
    N = np.polynomial.Polynomial([1.0, *terms[_NUMERATOR]])
    D = np.polynomial.Polynomial([1.0, *terms[_DENOMINATOR]])
    slope = N * D + 2 * r * (N.deriv() * D - N * D.deriv())
    by_r = 6 * np.hypot(terms[2], terms[3]) + 2 * np.hypot(terms[8], terms[10])
    by_r3 = 4 * np.hypot(terms[9], terms[11])
    if by_r == 0 and by_r3 == 0:
        return float(np.sqrt(min(first_positive_root(p.coef) for p in (slope, N, D))))
    other = by_r * r + by_r3 * r**3
    bounds = (slope(even) - other * D(even) ** 2, N(even) - other * D(even), D(even))
    return min(first_positive_root(p.coef) for p in bounds)


def first_positive_root(coefficients: ArrayLike) -> float:
    """Smallest positive real root of a polynomial with rising coefficients, inf when there is none."""
    c = np.asarray(coefficients, dtype=np.float64)
    # Next to nothing at the end puts roots beyond all radii, and the quotients that lead to them beyond all numbers.
    c = np.trim_zeros(np.where(np.abs(c) > 1e-200 * np.abs(c).max(initial=0.0), c, 0.0), "b")
    if len(c) < 2:
        return np.inf
    roots = np.polynomial.polynomial.polyroots(c)
    # A double root comes out as a pair with imaginary parts of the root of the rounding.
    real = roots.real[(np.abs(roots.imag) < 1e-7 * np.abs(roots)) & (roots.real > 0)]
    return float(real.min()) if len(real) else np.inf


def undistort(terms: Array, xd: Array, yd: Array) -> tuple[Array, Array]:
    """Ideal x, y whose distorted coordinates are xd, yd; NaN where there are none before the fold.

    The radial part is inverted within its bracket, which cannot fail; a damped Newton iteration adds the rest.
    """
    limit = radius_limit(terms)
    u, v = xd, yd
    with np.errstate(all="ignore"):
        if terms[12] or terms[13]:
            M, _, _ = tilt(terms[12], terms[13])
            a, b, w = np.moveaxis(np.stack([xd, yd, np.ones_like(xd)], axis=-1) @ np.linalg.inv(M).T, -1, 0)
            u, v = np.where(w > 0, a / w, np.nan), b / w
        rd = np.hypot(u, v)
        r = _radial_inverse(terms, rd, limit)
        scale = np.where(rd > 0, r / np.where(rd > 0, rd, 1.0), 1.0)
        x, y, good = solve_plane(lambda a, b: distort(terms, a, b), xd, yd, u * scale, v * scale)
        good &= np.hypot(x, y) < limit
    return np.where(good, x, np.nan), np.where(good, y, np.nan)


def _radial_inverse(terms: Array, rd: Array, limit: float) -> Array:
    """r with r g(r^2) = rd by Newton's method, kept in its bracket by bisection; just below `limit` where beyond it."""
    low = np.zeros_like(rd)
    high = np.full_like(rd, 0.9999 * limit)
    if not np.isfinite(limit):
        high = 2 * rd + 1
        for _ in range(30):  # 2^30 is past every pixel of a perspective camera
            short = high * _radial(terms, high * high)[0] < rd
            if not short.any():
                break
            high = np.where(short, 2 * high, high)
    r = np.minimum(rd, high)
    for _ in range(_ITERATIONS):
        g, h, _ = _radial(terms, r * r)
        error = r * g - rd
        low, high = np.where(error < 0, r, low), np.where(error < 0, high, r)
        trial = r - error / (g + 2 * r * r * h)
        inside = (trial >= low) & (trial <= high)
        moved = np.where(inside, trial, 0.5 * (low + high))
        if not np.any(np.abs(moved - r) > 1e-12 * (1 + r)):
            break
        r = moved
    return r


def solve_plane(
    evaluate: Callable[[Array, Array], Plane], xd: Array, yd: Array, x: Array, y: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """x, y with evaluate(x, y) = xd, yd by damped Newton steps from x, y, and where they arrived, not mirrored."""
    at = evaluate(x, y)
    error = np.hypot(at.x - xd, at.y - yd)
    share = np.ones_like(error)
    for _ in range(_ITERATIONS):
        det = at.xx * at.yy - at.xy * at.yx
        ex, ey = at.x - xd, at.y - yd
        dx, dy = (at.yy * ex - at.xy * ey) / det, (at.xx * ey - at.yx * ex) / det
        nx, ny = x - share * dx, y - share * dy
        trial = evaluate(nx, ny)
        new = np.hypot(trial.x - xd, trial.y - yd)
        better = new < error
        x, y, error = np.where(better, nx, x), np.where(better, ny, y), np.where(better, new, error)
        at = Plane(*(np.where(better, n, o) for n, o in zip(trial, at)))
        share = np.where(better, np.minimum(1.0, 4 * share), 0.25 * share)
        if not np.any((error > 1e-16) & (share > 1e-6)):
            break
    # A pixel is resolved to 1e-12 of the focal length, 1e-9 px: rounding of the polynomial is a thousand times less.
    good = (error < 1e-12 * (1 + np.hypot(xd, yd))) & (at.xx * at.yy - at.xy * at.yx > 0)
    return x, y, good
