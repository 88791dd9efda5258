"""Kannala and Brandt's fisheye with four terms, OpenCV's `fisheye`: k1 k2 k3 k4.

    theta = atan2(R, Z),  theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)
    u = fx theta_d X/R + cx,  v = fy theta_d Y/R + cy

OpenCV takes atan(R/Z) and stops at 90 degrees; atan2 sees on to where theta_d stops growing. Source: Kannala and Brandt
2006, "A generic camera model and calibration method for conventional, wide-angle, and fish-eye lenses", eq. 6.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.cameras.model import finite_points
from calibrant.cameras.plane_distortion import first_positive_root
from calibrant.cameras.radial import Radial, Shape, ray

_ITERATIONS = 100
_NEAR_AXIS = 1e-4
"""Below this R/Z the slope of S is a difference of nearly equal numbers; its series is exact to (R/Z)^2 = 1e-8, and it
enters multiplied by R^2 once more."""


class KannalaBrandt(Radial):
    """Image radius as an odd polynomial of the angle from the axis."""

    name: str = "kannala_brandt"
    parameter_names: tuple[str, ...] = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
    parameter_units: tuple[str, ...] = ("px",) * 4 + ("1",) * 4
    summary: str = "fisheye lenses from 80 to 200 degrees (OpenCV's fisheye)"

    def shape(self, terms: Array, R2: Array, z: Array) -> Shape:
        R = np.sqrt(R2)
        near = _NEAR_AXIS * z > R
        on_axis = R == 0
        iR = 1.0 / np.where(on_axis, 1.0, R)
        theta = np.arctan2(R, z)
        t = theta * theta
        plain = np.where(on_axis, 1.0 / np.where(on_axis, z, 1.0), theta * iR)
        S, slope = plain * _polynomial(terms, t), _slope(terms, t)
        rho2 = R2 + z * z
        T = np.where(near, (2 * terms[0] - 2 / 3) / z**3, (slope * z / rho2 - S) * iR * iR)
        by_terms = tuple(plain * t ** (n + 1) for n in range(4))
        return Shape(S, T, -slope / rho2, by_terms)

    def lift(self, terms: Array, mx: Array, my: Array) -> Array:
        rd = np.hypot(mx, my)
        limit = _angle_limit(terms)
        theta = _angle(terms, rd, limit)
        good = np.abs(theta * _polynomial(terms, theta * theta) - rd) < 1e-12 * (1 + rd)
        s = np.where(rd > 0, np.sin(theta) / np.where(rd > 0, rd, 1.0), 1.0)
        return ray(s * mx, s * my, np.cos(theta), good)

    def sees(self, parameters: ArrayLike, p_camera: ArrayLike) -> Mask:
        p = finite_points(p_camera)
        return (p[..., 2] > 0) | (np.abs(p[..., 0]) > 0) | (np.abs(p[..., 1]) > 0)

    def field_limit(self, parameters: Array) -> float:
        return _angle_limit(parameters[4:])

    def inside(self, parameters: Array, p: Array) -> Mask:
        return np.arctan2(np.hypot(p[..., 0], p[..., 1]), p[..., 2]) < self.field_limit(parameters)

    def rows(self) -> Any:
        from calibrant.cameras.kernels.kannala_brandt_rows import rows

        return rows

    def rays(self) -> Any:
        from calibrant.cameras.kernels.kannala_brandt_rays import rays

        return rays


def _polynomial(k: Array, t: Array) -> Array:
    return 1 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3])))


def _slope(k: Array, t: Array) -> Array:
    """d theta_d / d theta."""
    return 1 + t * (3 * k[0] + t * (5 * k[1] + t * (7 * k[2] + t * 9 * k[3])))


def _angle_limit(k: Array) -> float:
    """Angle where theta_d stops growing, pi at most."""
    root = first_positive_root(np.array([1.0, 3 * k[0], 5 * k[1], 7 * k[2], 9 * k[3]]))
    return float(min(np.sqrt(root), np.pi))


def _angle(k: Array, rd: Array, limit: float) -> Array:
    """theta in [0, limit] with theta_d = rd: Newton's method within its bracket; `limit` where rd is beyond it."""
    low, high = np.zeros_like(rd), np.full_like(rd, limit)
    theta = np.minimum(rd, limit)
    for _ in range(_ITERATIONS):
        t = theta * theta
        error = theta * _polynomial(k, t) - rd
        low, high = np.where(error < 0, theta, low), np.where(error < 0, high, theta)
        trial = theta - error / _slope(k, t)
        moved = np.where((trial >= low) & (trial <= high), trial, 0.5 * (low + high))
        if not np.any(np.abs(moved - theta) > 1e-15):
            break
        theta = moved
    return theta
