"""What a projector's patterns say of a scene: a point for every pixel of the camera that they decode, with its sigma.

The camera's pixel is a ray z d(u), exact but for the calibration; the decoded pixel q says where on it. With q(z) the
projector's pixel of the point,

    z = argmin |(q(z) - q) / sigma_q|^2,    sigma_z^2 = 1 / (J^T W J) + a C a^T,    J = dq/dz,  W = 1 / sigma_q^2
    a = -(J^T W J)^-1 J^T W dq/dc

c the calibration, C its covariance: places and lenses together (`stereo.eyes`). The second term all points share. What
is left of q - q(z) across the epipolar line has one degree of freedom; a point where it is beyond chance is none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.data.cloud import Cloud
from calibrant.detection.structured_light.decode import Decoded
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.perceive.colour_scale import ColourScale
from calibrant.perceive.stereo.eyes import Eyes

STEPS = 5
ACROSS_SIGMAS = 4.0
"""Once in sixteen thousand points noise is that far across the epipolar line."""
ALIKE_PX = 4.0
"""Projector pixels between neighbours on a surface: a camera's pixel sees four at most where it is worth its place."""
LEAST_ALIKE = 3
"""Of eight neighbours: what agrees with fewer is the mixture of two surfaces, or a wrong bit."""
BLUR_REACH = 2
"""Camera pixels around a jump or darkness: sharp pictures blur over no more."""
BEND_PX = 0.25
"""Projector pixels by which a surface bends from one pixel to the next: a ball of a hand's width, a metre away, does by
a hundredth."""
JUMP_SIGMAS = 5 * 6**0.5
"""Of a pixel, for the difference of two from twice a third."""
WEAK = 0.1
"""Of a depth: rays that meet so flatly say nothing of it."""
CHUNK = 100_000
OUTSIDE = 0.01
"""Part of the depths at each end whose colours are those of the ends."""


@dataclass(frozen=True, eq=False)
class Scan:
    """Points (n, 3), metres, camera frame, of pixels uv (n, 2), whole; by_pixels, by_calibration (n,): sigma of z by
    the decoding, each point's own, and by the calibration, which all share; across: RMS of what was left across the
    epipolar lines over its sigma, before points were left out for it; decoded: pixels that were decoded."""

    points: Array
    uv: NDArray[np.int64]
    by_pixels: Array
    by_calibration: Array
    across: float
    decoded: int

    @property
    def sigma_z(self) -> Array:
        """1 sigma of each depth, metres, (n,)."""
        return np.hypot(self.by_pixels, self.by_calibration)

    def cloud(self, grey: NDArray[np.uint8]) -> Cloud:
        """The points in the grey of the picture (h, w) they were seen in, with sigma_z and its parts."""
        shade = grey[self.uv[:, 1], self.uv[:, 0]]
        values = {
            "sigma_z": self.sigma_z,
            "sigma_z_pixels": self.by_pixels,
            "sigma_z_calibration": self.by_calibration,
        }
        return Cloud(self.points, np.repeat(shade[:, None], 3, axis=1), values)


def scan(decoded: Decoded, eyes: Eyes) -> Scan:
    """The points of a decoded capture. eyes: the camera, then the projector.

    Raises: RefusedError for an empty cloud.
    """
    known = decoded.known & _on_surface(decoded)
    v, u = np.nonzero(known)
    parts = [
        _points(decoded, eyes, np.stack([u[k : k + CHUNK], v[k : k + CHUNK]], axis=1)) for k in range(0, len(u), CHUNK)
    ]
    count = int(decoded.known.sum())
    if not parts:
        raise RefusedError(
            f"the cloud is empty: of {decoded.known.size} pixels {count} are decoded, and none agrees with its "
            "neighbours. Is the scene in the projector's light, and are these photos of the patterns that were said?"
        )
    uv, X, by_pixels, by_calibration, across, good = (np.concatenate(p) for p in zip(*parts))
    # A calibration that is off leaves every point across the lines: its typical size is the scale.
    usual = float(np.median(np.abs(across[good]))) / 0.6745 if good.any() else 1.0
    keep = good & (np.abs(across) < ACROSS_SIGMAS * max(usual, 1.0))
    if not keep.any():
        raise RefusedError(f"the cloud is empty: of {count} decoded pixels none has a point before both lenses")
    rms = float(np.sqrt(np.mean(np.minimum(np.abs(across[good]), 10 * usual) ** 2)))
    return Scan(X[keep], uv[keep], by_pixels[keep], by_calibration[keep], rms, count)


def _on_surface(decoded: Decoded) -> Mask:
    """Pixels whose projector pixel agrees with enough neighbours, and which are beside no jump and no darkness.

    A pixel at the rim of what is lit is lit in part: its light comes from beside its middle. Blur mixes the light of
    two surfaces where one hides the other: there the projector's pixel is off from the middle of those to both sides by
    more than noise and a surface's own bend.
    """
    q, sigma, known = decoded.pixels, decoded.sigma, decoded.known
    near = np.zeros(known.shape, dtype=np.int64)
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        gap = np.abs(_moved(q, dy, dx) - q)
        alike = (gap < ALIKE_PX).all(axis=-1)
        near += alike
        near += _moved(alike, -dy, -dx, False)
    jump = np.zeros(known.shape, dtype=np.bool_)
    for dy, dx in ((0, 1), (1, 0)):
        for reach in (1, 2):
            before, after = (_moved(q, k * reach * dy, k * reach * dx) for k in (-1, 1))
            bend = np.abs(before + after - 2 * q)
            jump |= (bend > BEND_PX * reach**2 + JUMP_SIGMAS * sigma).any(axis=-1)
    beside = jump.copy()
    for dy in range(-BLUR_REACH, BLUR_REACH + 1):
        for dx in range(-BLUR_REACH, BLUR_REACH + 1):
            beside |= _moved(jump, dy, dx, False) | ~_moved(known, dy, dx, False)
    return np.asarray(known & (near >= LEAST_ALIKE) & ~beside)


