"""Hand-eye from one point: a depth camera that sees a single point, and a robot that moves it, or the camera.

    camera on the gripper:  A_i X p_i = c        X = T_gripper_camera, c a point that stands still, base frame
    camera beside it:       X p_i = A_i b        X = T_base_camera,    b a point of the gripper, gripper frame

with A_i = T_base_gripper and p_i the point as the depth camera measures it (thesis of 2024, document 004, section 1.2).
The second is the first with A_i^-1 for A_i. A target that is a point has no rotation: nothing of it is a gauge, and the
nine unknowns X and c follow from four poses or more, whose turns are about two axes or more that are not parallel.

The start is linear: R_i R p + R_i t - c = -t_i in R, t, c; where the points lie in a plane or on a line and R does not
follow, turns in steps of a right angle are tried. Then least squares over R^T (R_i^T (c - t_i) - t) - p_i, whitened by
each point's covariance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.optimize import SE3, Factor, Problem, Solution, Variable, solve, vector
from calibrant.optimize.chances import chi2_tail

LEAST_POSES = 4
SURPRISING = 1e-4
WORST_SIGMA = 0.2
"""Radians: a rotation that is less certain says nothing; its sigma is no longer linear."""
_TRIED = 4


@dataclass(frozen=True, eq=False)
class OnePointHandEye:
    """T (4, 4): T_gripper_camera, or T_base_camera beside the robot; covariance (6, 6) of `se3.retract`; point (3,),
    metres: in the base, or in the gripper's frame; point_covariance; residuals (n, 3), metres, camera's axes; chance:
    of residuals as large, at the stated noise; noise_ratio: their rms over the stated one."""

    setup: str
    T: Array
    covariance: Array
    point: Array
    point_covariance: Array
    residuals: Array
    chance: float
    noise_ratio: float


class SeenPoint(Factor):
    """The point in the camera's frame, predicted less measured."""

    def __init__(self, A: Array, p: Array, covariances: Array) -> None:
        self.A, self.p = A, p
        n = len(p)
        super().__init__(
            "point",
            variables=("X", "c"),
            indices=(np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)),
            dim=3,
            noise="point",
            whitening=np.linalg.inv(np.linalg.cholesky(covariances)),
        )

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        X, c = values[0][0], values[1][0]
        R, t = X[:3, :3], X[:3, 3]
        Ra = self.A[:, :3, :3]
        q = np.einsum("nji,nj->ni", Ra, c - self.A[:, :3, 3]) - t
        r = q @ R - self.p
        J = np.concatenate([np.einsum("ji,njk->nik", R, so3.hat(q)), np.broadcast_to(-R.T, (len(q), 3, 3))], axis=2)
        return r, (J, np.einsum("ji,nkj->nik", R, Ra))


def hand_eye_of_point(
    T_base_gripper: ArrayLike,
    p_camera: ArrayLike,
    *,
    setup: str,
    covariances: ArrayLike | None = None,
    sigma: float = 1e-3,
) -> OnePointHandEye:
    """Where the camera is, from one point seen at n poses.

    Args: T_base_gripper (n, 4, 4); p_camera (n, 3), metres, camera frame; setup: "eye-in-hand" or "eye-to-hand";
    covariances (n, 3, 3) of the points, or sigma, metres, per axis. Raises: InputError for other shapes; RefusedError
    for motions that do not determine the camera's place, named, and for points that fit no place.
    """
    A, p = np.asarray(T_base_gripper, dtype=np.float64), np.asarray(p_camera, dtype=np.float64)
    if setup not in ("eye-in-hand", "eye-to-hand"):
        raise InputError(f"setup is eye-in-hand or eye-to-hand, got {setup!r}")
    if A.ndim != 3 or A.shape[1:] != (4, 4) or p.shape != (len(A), 3) or not np.isfinite(p).all():
        raise InputError(f"expected poses (n, 4, 4) and as many points (n, 3), got {A.shape} and {p.shape}")
    if len(A) < LEAST_POSES:
        raise InputError(f"one point needs {LEAST_POSES} poses or more, got {len(A)}")
    se3.check(A, name="T_base_gripper")
    spread = np.broadcast_to(sigma**2 * np.eye(3), (len(A), 3, 3)) if covariances is None else np.asarray(covariances)
    motions = A if setup == "eye-in-hand" else se3.inverse(A)
    _refuse_parallel(motions, setup)
    factor = SeenPoint(motions, p, np.asarray(spread, dtype=np.float64))
    best = min((_solved(factor, *s) for s in _starts(motions, p)), key=lambda s: s.cost)
    if best.unobservable:
        raise RefusedError(
            f"one point at these {len(A)} poses does not determine where the camera is: "
            + "; ".join(u.message for u in best.unobservable)
            + ". Turn the gripper about two axes, and move the point through space, not along a line"
        )
    joint = best.joint_covariance([("X", 0), ("c", 0)])
    worst = float(np.sqrt(np.linalg.eigvalsh(joint[:3, :3]).max()))
    if worst > WORST_SIGMA:
        raise RefusedError(
            f"the camera's turn is known to {np.rad2deg(worst):.0f} deg alone: the poses differ too little for points "
            "of this noise. Turn the gripper further, and move the point through more of the view"
        )
    dof = 3 * len(A) - 9
    ratio = float(np.sqrt(2 * best.cost / max(dof, 1)))
    return OnePointHandEye(
        setup,
        best.value("X")[0],
        joint[:6, :6],
        best.value("c")[0],
        joint[6:, 6:],
        best.residuals("point"),
        chi2_tail(dof, 2 * best.cost) if dof else 1.0,
        ratio,
    )


