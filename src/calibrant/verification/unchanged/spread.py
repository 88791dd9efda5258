"""How much more than white noise a calibration's own views differ: what a new photo may differ by without a change.

Every view is asked for a lens of its own. With its pose eliminated, the gain of (relative focal length, cx, cy),

    gain = |Q^T r|^2 / sigma^2,    Q an orthonormal basis of the lens's columns beyond the pose's,

is chi-square of 3 where the noise is white and the lens is the model's. Points of one view that err alike (bent paper,
blur, a lens that the model does not quite follow) make it larger by a factor f; that part is no noise that more photos
average out where they show the target at one place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.calibrate.reprojection.factor import stack
from calibrant.calibrate.review.residuals import seen_poses
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, View
from calibrant.geometry import so3
from calibrant.verification.unchanged.model import lens_change

MOST = 40
"""Views that are asked: the factor is then known to a tenth."""
SEVERAL = 3
"""Fewer views say nothing of how views differ."""
ALIKE = 0.1
"""Radians of turn, and of the distance: poses within are of one place. Boards bend a view by what they are tilted."""
UNKNOWN_FREEDOM = 1e6
"""Degrees of freedom of a factor that is taken as 1: of noise that is known."""


@dataclass(frozen=True)
class Spread:
    """factor f >= 1 of a view's own lens over white noise, the degrees of freedom it is known with, and sigma_px of the
    calibration's points per axis, None where it states none."""

    factor: float = 1.0
    freedom: float = UNKNOWN_FREEDOM
    sigma_px: float | None = None

    def shared_by(self, photos: int, places: int) -> float:
        """The factor on the gain of a lens that several photos share: of its variance the part that is white falls
        with their number, the excess with the number of different places they show the target at."""
        return 1.0 + max(photos, 1) / max(places, 1) * (self.factor - 1.0)


def places(T_camera_target: Array) -> int:
    """How many of the poses (n, 4, 4) differ: photos of a target that was hardly moved err alike."""
    kept: list[Array] = []
    for T in T_camera_target:
        turns = [float(np.linalg.norm(so3.log(K[:3, :3].T @ T[:3, :3]))) for K in kept]
        steps = [float(np.linalg.norm(K[:3, 3] - T[:3, 3]) / max(abs(T[2, 3]), 1e-9)) for K in kept]
        if all(turn > ALIKE or step > ALIKE for turn, step in zip(turns, steps)):
            kept.append(T)
    return len(kept)


def spread_of(result: CalibrationResult, name: str, camera: Camera) -> Spread:
    """The spread of the views that a result was made from."""
    stated = result.cell.sigma_px.get(name, result.sigma_px) if result.cell is not None else result.sigma_px
    used = {v.id for v in result.views if v.used}
    seen = [] if result.observations is None else [v for v in result.observations.views if v.camera == name]
    poses = seen_poses(result)
    rows = [(v, poses[name, v.id]) for v in seen if v.id in used and (name, v.id) in poses]
    step = max(1, -(-len(rows) // MOST))
    gains, squares, spare = [], 0.0, 0
    for view, T in rows[::step]:
        if 2 * len(view) < 12:  # 9 unknowns and something to spare
            continue
        gain, rest = own_lens(camera, view, T)
        gains.append(gain)
        squares += rest
        spare += 2 * len(view) - 9
    if len(gains) < SEVERAL or squares <= 0:
        return Spread(sigma_px=stated)
    # The calibration's own lens took 3 of the 3 n numbers.
    n = len(gains)
    factor = sum(gains) / (3 * (n - 1)) / (squares / spare)
    return Spread(max(1.0, factor), 3.0 * (n - 1), stated)


def own_lens(camera: Camera, view: View, T_camera_target: Array) -> tuple[float, float]:
    """The gain of a lens of the view's own, and the squares that are left, both in units of the points' relative
    variance."""
    sigma = stack([view]).sigma
    turned = view.points @ T_camera_target[:3, :3].T
    uv, J_point, J_lens = camera.model.project_with_jacobians(camera.values, turned + T_camera_target[:3, 3])
    weight = 1 / sigma[:, None]
    keep = _belonging(np.linalg.norm((uv - view.uv) * weight, axis=1))
    pose = np.concatenate([-J_point @ so3.hat(turned), J_point], axis=-1)
    columns = np.concatenate([pose, J_lens @ lens_change(camera, camera.values)], axis=-1) * weight[..., None]
    J = columns[keep].reshape(-1, 9)
    r = ((uv - view.uv) * weight)[keep].ravel()
    Q, _ = np.linalg.qr(J / np.linalg.norm(J, axis=0))
    parts = Q.T @ r
    return float(parts[6:] @ parts[6:]), float(r @ r - parts @ parts)


def _belonging(length: Array) -> Mask:
    """Points that belong: a Gaussian's are beyond five sigma of the median once in a hundred thousand."""
    keep: Mask = length <= 5.0 * max(float(np.median(length)) / 1.1774, 1e-12)
    return keep
