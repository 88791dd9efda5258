"""The plane that most depths of a region lie in, robustly: a line in inverse depth.

A plane a . p = 1 is seen along the ray r = (x, y, 1) at 1/z = a . r: linear in a, with noise that is the same at all
distances (`noise`). Three pixels give a candidate, most inliers choose (Fischler and Bolles 1981), least squares over
them refine. What is left over tells the noise, and how many neighbours share it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.cameras import Camera
from calibrant.errors import RefusedError
from calibrant.perceive.registered_depth.noise import DepthNoise
from calibrant.perceive.registered_depth.steps import depth_step, mean_rounding

TRIALS = 200
"""Three pixels of a region that is a third plane are all on it once in 27 trials: missed 200 times once in 1000."""
INLIER = 3.0
"""Sigmas: 1 of 370 good pixels is left out."""
LEAST_PIXELS = 60
LEAST_SHARE = 0.25
"""Of the region's depths that lie on the plane: below, several planes could be the one that is meant."""
_AT_MOST = 20_000
_KEPT = 100
_LAGS = 12
_ROUNDS = 4
_LEFT_AT_INLIER = 0.9733
"""Variance of a normal cut at 3 sigma, relative."""


@dataclass(frozen=True, eq=False)
class Plane:
    """a . p = 1 in the frame of the camera that saw it. a (3,), 1/m; covariance (3, 3) of a; noise: as its pixels have
    it; share: of the region's depths that lie on it; pixels: that were used; uv (k, 2): some of them."""

    a: Array
    covariance: Array
    noise: DepthNoise
    share: float
    pixels: int
    uv: Array
    step: float = 0.0

    @property
    def normal(self) -> Array:
        """(3,), unit, towards the camera."""
        return -self.a / np.linalg.norm(self.a)

    @property
    def distance(self) -> float:
        """Of the camera from the plane, metres."""
        return float(1 / np.linalg.norm(self.a))

    def height(self, points: Array) -> Array:
        """Of points (..., 3) above the plane, towards the camera, metres."""
        return (1 - points @ self.a) * self.distance

    def through(self, old: Camera, new: Camera) -> Plane:
        """The plane that the same depths give on the rays of another lens."""
        before, after = (r / r[:, 2:] for r in (old.unproject(self.uv), new.unproject(self.uv)))
        a, *_ = np.linalg.lstsq(after, before @ self.a, rcond=None)
        return replace(self, a=np.asarray(a, dtype=np.float64))

    def moved(self, T_new_old: Array) -> Plane:
        """The plane in another frame, with its covariance: a' = R a / (1 + a . R^T t)."""
        R, t = T_new_old[:3, :3], T_new_old[:3, 3]
        below = 1 + float((R @ self.a) @ t)
        a = R @ self.a / below
        J = R / below - np.outer(a, t @ R) / below
        return replace(self, a=a, covariance=J @ self.covariance @ J.T)


def rays_of(camera: Camera) -> Array:
    """Rays (h, w, 3) of all pixels, scaled to z = 1; NaN where the lens has none."""
    width, height = camera.image_size
    u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    rays = camera.unproject(np.stack([u, v], axis=-1))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(rays[..., 2:] > 0, rays / rays[..., 2:], np.nan)


