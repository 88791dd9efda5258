"""A board's pose from colour and depth together, and what the depth's scale is by the board.

The corners tell the pose with the covariance S of their pixels; the depths z of the pixels within the board tell its
plane, with the depth's noise. Both in one problem:

    r_pose  = S^-1/2 (pose - pose by corners)                    (6)
    r_depth = (1 - s) (m . r) / D + c - 1/z,   m . p = D the board's plane in the depth camera's frame

c is what rounding to steps leaves in the mean of the depths, s their common scale, a prior of its own sigma (0 by
default: as they are). With no prior and many boards s is what is asked: a depth camera's scale is checked in the field
by any board whose size is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.opencv import cv2
from calibrant.optimize import SE3, Factor, Problem, Solution, Variable, VectorPrior, solve, vector
from calibrant.optimize.factors import EXACT
from calibrant.perceive.object_pose.fit import FaceDepths, rounding_left
from calibrant.perceive.registered_depth.noise import DepthNoise
from calibrant.perceive.registered_depth.planes import find_plane, rays_of
from calibrant.perceive.registered_depth.register import DepthRig, checked_depth
from calibrant.perceive.registered_depth.steps import mean_rounding

LEAST_DEPTHS = 100
"""Pixels with depth within a board: fewer tell its plane no better than its corners do."""
MOST_DEPTHS = 4000
RIM_PX = 3
_ONE = np.zeros(1, dtype=np.int64)
LOOSE_SCALE = 0.2
"""Sigma of a scale that nobody knows: off by a fifth is another unit."""
FLAT = np.array([[0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class BoardPose:
    """T_camera_target (4, 4), covariance (6, 6), of corners and depth; by_corners: (6, 6) that the corners alone give;
    scale, scale_sigma: relative, of the depths against the corners; noise: of the depth as the board shows it; depths:
    pixels used; apart: chi-square, of 3 degrees, of what lies between corners and depth (a plane has three numbers);
    misfit: of all residuals."""

    T_camera_target: Array
    covariance: Array
    by_corners: Array
    scale: float
    scale_sigma: float
    noise: DepthNoise
    depths: int
    apart: float = 0.0
    misfit: float = 0.0

    @property
    def gain(self) -> float:
        """By how much the sigma along the camera's axis shrank, 1 for not at all."""
        return float(np.sqrt(self.by_corners[5, 5] / self.covariance[5, 5]))


class CornersPose(Factor):
    """The pose as the corners give it: r = S^-1/2 local(T_corners, T)."""

    def __init__(self, T: Array, covariance: Array) -> None:
        self.T, self.root = T, np.linalg.inv(np.linalg.cholesky(covariance))
        super().__init__("corners", variables=("T_camera_object",), indices=(_ONE,), dim=6, noise=EXACT)

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        r = se3.local(self.T, values[0][0])
        J = np.eye(6)
        J[:3, :3] = so3.left_jacobian_inverse(r[:3])
        return (self.root @ r)[None], ((self.root @ J)[None],)


def board_pose(
    view: View, depth: Array, rig: DepthRig, *, sigma_px: float, noise: DepthNoise, free_scale: bool = False
) -> BoardPose:
    """The pose of a flat board, z = 0, from its corners and its depth.

    Args: depth (h, w), metres, the depth camera's grid; sigma_px: of a corner, per axis; noise: expected of the depth,
    of which the board shows the level; what its depths share counts, and with free_scale that is unknown.
    Raises: InputError for a board with depth of its own; RefusedError where too few pixels on it have depth.
    """
    _require_flat(view)
    found = target_poses(rig.colour, [view])
    T, by_corners = found.T_camera_target[0], found.covariance[0] * sigma_px**2
    by_corners = by_corners + _by_lens(rig.colour, view, T)
    return pose_with_depth(view, T, by_corners, depth, rig, noise=noise, free_scale=free_scale)


