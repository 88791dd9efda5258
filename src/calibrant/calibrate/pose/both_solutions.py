"""Poses of a target from single images and a known camera (PnP), with what is not certain about them.

Both poses that a nearly flat target has in a picture (see `target_poses`) are fitted; a view says which by the ratio of
their likelihoods. With S_k the weighted squared residuals of solution k, C_k its covariance, and the integral over each
minimum approximated by Laplace's,

    P_2 / P_1 = (|C_2| / |C_1|)^(1/2) exp(-(S_2 - S_1) / (2 sigma^2))               for a noise that is given
              = (|C_2| / |C_1|)^(1/2) (1 + (S_2 - S_1) / (nu sigma^2))^(-nu / 2)    for one estimated, nu spare values

(the second under Jeffreys' prior). The covariance of a pose holds the noise of the pixels and the camera's own
uncertainty, both by first order:

    C = sigma^2 H^-1 + D C_camera D^T,    H = sum J^T W J,    D = dT / d theta = -H^-1 sum J^T W J_theta.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.pose.shared_errors import with_shared_errors
from calibrant.calibrate.pose.target_poses import TargetPoses, target_poses
from calibrant.calibrate.reprojection.factor import stack
from calibrant.calibrate.reprojection.outliers import CAUCHY_SCALE_SIGMAS, Marked, mark
from calibrant.calibrate.reprojection.weights import reweighted
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.optimize.losses import cauchy

FEWEST_POINTS = 4
ROBUST_FROM = 8
"""Points from which a view may lose some: with fewer, the pose bends to a gross error rather than showing it."""
SAME_POSE = 0.1
"""Sigmas between two solutions below which they are one minimum that was reached twice."""
LEAST_SIGMA_PX = 1e-3
"""Noise-free data have residuals of rounding: no detector locates a point better than to a thousandth of a pixel."""
UNKNOWNS = 6


@dataclass(frozen=True, eq=False)
class PoseSolution:
    """One pose that fits a view: T_camera_target (4, 4), metres, and how likely it is against the other, 0 to 1.

    covariance (6, 6) of `se3.retract`, radians and metres; of_camera (6, 6) the camera's share of it, None where the
    camera's uncertainty is not known; rms_px per point over both axes; times: how much wider sigma is for errors that
    neighbouring points share; chi2: squared residuals over the noise; lens_chi2: how much of it the camera's
    uncertainty may be expected to make.
    """

    T_camera_target: Array
    covariance: Array
    of_camera: Array | None
    rms_px: float
    probability: float
    times: float = 1.0
    chi2: float = 0.0
    lens_chi2: float = 0.0


@dataclass(frozen=True, eq=False)
class Weakest:
    """Where a pose is known worst: sigma of the middle of the seen points, and of the rotation, with their directions.

    direction and axis (3,) unit, camera frame; to_sight_deg and axis_to_sight_deg: their angles to the line of sight.
    """

    sigma_mm: float
    direction: Array
    to_sight_deg: float
    sigma_deg: float
    axis: Array
    axis_to_sight_deg: float


@dataclass(frozen=True, eq=False)
class ViewPose:
    """The pose of the target in one view; `other` is the second solution, None where there is none.

    view: its points that were used; left_out: how many were not.
    """

    view: View
    best: PoseSolution
    other: PoseSolution | None
    weakest: Weakest
    left_out: int = 0

    def ambiguous(self, confidence: float) -> bool:
        """Whether the other solution cannot be ruled out at this confidence."""
        return self.other is not None and self.best.probability < confidence


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses of all views with one noise: sigma_px per axis of the typical point; spare: values beyond the unknowns.

    estimated: whether sigma_px is of the residuals rather than given; marked: what was left out.
    """

    views: tuple[ViewPose, ...]
    sigma_px: float
    spare: int
    estimated: bool
    marked: Marked