def find_plane(depth: Array, rays: Array, region: Mask, *, noise: DepthNoise, what: str = "the table") -> Plane:
    """The plane that most depths of a region lie in, with the noise that its pixels show.

    Args: depth (h, w), metres, NaN where there is none; rays (h, w, 3) with z = 1; region (h, w); noise: expected, from
    which inliers are told at first. Raises: RefusedError where no plane has a quarter of the region.
    """
    rows, columns = np.nonzero(region & np.isfinite(depth) & np.isfinite(rays[..., 0]))
    if len(rows) < LEAST_PIXELS:
        raise RefusedError(
            f"{what} was not found: {len(rows)} pixels around the object have depth, {LEAST_PIXELS} are needed"
        )
    generator = np.random.default_rng(0)
    if len(rows) > _AT_MOST:
        # Whole rows stay together: neighbours tell how far noise is shared.
        every = int(np.ceil(len(rows) / _AT_MOST))
        keep = rows % every == 0
        rows, columns = rows[keep], columns[keep]
    r, q = rays[rows, columns], 1 / depth[rows, columns]
    middle = float(np.median(q))
    step = depth_step(depth, 1 / middle) * middle**2
    a = _best_of_three(r, q, max(noise.inverse_sigma, step / 2), generator)
    sigma = noise.inverse_sigma
    for _ in range(_ROUNDS):
        # Within half a step nothing tells depths apart; without the neighbouring steps their mean is one step's own.
        inlier = np.abs(r @ a - q) <= INLIER * max(sigma, step / 2)
        if inlier.sum() < LEAST_PIXELS or inlier.mean() < LEAST_SHARE:
            raise RefusedError(
                f"{what} was not found: no plane holds a quarter of the {len(rows)} depths around the object (the best "
                f"{100 * inlier.mean():.0f} %, within {INLIER:g} sigma of "
                f"{1e3 * float(noise.sigma_z(float(1 / np.median(q)))):.2g} mm); is the noise of the depth as told?"
            )
        a = np.asarray(np.linalg.lstsq(r[inlier], q[inlier], rcond=None)[0], dtype=np.float64)
        left = (r @ a - q)[inlier]
        sigma = float(np.sqrt(np.mean(left**2) / _LEFT_AT_INLIER))
    shared = pixels_per_sample(rows[inlier], columns[inlier], left, depth.shape)
    measured = noise.with_level(max(sigma, step / 12**0.5, 1e-9), shared)
    rounding = mean_rounding(depth, q[inlier], step)
    level = measured.effective**2 + len(left) * rounding**2
    covariance = np.asarray(level * np.linalg.inv(r[inlier].T @ r[inlier]), dtype=np.float64)
    used = np.stack([columns, rows], axis=1)[inlier].astype(np.float64)
    some = used[:: max(len(used) // _KEPT, 1)]
    return Plane(a, covariance, measured, float(inlier.mean()), int(inlier.sum()), some, step)


def _best_of_three(r: Array, q: Array, sigma: float, generator: np.random.Generator) -> Array:
    few = generator.choice(len(r), size=min(len(r), 2000), replace=False)
    picks = few[generator.integers(0, len(few), size=(TRIALS, 3))]
    A, b = r[picks], q[picks]
    good = np.abs(np.linalg.det(A)) > 1e-9
    if not good.any():
        raise RefusedError("the pixels around the object lie on a line: no plane can be told")
    candidates = np.linalg.solve(A[good], b[good][..., None])[..., 0]
    # Three neighbours give a candidate that is off by more than a pixel's noise: twice the limit.
    near = np.abs(r[few] @ candidates.T - q[few][:, None]) <= 2 * INLIER * sigma
    return np.asarray(candidates[np.argmax(near.sum(axis=0))])


def pixels_per_sample(rows: NDArray[np.intp], columns: NDArray[np.intp], left: Array, shape: tuple[int, int]) -> float:
    """How many pixels tell as much as an independent one: (1 + 2 sum of the residuals' correlation over lags)^2.

    Along rows, and as much along columns; lags up to the first that is not above chance.
    """
    picture = np.full(shape, np.nan)
    picture[rows, columns] = left
    variance = float(np.nanmean(picture**2))
    if variance <= 0:
        return 1.0
    total = 1.0
    for lag in range(1, _LAGS):
        product = picture[:, lag:] * picture[:, :-lag]
        count = int(np.isfinite(product).sum())
        if count < LEAST_PIXELS:
            break
        correlation = float(np.nanmean(product)) / variance
        if correlation < 2 / np.sqrt(count):
            break
        total += 2 * correlation
    return total**2