def pose_with_depth(
    view: View, T: Array, by_corners: Array, depth: Array, rig: DepthRig, *, noise: DepthNoise, free_scale: bool = False
) -> BoardPose:
    """The same from a pose T (4, 4) by the corners that is there already, with its covariance by_corners (6, 6).

    Raises: as `board_pose`.
    """
    _require_flat(view)
    z = checked_depth(depth, rig)
    inside = _within(view, T, rig)
    rays = rays_of(rig.depth)
    count = int((inside & np.isfinite(z)).sum())
    if count < LEAST_DEPTHS:
        raise RefusedError(
            f"view {view.id!r}: {count} pixels on the board have depth, {LEAST_DEPTHS} are needed; is the board nearer "
            "than the depth camera measures, or shiny?"
        )
    plane = find_plane(z, rays, inside, noise=noise, what=f"the plane of the board in view {view.id!r}")
    near = inside & np.isfinite(z)
    near &= np.abs(rays @ plane.a - 1 / np.where(np.isfinite(z), z, np.inf)) <= 4 * plane.noise.inverse_sigma
    rows, columns = np.nonzero(near)
    pick = np.unique(np.linspace(0, len(rows) - 1, min(len(rows), MOST_DEPTHS)).astype(np.int64))
    every = len(rows) / len(pick)
    r, q = rays[rows[pick], columns[pick]], 1 / z[rows[pick], columns[pick]]
    sigma = plane.noise.inverse_sigma * max(plane.noise.pixels_per_sample / every, 1.0) ** 0.5
    loose = LOOSE_SCALE if free_scale else noise.common_scale(float(1 / np.median(q)))
    rounding = mean_rounding(z, q, plane.step)
    moved = _by_calibration(rig, view, T)
    of_noise = _without(by_corners, np.array([d for _, d in moved])) if moved else by_corners
    solution = _solved(T, of_noise, r, q, sigma, rig, loose, rounding)
    joint = solution.joint_covariance([("T_camera_object", 0), ("scale", 0)])
    T_both, s = solution.value("T_camera_object")[0], float(solution.value("scale")[0, 0])
    pixels = np.stack([columns[pick], rows[pick]], axis=1).astype(np.float64)
    for other, delta in moved:
        # Corners and rays are off by one and the same lens: its errors are not narrowed as noise is.
        rays_off = other.depth.unproject(pixels)
        off = _solved(se3.retract(T, delta), of_noise, rays_off / rays_off[:, 2:], q, sigma, other, loose, rounding)
        shift = se3.local(T_both, off.value("T_camera_object")[0])
        by_lens = np.append(shift, float(off.value("scale")[0, 0]) - s)
        joint = joint + np.outer(by_lens, by_lens)
    apart = float(np.sum(solution.residuals("corners") ** 2)) + (s / loose if loose > 0 else 0.0) ** 2
    return BoardPose(
        T_both,
        joint[:6, :6],
        by_corners,
        s,
        float(np.sqrt(joint[6, 6])),
        plane.noise,
        len(pick),
        apart,
        2 * solution.cost,
    )


def _by_calibration(rig: DepthRig, view: View, T: Array) -> list[tuple[DepthRig, Array]]:
    """The rig with each independent error of its calibration, 1 sigma, and what the corners' pose moves by (6,)."""
    values, vectors = np.linalg.eigh(rig.calibration)
    out = []
    for value, direction in zip(values, vectors.T):
        if value > 1e-12 * values.max():
            off = rig.moved(np.sqrt(value) * direction)
            same = np.array_equal(off.colour.values, rig.colour.values)
            out.append((off, np.zeros(6) if same else _moved(off.colour, rig.colour, view, T)))
    return out


def _moved(off: Camera, camera: Camera, view: View, T: Array) -> Array:
    """What the pose by the corners moves by (6,) with another lens."""
    at = _nearest(camera, view, T)
    return se3.local(at, _nearest(off, view, at))


def _nearest(camera: Camera, view: View, T: Array) -> Array:
    """Of a view's two poses the one nearer to T."""
    found = target_poses(camera, [view])
    both = (found.T_camera_target[0], found.doubles[0])
    return min(both, key=lambda M: float(np.linalg.norm(se3.local(T, M))))


def _without(covariance: Array, moves: Array) -> Array:
    """A covariance (6, 6) less that of the moves (k, 6) it holds; never below a thousandth of itself."""
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 1e-12 * values.max()))
    inner = np.linalg.lstsq(root, moves.T, rcond=None)[0]
    share, axes = np.linalg.eigh(np.eye(len(root)) - inner @ inner.T)
    left = root @ axes
    return np.asarray((left * np.maximum(share, 1e-3)) @ left.T)


def _require_flat(view: View) -> None:
    """Raises: InputError for a board with depth of its own."""
    if np.ptp(view.points[:, 2]) > 1e-9:
        raise InputError(f"view {view.id!r}: the depth of flat boards alone is compared; this target is none")


def _solved(
    T: Array, by_corners: Array, r: Array, q: Array, sigma: float, rig: DepthRig, loose: float, rounding: float
) -> Solution:
    held = () if loose > 0 else ("scale",)
    c, known = rounding_left(rounding)
    variables = (Variable("T_camera_object", SE3(), T[None]), vector("scale", [0.0], ["scale"], held=held), c)
    face = np.zeros(len(q), dtype=np.int64)
    depths = FaceDepths(FLAT, np.zeros(1), face, q, sigma, rays=r, T_depth_colour=se3.inverse(rig.T_colour_depth))
    factors: list[Factor] = [CornersPose(T, by_corners), depths, *known]
    if loose > 0:
        factors.append(VectorPrior("scale", "scale", 0, np.zeros(1), sqrt_information=np.array([[1 / loose]])))
    return solve(Problem(variables, tuple(factors)))