def view_poses(camera: Camera, views: Sequence[View], *, sigma_px: float | None = None) -> Poses:
    """Pose of the target in every view, each with its second solution.

    sigma_px: noise per axis of the typical point; by default the detector's own, with what the residuals show beyond
    it, or the residuals' alone.
    Raises: InputError for fewer than four points in a view, points on a line, points that the camera cannot see.
    """
    if sigma_px is not None and not (np.isfinite(sigma_px) and sigma_px > 0):
        raise InputError(f"sigma_px is the noise of a point in pixels, above 0; got {sigma_px}")
    found = target_poses(camera, views)
    kept, found, marked = _without_outliers(camera, views, found)
    points = sum(len(v) for v in kept)
    spare = 2 * points - UNKNOWNS * len(kept)
    if sigma_px is None and any(v.sigma_px is not None for v in kept):
        kept = reweighted(kept, _squares(camera, kept, found), unknowns=UNKNOWNS * len(kept))
        found = target_poses(camera, kept)
    stacked = stack(kept)
    level = _level(kept, _squares(camera, kept, found) / stacked.sigma**2, spare, sigma_px)
    sigmas = np.split(level * stacked.sigma, stacked.offsets[1:-1])
    poses = tuple(
        _view_pose(camera, view, found, i, s, spare if sigma_px is None else None)
        for i, (view, s) in enumerate(zip(kept, sigmas))
    )
    lost = [len(a) - len(b) for a, b in zip(views, kept)]
    return Poses(tuple(replace(p, left_out=n) for p, n in zip(poses, lost)), level, spare, sigma_px is None, marked)


def _without_outliers(
    camera: Camera, views: Sequence[View], found: TargetPoses
) -> tuple[tuple[View, ...], TargetPoses, Marked]:
    """Views without the points that do not belong, judged by a robust fit, and the poses of the rest."""
    offsets = np.concatenate([[0], np.cumsum([len(v) for v in views])])
    marked = mark(np.sqrt(_squares(camera, views, found)), offsets)
    if marked.keep.all():
        return tuple(views), found, marked
    robust = target_poses(camera, views, loss=cauchy(CAUCHY_SCALE_SIGMAS), sigma=max(marked.sigma_px, 1e-6))
    marked = mark(np.sqrt(_squares(camera, views, robust)), offsets)
    kept = []
    for view, keep in zip(views, np.split(marked.keep, offsets[1:-1])):
        enough = len(view) >= ROBUST_FROM and keep.sum() >= 0.5 * len(view)
        kept.append(view.subset(keep) if enough and not keep.all() else view)
    return tuple(kept), target_poses(camera, kept), marked


def _squares(camera: Camera, views: Sequence[View], found: TargetPoses) -> Array:
    """Squared residual norms (N,) of all points, px^2."""
    return np.concatenate([np.sum(v.residuals(camera, T) ** 2, axis=1) for v, T in zip(views, found.T_camera_target)])


def _level(views: Sequence[View], weighted: Array, spare: int, given: float | None) -> float:
    """Noise per axis of a point of relative sigma 1."""
    if given is not None:
        return given
    stated = [v.sigma_px for v in views if v.sigma_px is not None]
    if stated:
        return max(float(1 / np.sqrt(np.mean(np.concatenate(stated) ** -2))), LEAST_SIGMA_PX)
    return max(float(np.sqrt(weighted.sum() / max(spare, 1))), LEAST_SIGMA_PX)


def _view_pose(camera: Camera, view: View, found: TargetPoses, i: int, sigma: Array, spare: int | None) -> ViewPose:
    best = _solution(camera, view, found.T_camera_target[i], sigma)
    other = _solution(camera, view, found.doubles[i], sigma)
    step = se3.local(best.pose.T_camera_target, other.pose.T_camera_target)
    if step @ np.linalg.solve(best.of_noise, step) < SAME_POSE**2 or not np.isfinite(other.pose.chi2):
        return ViewPose(view, best.pose, None, weakest(best.pose, view))
    ratio = _ratio(best, other, spare)
    if ratio > 1:
        best, other, ratio = other, best, 1 / ratio
    first = replace(best.pose, probability=1 / (1 + ratio))
    second = replace(other.pose, probability=ratio / (1 + ratio))
    return ViewPose(view, first, second, weakest(first, view))


