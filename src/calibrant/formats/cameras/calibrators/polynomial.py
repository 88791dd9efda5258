"""Scaramuzza's polynomial lens, OCamCalib's and CamOdoCal's: read as the nearest camera, and said by how much; and the
nearest polynomial to a camera, for writing.

    (p, q) = A (x, y) + centre,  rho = |(x, y)|,  ray = (x, y, a0 + a1 rho + a2 rho^2 + ...)
    rho = b0 + b1 theta + b2 theta^2 + ...,  theta = atan((a0 + a1 rho + ...) / rho)

The polynomial's side that the image's middle looks to is ahead. Fitted are a0, a2, …, aN and b0, …, bM of the lowest
degrees that err by less than corners are found to; a1 = 0, as OCamCalib has it. Source: Scaramuzza, Martinelli and
Siegwart 2006, "A toolbox for easily calibrating omnidirectional cameras"; OCamCalib's undistortFunctions (cam2world,
world2cam).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.cameras.approximation.nearest import GRID
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import Size
from calibrant.formats.cameras.foreign_lens import nearest_by_rays

_NEAR_ENOUGH_PX = 0.01
"""Below what corners are found to."""
_DEGREES = range(4, 13)
"""OCamCalib's own is 4; a longer one than the twelfth swings between the points that it is fitted to."""
_ALONG = 2000
"""Angles along the diagonal."""
_INVERSE_DEGREES = range(8, 21)


@dataclass(frozen=True, eq=False)
class PolynomialLens:
    """coefficients a0, a1, … (ahead below 0, as OCamCalib looks back), inverse b0, b1, …; A (2, 2) and centre (2,) in
    pixels (u, v); rms_px, most_px: how far the lens is from the camera over the image; inverse_px: how far its inverse
    is from it at most; unseen: the share of the image that the camera has no rays for."""

    coefficients: Array
    inverse: Array
    A: Array
    centre: Array
    rms_px: float
    most_px: float
    inverse_px: float
    unseen: float


def polynomial_of(camera: Camera) -> PolynomialLens:
    """The nearest polynomial lens to a camera.

    Raises: InputError where the camera has rays for less than a tenth of its image.
    """
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, GRID[0]), np.linspace(0, height - 1, GRID[1]))
    uv = np.stack([u.ravel(), v.ravel()], axis=-1)
    with np.errstate(all="ignore"):
        rays = camera.unproject(uv)
    centre, A = camera.K[:2, 2], camera.K[:2, :2] / camera.K[0, 0]
    xy = np.linalg.solve(A, (uv - centre).T).T
    rho, sideways = np.linalg.norm(xy, axis=-1), np.linalg.norm(rays[:, :2], axis=-1)
    seen = np.isfinite(rays).all(axis=-1) & (rho > 1.0) & (sideways > 0)
    if seen.sum() < len(uv) // 10:
        raise InputError(f"this {camera.model.name} camera has rays for {seen.mean():.0%} of its image")
    uv, xy, rho = uv[seen], xy[seen], rho[seen]
    wanted = -rho * rays[seen, 2] / sideways[seen]
    px_per_rad = _px_per_rad(camera, A, np.arctan2(rho, -wanted))
    tries = []
    for degree in _DEGREES:
        a = _fitted(rho, wanted, px_per_rad, degree)
        apart = _apart(camera, uv, xy, -np.polyval(a[::-1], rho))
        tries.append((float(apart.max()), float(np.sqrt(np.mean(apart**2))), a))
        if tries[-1][0] < _NEAR_ENOUGH_PX:
            break
    most, rms, a = min(tries, key=lambda found: found[0])
    b, inverse_px = _inverse_of(a, float(rho.max()))
    return PolynomialLens(a, b, A, centre, rms, most, inverse_px, float(1 - seen.mean()))


def _px_per_rad(camera: Camera, A: Array, theta: Array) -> Array:
    """d rho / d theta at angles from the axis, along the image's diagonal."""
    t = np.linspace(1e-3, float(theta.max()), _ALONG)
    with np.errstate(all="ignore"):
        uv = camera.project(np.stack([np.sin(t) / np.sqrt(2), np.sin(t) / np.sqrt(2), np.cos(t)], axis=-1))
    slope = np.gradient(np.linalg.norm(np.linalg.solve(A, (uv - camera.K[:2, 2]).T), axis=0), t)
    known = np.isfinite(slope)
    return np.interp(theta, t[known], np.abs(slope[known])) if known.any() else np.ones(len(theta))


def _fitted(rho: Array, wanted: Array, px_per_rad: Array, degree: int) -> Array:
    """a0, 0, a2, … of least squares over the pixels that they make."""
    powers, scale = np.array([0, *range(2, degree + 1)]), float(rho.max())
    weight = px_per_rad * rho / (rho**2 + wanted**2)
    found, *_ = np.linalg.lstsq((rho[:, None] / scale) ** powers * weight[:, None], wanted * weight, rcond=None)
    a = np.zeros(degree + 1)
    a[powers] = found / scale**powers
    return a


def _apart(camera: Camera, uv: Array, xy: Array, ahead: Array) -> Array:
    """Pixels between where the polynomial's rays fall in the camera and where they should; infinite where nowhere."""
    with np.errstate(all="ignore"):
        off = np.linalg.norm(camera.project(np.concatenate([xy, ahead[:, None]], axis=1)) - uv, axis=-1)
    return np.where(np.isfinite(off), off, np.inf)


def _inverse_of(a: Array, widest: float) -> tuple[Array, float]:
    """The polynomial of rho in theta up to the image's farthest corner, and how far it is off at most, px."""
    rho = np.linspace(0, widest, 400)
    theta = np.arctan2(np.polyval(a[::-1], rho), rho)
    tries = []
    for degree in _INVERSE_DEGREES:
        b: Array = np.polynomial.Polynomial.fit(theta, rho, degree).convert().coef.astype(np.float64)
        tries.append((float(np.abs(np.polyval(b[::-1], theta) - rho).max()), b))
        if tries[-1][0] < _NEAR_ENOUGH_PX:
            break
    off, b = min(tries, key=lambda found: found[0])
    return b, off


def polynomial_camera(
    coefficients: Array, A: Array, centre: Array, *, size: Size, source: str, answers: Mapping[str, str]
) -> Camera:
    """The nearest camera to a polynomial lens: coefficients a0, a1, …; A (2, 2) and centre (2,) in pixels (u, v).

    Raises: InputError for a polynomial that is none, or an A without an inverse.
    """
    if len(coefficients) == 0 or coefficients[0] == 0 or abs(np.linalg.det(A)) < 1e-6:
        raise InputError(f"{source}: a polynomial {coefficients.tolist()} with affine terms {A.ravel().tolist()}")
    ahead = np.sign(coefficients[0])

    def rays(uv: Array) -> Array:
        xy = np.linalg.solve(A, (uv - centre).T).T
        rho = np.linalg.norm(xy, axis=-1)
        return np.concatenate([xy, ahead * np.polyval(coefficients[::-1], rho)[:, None]], axis=1)

    return nearest_by_rays(
        rays,
        size,
        answers,
        focal_px=float(abs(coefficients[0])),
        centre=centre,
        what=f"{source}: a polynomial (Scaramuzza's) lens",
    )