def _within(view: View, T: Array, rig: DepthRig) -> Mask:
    """Pixels (h, w) of the depth camera within the corners' hull, a rim left out."""
    p = se3.apply(se3.inverse(rig.T_colour_depth) @ T, view.points)
    uv = rig.depth.project(p)
    width, height = rig.depth.image_size
    mask = np.zeros((height, width), np.uint8)
    if np.isfinite(uv).all():
        cv2.fillConvexPoly(mask, np.rint(cv2.convexHull(uv.astype(np.float32))).astype(np.int32), 1)
    size = 2 * RIM_PX + 1
    return np.asarray(cv2.erode(mask, np.ones((size, size), np.uint8)) > 0)


def _by_lens(camera: Camera, view: View, T: Array) -> Array:
    """Covariance (6, 6) of the pose by the lens' errors: the pose that each independent one of them gives."""
    out = np.zeros((6, 6))
    for _, delta in _by_calibration(DepthRig.aligned(camera), view, T):
        out += np.outer(delta, delta)
    return out


@dataclass(frozen=True, eq=False)
class DepthScale:
    """How a depth camera's depths compare with boards. scale: relative, 0.01 for 1 % too long; sigma; views: scale and
    sigma of each; spread: of the views beyond their own sigmas, relative; offset, offset_sigma: metres, of depths that
    are z (1 + factor) + offset, None where the boards' distances are too alike to tell one from the other."""

    scale: float
    sigma: float
    views: tuple[tuple[str, float, float], ...]
    spread: float
    offset: float | None = None
    offset_sigma: float | None = None


def depth_scale(
    views: Sequence[View], depths: Sequence[Array], rig: DepthRig, *, sigma_px: float, noise: DepthNoise
) -> DepthScale:
    """The common scale of a depth camera's depths by boards whose size is known.

    Weighted mean of the views, sigma by a random part that the views show they have beyond their own (DerSimonian and
    Laird 1986, "Meta-analysis in clinical trials"). The lens' errors, which all views share, are not averaged.
    """
    if len(views) != len(depths) or not views:
        raise InputError(
            f"{len(views)} views and {len(depths)} depth pictures: expected one for each, and one at least"
        )
    found = [board_pose(v, z, rig, sigma_px=sigma_px, noise=noise, free_scale=True) for v, z in zip(views, depths)]
    # The fit's s is of inverse depths: 1/z is 1 - s times as long, z 1 / (1 - s) times.
    shrunk = np.array([1 - f.scale for f in found])
    s, sigma = 1 / shrunk - 1, np.array([f.scale_sigma for f in found]) / shrunk**2
    shared = _shared_scale(rig.colour, views[0])
    own = np.sqrt(np.maximum(sigma**2 - shared**2, (0.1 * sigma) ** 2))
    w = 1 / own**2
    mean = float(np.sum(w * s) / np.sum(w))
    tau = 0.0
    if len(s) > 1:
        Q = float(np.sum(w * (s - mean) ** 2))
        tau = max(0.0, (Q - (len(s) - 1)) / float(np.sum(w) - np.sum(w**2) / np.sum(w)))
        w = 1 / (own**2 + tau)
        mean = float(np.sum(w * s) / np.sum(w))
    each = tuple((v.id, float(a), float(b)) for v, a, b in zip(views, s, sigma))
    middles = [se3.apply(f.T_camera_target, v.points.mean(axis=0)) for f, v in zip(found, views)]
    offset = _offset(s, np.array(middles)[:, 2], own)
    return DepthScale(mean, float(np.hypot(1 / np.sqrt(np.sum(w)), shared)), each, float(np.sqrt(tau)), *offset)


_APART = 1.2
"""Farthest over nearest board: nearer together, a factor and an offset are one."""


def _offset(s: Array, z: Array, sigma: Array) -> tuple[float | None, float | None]:
    """c and its sigma, metres, of s = k + c / z by weighted least squares; wider where the views scatter more."""
    if len(s) < 3 or z.max() < _APART * z.min():
        return None, None
    A, b = np.stack([np.ones(len(z)), 1 / z], axis=1) / sigma[:, None], s / sigma
    C = np.linalg.inv(A.T @ A)
    x = C @ A.T @ b
    wider = max(1.0, float(np.sum((A @ x - b) ** 2)) / (len(s) - 2))
    return float(x[1]), float(np.sqrt(C[1, 1] * wider))


def _shared_scale(camera: Camera, view: View) -> float:
    """1 sigma of distances by the lens, relative: the focal length's, mostly; alike in all views."""
    T = target_poses(camera, [view]).T_camera_target[0]
    return float(np.sqrt(_by_lens(camera, view, T)[5, 5])) / float(T[2, 3])