@dataclass(frozen=True, eq=False)
class _Fitted:
    """A solution, and the share of pixel noise (6, 6) in its covariance."""

    pose: PoseSolution
    of_noise: Array


def _ratio(best: _Fitted, other: _Fitted, spare: int | None) -> float:
    """P_other / P_best; spare: values that the noise was estimated from, None for a noise that was given."""
    volume = 0.5 * (np.linalg.slogdet(other.of_noise)[1] - np.linalg.slogdet(best.of_noise)[1])
    worse = other.pose.chi2 - best.pose.chi2
    if spare is None:
        logarithm = volume - 0.5 * worse
    else:
        nu = max(spare, 1)
        logarithm = volume - 0.5 * nu * np.log1p(max(worse / nu, -0.999999))
    return float(np.exp(np.clip(logarithm, -700, 700)))


def _solution(camera: Camera, view: View, T: Array, sigma: Array) -> _Fitted:
    """A pose with its covariance. sigma (n,) px per axis of the points."""
    rotated = view.points @ T[:3, :3].T
    uv, J_point, J_camera = camera.model.project_with_jacobians(camera.values, rotated + T[:3, 3])
    J = np.concatenate([-J_point @ so3.hat(rotated), J_point], axis=-1)
    weight = (1 / sigma**2)[:, None, None]
    H = np.sum(np.swapaxes(J, -1, -2) @ (weight * J), axis=0)
    # Radians and metres differ by orders of magnitude: scaled, the inverse loses no digits.
    scale = 1 / np.sqrt(np.diag(H))
    of_noise = np.linalg.inv(H * scale[:, None] * scale) * scale[:, None] * scale
    of_camera, lens_chi2 = None, 0.0
    if camera.covariance is not None:
        D = -of_noise @ np.sum(np.swapaxes(J, -1, -2) @ (weight * J_camera), axis=0)
        of_camera = D @ camera.covariance @ D.T
        left = (J_camera + J @ D) / sigma[:, None, None]
        lens_chi2 = float(np.einsum("nij,jk,nik->", left, camera.covariance, left))
    squares = np.sum((uv - view.uv) ** 2, axis=1)
    whitened, residuals = J / sigma[:, None, None], (uv - view.uv) / sigma[:, None]
    shared = with_shared_errors(of_noise, whitened, residuals, view.points, of_camera=of_camera)
    total = shared if of_camera is None else shared + of_camera
    times = float(np.sqrt(np.mean(np.diag(shared) / np.diag(of_noise))))
    chi2 = float(np.sum(squares / sigma**2))
    pose = PoseSolution(T, total, of_camera, float(np.sqrt(squares.mean())), 1.0, times, chi2, lens_chi2)
    return _Fitted(pose, of_noise)


def weakest(pose: PoseSolution, view: View) -> Weakest:
    """The direction in which the middle of the seen points is known worst, and the axis of the worst known turn."""
    T = pose.T_camera_target
    arm = T[:3, :3] @ view.points.mean(axis=0)
    sight = (arm + T[:3, 3]) / np.linalg.norm(arm + T[:3, 3])
    J = np.concatenate([-so3.hat(arm), np.eye(3)], axis=1)
    of_position, directions = np.linalg.eigh(J @ pose.covariance @ J.T)
    of_rotation, axes = np.linalg.eigh(pose.covariance[:3, :3])
    direction, axis = _towards(directions[:, 2], sight), _towards(axes[:, 2], sight)
    return Weakest(
        float(1e3 * np.sqrt(of_position[2])),
        direction,
        float(np.rad2deg(np.arccos(np.clip(direction @ sight, -1, 1)))),
        float(np.rad2deg(np.sqrt(of_rotation[2]))),
        axis,
        float(np.rad2deg(np.arccos(np.clip(axis @ sight, -1, 1)))),
    )


def _towards(direction: Array, sight: Array) -> Array:
    return direction if direction @ sight >= 0 else -direction