def _moved(picture: NDArray[Any], dy: int, dx: int, fill: float | bool = np.nan) -> NDArray[Any]:
    """What stands dy rows below and dx columns right of every pixel."""
    out = np.full_like(picture, fill)
    h, w = picture.shape[:2]
    to = np.s_[max(-dy, 0) : h - max(dy, 0), max(-dx, 0) : w - max(dx, 0)]
    out[to] = picture[max(dy, 0) : h - max(-dy, 0), max(dx, 0) : w - max(-dx, 0)]
    return out


def _points(decoded: Decoded, eyes: Eyes, uv: NDArray[np.int64]) -> tuple[NDArray[Any], ...]:
    """uv, points, both sigmas of z, what is left across over its sigma, and which are points."""
    camera, projector = eyes.cameras
    T = se3.inverse(eyes.T_first_camera[1])
    at = (uv[:, 1], uv[:, 0])
    q = decoded.pixels[at].astype(np.float64)
    sigma = decoded.sigma[at].astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        d = camera.unproject(uv.astype(np.float64))
        d = d / d[:, 2:]
        z = _start(d, projector.unproject(q) @ T[:3, :3], eyes.T_first_camera[1][:3, 3])
    good = np.isfinite(z) & (z > 0) & np.isfinite(d).all(axis=1)
    d, z = np.where(good[:, None], d, [0.0, 0.0, 1.0]), np.where(good, z, 1.0)
    for _ in range(STEPS):
        _, r, J, H, _, _ = _equations(eyes, T, d, z, q, sigma)
        z = np.maximum(z - np.sum(J * r, axis=1) / H, 1e-3)
    X, r, J, H, J_X, J_lens = _equations(eyes, T, d, z, q, sigma)
    by = _by_calibration(eyes, T, d, X, J, H, J_X, J_lens, sigma)
    by_calibration = np.sqrt(np.maximum(np.einsum("np,pq,nq->n", by, eyes.covariance, by), 0.0))
    across = (r[:, 0] * J[:, 1] - r[:, 1] * J[:, 0]) / np.sqrt(H)
    by_pixels = 1 / np.sqrt(H)
    good &= np.isfinite(across) & (by_pixels < WEAK * z) & np.isfinite(by_calibration)
    return uv, X, by_pixels, by_calibration, across, good


def _start(d: Array, e: Array, origin: Array) -> Array:
    """Depth (n,) along d of the point nearest to rays e from the projector's centre."""
    dd, ee, de = np.sum(d * d, axis=1), np.sum(e * e, axis=1), np.sum(d * e, axis=1)
    return np.asarray(((d @ origin) * ee - (e @ origin) * de) / (dd * ee - de * de))


def _equations(
    eyes: Eyes, T: Array, d: Array, z: Array, q: Array, sigma: Array
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Points, residuals (n, 2) and J = dq/dz (n, 2) over sigma, J^T J (n,), dq/dX (n, 2, 3) and dq/d lens (n, 2, k)."""
    projector = eyes.cameras[1]
    X = z[:, None] * d
    uv, J_p, J_lens = projector.model.project_with_jacobians(projector.values, se3.apply(T, X))
    J_X = J_p @ T[:3, :3]
    J = np.einsum("nij,nj->ni", J_X, d) / sigma
    return X, (uv - q) / sigma, J, np.sum(J * J, axis=1), J_X, J_lens


def _by_calibration(
    eyes: Eyes, T: Array, d: Array, X: Array, J: Array, H: Array, J_X: Array, J_lens: Array, sigma: Array
) -> Array:
    """dz/dc (n, 6 + lenses), in the order of `Eyes.covariance`."""
    camera = eyes.cameras[0]
    _, D, D_lens = camera.model.project_with_jacobians(camera.values, d)
    # A ray of the same pixel through another lens: D dd + D_lens dc = 0 with dd_z = 0.
    dd = -np.linalg.solve(D[:, :, :2], D_lens)
    place = eyes.T_first_camera[1][:3, 3]
    dq_place = J_X @ np.concatenate([so3.hat(X - place), np.broadcast_to(-np.eye(3), (len(X), 3, 3))], axis=2)
    dq_camera = J_X[:, :, :2] @ dd * X[:, 2, None, None]
    dq = np.concatenate([dq_place, dq_camera, J_lens], axis=2) / sigma[:, :, None]
    return -np.einsum("ni,nip->np", J, dq) / H[:, None]


def coloured_depth(found: Scan, grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The picture with the scale at its right, BGR: depths in colours, near red and far blue, the rest in its own grey,
    darker."""
    z = found.points[:, 2]
    scale = ColourScale.of("z", z, outside=OUTSIDE)
    out = np.repeat((grey // 2)[..., None], 3, axis=2)
    out[found.uv[:, 1], found.uv[:, 0]] = scale.colours(z)
    return scale.beside(out)