def widened(found: OnePointHandEye) -> OnePointHandEye:
    """The same with covariances by the noise that the residuals show, where it is larger than the stated one."""
    more = max(found.noise_ratio, 1.0) ** 2
    return replace(found, covariance=more * found.covariance, point_covariance=more * found.point_covariance)


def _refuse_parallel(A: Array, setup: str) -> None:
    """Raises: RefusedError for motions without turns, or with turns about one axis."""
    turns = so3.log(A[1:, :3, :3] @ A[0, :3, :3].T)
    size = np.linalg.svd(turns, compute_uv=False)
    still, one_axis = np.deg2rad(1.0) * np.sqrt(len(turns)), np.deg2rad(1.0) * np.sqrt(len(turns))
    if size[0] < still:
        what = (
            "camera's place and the point's"
            if setup == "eye-in-hand"
            else "camera's place and the point on the gripper"
        )
        raise RefusedError(
            f"the gripper never turned (less than 1 deg): the {what} are not told apart. Turn it about two axes, by 20 "
            "deg and more"
        )
    if size[1] < one_axis:
        raise RefusedError(
            "the gripper turned about one axis alone: how far the camera is along it is not determined. Turn it about "
            "another axis, too"
        )


def _starts(A: Array, p: Array) -> list[tuple[Array, Array]]:
    """First guesses of X and c, the best few by their residuals."""
    n = len(p)
    Ra, ta = A[:, :3, :3], A[:, :3, 3]
    by_R = np.einsum("nij,nk->nijk", Ra, p).reshape(3 * n, 9)
    rest = np.concatenate([Ra, np.broadcast_to(-np.eye(3), Ra.shape)], axis=2).reshape(3 * n, 6)
    x = np.linalg.lstsq(np.concatenate([by_R, rest], axis=1), -ta.reshape(-1), rcond=1e-9)[0]
    M = x[:9].reshape(3, 3)
    out = []
    for R in [so3.nearest(M), *_right_angles()]:
        y, *_ = np.linalg.lstsq(rest, -(ta.reshape(-1) + by_R @ R.reshape(-1)), rcond=1e-9)
        off = float(np.linalg.norm(rest @ y + ta.reshape(-1) + by_R @ R.reshape(-1)))
        out.append((off, se3.make(R, y[:3]), y[3:]))
    out.sort(key=lambda o: o[0])
    return [(X, c) for _, X, c in out[:_TRIED]]


def _right_angles() -> list[Array]:
    """The 24 turns that bring axes onto axes."""
    quarter = [so3.exp(0.5 * np.pi * axis) for axis in np.eye(3)]
    out = [np.eye(3)]
    for R in out:  # grows until it is closed
        out += [S for Q in quarter if not any(np.allclose(S := Q @ R, K, atol=1e-9) for K in out)]
    return out


def _solved(factor: SeenPoint, X: Array, c: Array) -> Solution:
    variables = (
        Variable("X", SE3(), X[None], words="the camera's place"),
        replace(vector("c", c, ["x", "y", "z"]), words="the point"),
    )
    return solve(Problem(variables, (factor,), {"point": 1.0}))
