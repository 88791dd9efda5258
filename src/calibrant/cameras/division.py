"""Division model: the ray of an undistorted direction divided by a polynomial of the distorted radius; l1 l2 l3.

    m = ((u - cx)/fx, (v - cy)/fy), s = |m|^2:  ray ~ (m_x, m_y, w(s)),  w = 1 + l1 s + l2 s^2 + l3 s^3

Rays come in closed form; projecting solves S Z = w(S^2 R2) for m = S (X, Y). With l1 alone it is Fitzgibbon 2001,
"Simultaneous linear estimation of multiple view geometry and lens distortion"; w may pass through 0, beyond which the
model looks backwards (Scaramuzza 2006 and BabelCalib use it so).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.cameras.model import finite_points
from calibrant.cameras.plane_distortion import first_positive_root
from calibrant.cameras.radial import Radial, Shape, ray

_ITERATIONS = 200


class Division(Radial):
    """Undistortion-ward radial model for perspective and fisheye lenses."""

    name: str = "division"
    parameter_names: tuple[str, ...] = ("fx", "fy", "cx", "cy", "l1", "l2", "l3")
    parameter_units: tuple[str, ...] = ("px",) * 4 + ("1",) * 3
    summary: str = "wide lenses when rays are needed fast: pixel to ray without iteration"

    def shape(self, terms: Array, R2: Array, z: Array) -> Shape:
        S = _scale(terms, R2, z)
        s = S * S * R2
        slope = _w_slope(terms, s)
        F = z - 2 * S * R2 * slope
        return Shape(S, 2 * S * S * slope / F, -S / F, (s / F, s * s / F, s**3 / F))

    def lift(self, terms: Array, mx: Array, my: Array) -> Array:
        s = mx * mx + my * my
        return ray(mx, my, _w(terms, s), s < _radius_limit(terms))

    def sees(self, parameters: ArrayLike, p_camera: ArrayLike) -> Mask:
        p = finite_points(p_camera)
        terms = np.asarray(parameters, dtype=np.float64)[4:]
        R = np.hypot(p[..., 0], p[..., 1])
        limit = _radius_limit(terms)
        if np.isfinite(limit):
            # Angles grow up to the limit: the last ray seen is (sqrt(limit), w(limit)).
            return p[..., 2] * np.sqrt(limit) > R * _w(terms, np.asarray(limit))
        return (p[..., 2] > 0) | ((R > 0) & bool(np.any(terms < 0)))

    def field_limit(self, parameters: Array) -> float:
        return float(np.sqrt(_radius_limit(parameters[4:])))

    def rows(self) -> Any:
        from calibrant.cameras.kernels.division_rows import rows

        return rows


def _w(terms: Array, s: Array) -> Array:
    return 1 + s * (terms[0] + s * (terms[1] + s * terms[2]))


def _w_slope(terms: Array, s: Array) -> Array:
    return terms[0] + s * (2 * terms[1] + s * 3 * terms[2])


def _radius_limit(terms: Array) -> float:
    """s where the ray's angle stops growing with the radius: w - 2 s w' = 0."""
    return first_positive_root(np.array([1.0, -terms[0], -3 * terms[1], -5 * terms[2]]))


def _scale(terms: Array, R2: Array, z: Array) -> Array:
    """S > 0 with S Z = w(S^2 R2), before the limit: Newton's method within its bracket, on S |p|."""
    norm = np.sqrt(R2 + z * z)
    c, q = z / norm, R2 / norm**2  # cosine and squared sine of the angle from the axis
    low = np.zeros_like(c)
    limit = _radius_limit(terms)
    high = np.sqrt(limit / np.maximum(q, 1e-300)) if np.isfinite(limit) else np.full_like(c, 1.0)
    high = np.minimum(high, 1e9)
    if not np.isfinite(limit):
        for _ in range(40):
            short = high * c - _w(terms, high * high * q) < 0
            if not short.any():
                break
            high = np.where(short, 2 * high, high)
    x = np.minimum(2 / (c + np.sqrt(np.maximum(c * c - 4 * terms[0] * q, 1e-12))), high)
    for _ in range(_ITERATIONS):
        error = x * c - _w(terms, x * x * q)
        low, high = np.where(error < 0, x, low), np.where(error < 0, high, x)
        trial = x - error / (c - 2 * x * q * _w_slope(terms, x * x * q))
        moved = np.where((trial >= low) & (trial <= high), trial, 0.5 * (low + high))
        if not np.any(np.abs(moved - x) > 1e-15 * x):
            break
        x = moved
    return x / norm
