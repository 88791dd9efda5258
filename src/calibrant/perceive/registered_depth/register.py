"""A depth picture brought onto the colour picture of another camera, with the covariance of where each depth lands.

A depth z on the depth camera's ray r = (x, y, 1) is the point p = T_colour_depth (z r) and lands on u = project(p).
Where several land on one colour pixel, the nearest is seen and hides the others (z-buffer). To first order

    du = J_u [ R r dz + z R dr(lens of depth) + omega x R z r + dt ] + du/d(lens of colour)

so that the covariance of u is the depth's noise along the epipolar line and the calibration's in all directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.cameras import Camera
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.perceive.registered_depth.holes import fill_holes
from calibrant.perceive.registered_depth.noise import DepthNoise
from calibrant.perceive.registered_depth.planes import rays_of

AT_ONCE = 20_000
_LEAST_M, _MOST_M = 0.02, 100.0
"""Depths outside are of another unit: no depth camera measures nearer than 2 cm or farther than 100 m."""


@dataclass(frozen=True, eq=False)
class DepthRig:
    """A colour and a depth camera. T_colour_depth (4, 4), metres; covariance (6, 6) of it (`se3.retract`), or None.

    One camera that has both in one grid: `DepthRig.aligned`.
    """

    colour: Camera
    depth: Camera
    T_colour_depth: Array
    covariance: Array | None = None

    @classmethod
    def aligned(cls, camera: Camera) -> DepthRig:
        """Depth that was brought onto the colour picture by the camera itself."""
        return cls(camera, camera, np.eye(4))

    @property
    def is_aligned(self) -> bool:
        """Whether both are one camera: then lens and place of depth and colour are one and the same."""
        return self.depth is self.colour

    @cached_property
    def calibration(self) -> Array:
        """Covariance of all that the calibration says: lens of colour, lens of depth, T_colour_depth; (k, k)."""
        parts = [_known(self.colour)]
        if not self.is_aligned:
            parts += [_known(self.depth), np.zeros((6, 6)) if self.covariance is None else self.covariance]
        size = sum(len(p) for p in parts)
        out, at = np.zeros((size, size)), 0
        for p in parts:
            out[at : at + len(p), at : at + len(p)] = p
            at += len(p)
        return out

    def moved(self, delta: Array) -> DepthRig:
        """The rig with calibration numbers off by delta (k,), in the order of `calibration`."""
        n = len(self.colour.values)
        colour = Camera(self.colour.model, self.colour.image_size, self.colour.values + delta[:n])
        if self.is_aligned:
            return DepthRig.aligned(colour)
        m = n + len(self.depth.values)
        depth = Camera(self.depth.model, self.depth.image_size, self.depth.values + delta[n:m])
        return DepthRig(colour, depth, se3.retract(self.T_colour_depth, delta[m:]))


def _known(camera: Camera) -> Array:
    return np.zeros((len(camera.values),) * 2) if camera.covariance is None else camera.covariance


def checked_depth(depth: NDArray[Any], rig: DepthRig) -> Array:
    """The depth as float64 with NaN where there is none.

    Raises: InputError for another size than the depth camera's, or for numbers that are no metres.
    """
    width, height = rig.depth.image_size
    if depth.shape != (height, width):
        h, w = depth.shape[:2]
        raise InputError(
            f"the depth picture is {w} x {h}, its camera {width} x {height}; is it the depth of another stream, or "
            "of the colour camera's grid?"
        )
    z = np.array(depth, dtype=np.float64)
    z[~(np.isfinite(z) & (z > 0))] = np.nan
    if np.isnan(z).all():
        raise RefusedError("the depth picture is empty: no pixel has a depth above 0")
    middle = float(np.nanmedian(z))
    if not _LEAST_M <= middle <= _MOST_M:
        guess = "millimetres" if middle > _MOST_M else "kilometres"
        raise InputError(f"the depths' median is {middle:g} m; are they {guess}? Expected metres")
    return z


@dataclass(frozen=True, eq=False)
class RegisteredDepth:
    """Depth in the colour picture's grid (h, w). z: metres along the colour camera's axis, NaN where nothing landed;
    filled: holes that were filled from their rim; source (h, w): flat index of the depth pixel, -1 for none; hidden:
    how many depth pixels landed behind others."""

    rig: DepthRig
    z: Array
    filled: Mask
    source: NDArray[np.int64]
    hidden: int
    noise: DepthNoise
    depth: Array

    @property
    def known(self) -> Mask:
        """Where there is a depth, measured or filled."""
        return np.isfinite(self.z)

    @cached_property
    def sigma_z(self) -> Array:
        """1 sigma of the depth (h, w), metres: noise and common scale; NaN where not known."""
        shared = np.hypot(self.noise.scale_sigma * self.z, self.noise.offset_sigma * self.z**2)
        return np.hypot(self.noise.sigma_z(self.z), shared)

    def landing(self, at: Mask) -> tuple[Array, Array]:
        """Where the depths of colour pixels land: pixels (n, 2) and their covariances (n, 2, 2).

        at (h, w): measured pixels among them, in rows' order.
        """
        flat = self.source[at]
        return landing(self.rig, self.depth, flat[flat >= 0], noise=self.noise)


def register_depth(
    depth: NDArray[Any], rig: DepthRig, *, noise: DepthNoise, fill: int | None = None
) -> RegisteredDepth:
    """The depth as the colour camera sees it.

    Args: depth (h, w), metres, NaN or 0 where there is none, in the depth camera's grid; fill: largest hole, pixels,
    that is filled (`fill_holes`), none by default. Raises: InputError, RefusedError as `checked_depth`.
    """
    z = checked_depth(depth, rig)
    if rig.is_aligned:
        source = np.where(np.isfinite(z), np.arange(z.size).reshape(z.shape), -1)
        out, hidden = z, 0
    else:
        out, source, hidden = _splat(z, rig)
    filled = np.zeros(out.shape, dtype=np.bool_)
    if fill:
        out, filled = fill_holes(out, noise=noise, largest_px=fill)
    return RegisteredDepth(rig, out, filled, source, hidden, noise, z)


def _splat(z: Array, rig: DepthRig) -> tuple[Array, NDArray[np.int64], int]:
    """Depth, source and how many were hidden. A depth pixel covers the colour pixels that its cone does."""
    width, height = rig.colour.image_size
    rays = rays_of(rig.depth).reshape(-1, 3)
    flat = np.flatnonzero(np.isfinite(z.ravel()) & np.isfinite(rays[:, 0]))
    p = se3.apply(rig.T_colour_depth, rays[flat] * z.ravel()[flat, None])
    uv = rig.colour.project(p)
    there = np.isfinite(uv).all(axis=1) & (p[:, 2] > 0)
    flat, p, uv = flat[there], p[there], uv[there]
    fx_c, fx_d = rig.colour.parameters["fx"], rig.depth.parameters["fx"]
    wide = fx_c / fx_d * z.ravel()[flat] / p[:, 2]
    out, source = np.full(width * height, np.inf), np.full(width * height, -1, dtype=np.int64)
    reach = int(np.ceil(float(wide.max(initial=1.0)) / 2 + 0.5))
    cells, who = [], []
    for dv in range(-reach, reach + 1):
        for du in range(-reach, reach + 1):
            cell = np.rint(uv + np.array([du, dv]))
            near = (np.abs(cell - uv) <= np.maximum(wide, 1.0)[:, None] / 2 + 1e-9).all(axis=1)
            near &= (cell >= 0).all(axis=1) & (cell[:, 0] < width) & (cell[:, 1] < height)
            cells.append((cell[near, 1] * width + cell[near, 0]).astype(np.int64))
            who.append(np.flatnonzero(near))
    cell, index = np.concatenate(cells), np.concatenate(who)
    np.minimum.at(out, cell, p[index, 2])
    winner = p[index, 2] == out[cell]
    source[cell[winner]] = flat[index[winner]]
    # Hidden are those that won nowhere and are farther than a pixel's own slope could make them.
    own = (np.rint(uv[:, 1]) * width + np.rint(uv[:, 0])).astype(np.int64)
    inside = (np.rint(uv) >= 0).all(axis=1) & (np.rint(uv[:, 0]) < width) & (np.rint(uv[:, 1]) < height)
    behind = p[inside, 2] > 1.02 * out[own[inside]]
    out[np.isinf(out)] = np.nan
    return out.reshape(height, width), source.reshape(height, width), int(behind.sum())


def landing(rig: DepthRig, depth: Array, flat: NDArray[np.int64], *, noise: DepthNoise) -> tuple[Array, Array]:
    """Colour pixels (n, 2) of depth pixels by flat index (n,), and their covariances (n, 2, 2), px^2."""
    rays = rays_of(rig.depth).reshape(-1, 3)
    uv, covariance = np.empty((len(flat), 2)), np.empty((len(flat), 2, 2))
    for first in range(0, len(flat), AT_ONCE):
        part = slice(first, first + AT_ONCE)
        z = np.asarray(depth, dtype=np.float64).ravel()[flat[part]]
        uv[part], J = landing_jacobians(rig, rays[flat[part]], z)
        known = np.zeros((J.shape[2], J.shape[2]))
        known[1:, 1:] = rig.calibration
        spread = J @ known @ np.swapaxes(J, 1, 2)
        sigma = np.sqrt(noise.sigma_z(z) ** 2 + (noise.scale_sigma * z) ** 2 + (noise.offset_sigma * z * z) ** 2)
        covariance[part] = spread + np.einsum("ni,nj,n->nij", J[:, :, 0], J[:, :, 0], sigma**2)
    return uv, covariance


def landing_jacobians(rig: DepthRig, rays: Array, z: Array) -> tuple[Array, Array]:
    """Colour pixels (n, 2), and their slopes (n, 2, 1 + k) by the depth and by what `DepthRig.calibration` is of."""
    R, t = rig.T_colour_depth[:3, :3], rig.T_colour_depth[:3, 3]
    q = rays * z[:, None]
    p = q @ R.T + t
    uv, J_p, J_lens = rig.colour.model.project_with_jacobians(rig.colour.values, p)
    if rig.is_aligned:
        # What a pixel measures lands on that pixel, whatever the lens.
        return uv, np.zeros((len(z), 2, 1 + len(rig.calibration)))
    by_depth = np.einsum("nij,jk,nk->ni", J_p, R, rays)[:, :, None]
    # The pixel stays: J_uv(q) dq + J_lens dlens = 0, with dq across the axis (z is what was measured).
    _, D_q, D_lens = rig.depth.model.project_with_jacobians(rig.depth.values, q)
    across = -np.linalg.solve(D_q[:, :, :2], D_lens)
    by_lens = np.einsum("nij,jk,nkl->nil", J_p, R[:, :2], across)
    turn = -J_p @ so3.hat(q @ R.T)
    return uv, np.concatenate([by_depth, J_lens, by_lens, turn, J_p], axis=2)
