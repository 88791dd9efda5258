"""The next pose, and whole plans: which views would lower the uncertainty that is asked about the most.

A view adds information to what is known about (X, Z, camera), whatever its noise will be: H <- H + S_c, with S_c the
view's normal matrix after its robot pose's correction is eliminated (see `error_budget`). S_c is computed once for each
candidate. The figure to lower is the mean square error of the points asked about (A-optimality; Pukelsheim 1993,
"Optimal design of experiments", ch. 6)

    f(H) = mean_j trace(J_j H^-1 J_j^T)

greedily one view after the other, then exchanging each chosen view for the best of all until nothing improves (Fedorov
1972, "Theory of optimal experiments"). One tier a plan: N inverses of (12 + k) unknowns for each step or exchange.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.solvers.setup import Setup
from calibrant.cameras import Camera
from calibrant.cancel import checkpoint
from calibrant.data import CalibrationResult, View
from calibrant.diagnose.budget.cell import LEVELS, TARGET, error_budget
from calibrant.diagnose.budget.views import NoiseLevels, view_information
from calibrant.diagnose.budget.workspace import point_jacobian, radius_mm, sigma_mm
from calibrant.diagnose.next_pose.candidates import Candidates
from calibrant.errors import InputError
from calibrant.geometry import se3

START_SIGMA = 1.0
"""Radians and metres that X and Z are known to before the first view: nothing, on the scale of a robot cell."""
MAX_PASSES = 10
"""Passes of exchanges; two or three settle a plan."""
LEAST_GAIN = 1e-6
"""Relative gain of an exchange worth making: below it two plans are the same to a millionth of the variance."""


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What is known: setup, X, Z, camera, the noise, and the information (12 + k, 12 + k) about (X, Z, camera).

    Parameters of the camera that are exact have no rows of their own: `free` (f,) lists those that have.
    """

    setup: Setup
    X: Array
    Z: Array
    camera: Camera
    noise: NoiseLevels
    information: Array
    free: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Goal:
    """What is asked: Jacobians (m, 3, 12 + k) of the points, or the camera's position, in (X, Z, camera)."""

    J: Array


@dataclass(frozen=True, eq=False)
class Expected:
    """The uncertainty of the goal: 1 sigma along the worst direction and 95 % radius, worst of its points, mm."""

    sigma_mm: float
    radius_mm: float


@dataclass(frozen=True, eq=False)
class Plan:
    """Chosen candidates in the order to take them, what is expected after each, and before the first."""

    chosen: Candidates
    rows: NDArray[np.int64]
    before: Expected
    after: tuple[Expected, ...]


def nothing_known(setup: Setup, X: Array, Z: Array, camera: Camera, noise: NoiseLevels) -> Knowledge:
    """Before the first view: X and Z roughly, the camera as its file says (exact when it has no covariance)."""
    prior = np.full(12, START_SIGMA**-2)
    variance = np.zeros(len(camera.values)) if camera.covariance is None else np.diag(camera.covariance)
    free = np.concatenate([np.arange(12), 12 + np.flatnonzero(variance > 0)])
    H = np.zeros((len(free), len(free)))
    H[:12, :12] = np.diag(prior)
    if camera.covariance is not None and len(free) > 12:
        H[12:, 12:] = np.linalg.inv(camera.covariance[np.ix_(free[12:] - 12, free[12:] - 12)])
    return Knowledge(setup, X, Z, camera, noise, H, free)


def known_from(result: CalibrationResult) -> Knowledge:
    """What a hand-eye result from images knows. Raises: InputError for a result that was made from target poses."""
    budget = error_budget(result)
    if budget.camera is None or budget.noise is None:
        raise InputError(
            "the result was made from target poses: how well the camera sees is not in it; calibrate from images, or "
            "plan without it (--camera, --camera-at, --target-at)"
        )
    # The target's size is the same in all views: no pose lowers its share.
    covariance = np.sum([C for name, C in budget.sources.items() if name not in (TARGET, LEVELS)], axis=0)
    free = np.flatnonzero(np.diag(covariance) > 0)
    information = np.linalg.inv(covariance[np.ix_(free, free)])
    return Knowledge(budget.setup, budget.X, budget.Z, budget.camera, budget.noise, information, free)


def camera_goal(known: Knowledge) -> Goal:
    """The camera's own position in its parent frame."""
    J = np.zeros((1, 3, 12 + len(known.camera.values)))
    J[0, :, 3:6] = np.eye(3)
    return Goal(J)


def point_goal(known: Knowledge, p_camera: Array) -> Goal:
    """Points (m, 3) in the camera frame, seen there at a known distance: their position in the camera's parent."""
    return Goal(point_jacobian(known.X, known.camera, np.atleast_2d(p_camera), np.eye(4)))


def volume_goal(known: Knowledge, points: Array) -> Goal:
    """Points (m, 3) of the base frame, seen by a camera that stands still.

    Raises: InputError for a camera on the gripper, or when none of the points is in its image.
    """
    if known.setup.camera_parent != "base":
        raise InputError(
            "a camera on the gripper goes where its work is: give the distance it works at (--at), not a volume"
        )
    p = se3.apply(se3.inverse(known.X), points.reshape(-1, 3))
    uv = known.camera.project(np.where(p[:, 2:] > 0, p, [0.0, 0.0, 1.0]))
    inside = np.all((uv > 0) & (uv < np.array(known.camera.image_size) - 1), axis=-1) & (p[:, 2] > 0)
    if not inside.any():
        raise InputError("no point of the workspace lies in the camera's image; check its coordinates: base frame")
    return point_goal(known, p[inside])


def information_of(known: Knowledge, points: Array, views: Candidates) -> Array:
    """Information (n, f, f) that each candidate would add about the free unknowns."""
    predicted = []
    for i, (T, visible) in enumerate(zip(views.T_camera_target, views.visible)):
        p = points[visible]
        uv = known.camera.project(se3.apply(T, p))
        predicted.append(View(str(i), p, uv, np.flatnonzero(visible)))
    parts = view_information(known.setup, predicted, views.T_base_gripper, known.camera, known.X, known.Z, known.noise)
    total = np.sum(list(parts.values()), axis=0)
    return np.asarray(total[:, known.free[:, None], known.free])


def plan_views(known: Knowledge, goal: Goal, points: Array, views: Candidates, count: int) -> Plan:
    """The `count` candidates that together lower the goal's uncertainty most, ordered by what each brings.

    Args: points (p, 3) metres, target frame. Raises: InputError for less than one pose.
    """
    if count < 1:
        raise InputError(f"a plan has at least 1 pose, asked for {count}")
    S = information_of(known, points, views)
    J = goal.J[..., known.free]
    W = np.einsum("mij,mik->jk", J, J) / len(J)
    rows = _greedy(known.information, S, W, min(count, len(views)))
    rows = _exchanged(known.information, S, W, rows)
    order = _greedy(known.information, S[rows], W, len(rows))
    rows = [rows[i] for i in order]
    H, after = known.information, []
    for row in rows:
        H = H + S[row]
        after.append(expected(H, J))
    index = np.array(rows, dtype=np.int64)
    return Plan(views.take(index), index, expected(known.information, J), tuple(after))


def expected(H: Array, J: Array) -> Expected:
    """What information H (f, f) leaves of the goal J (m, 3, f); see `workspace`."""
    C = J @ np.linalg.inv(H) @ np.swapaxes(J, -1, -2)
    return Expected(float(sigma_mm(C).max()), float(radius_mm(C).max()))


def _scores(H: Array, S: Array, W: Array) -> Array:
    """trace(W (H + S_c)^-1) of every candidate (n,), scaled so that units do not spoil the inverse."""
    scale = 1 / np.sqrt(np.diag(H))
    total = (H + S) * scale[:, None] * scale
    return np.asarray(np.sum(np.linalg.inv(total) * (W * scale[:, None] * scale), axis=(1, 2)))


def _greedy(H: Array, S: Array, W: Array, count: int) -> list[int]:
    rows: list[int] = []
    for _ in range(count):
        checkpoint()
        scores = _scores(H, S, W)
        scores[rows] = np.inf  # the same view again tells little of what differs from view to view
        best = int(np.argmin(scores))
        rows.append(best)
        H = H + S[best]
    return rows


def _exchanged(H: Array, S: Array, W: Array, rows: Sequence[int]) -> list[int]:
    """Exchange each chosen candidate for the best of all, until a pass changes nothing."""
    chosen = list(rows)
    for _ in range(MAX_PASSES):
        changed = False
        for k in range(len(chosen)):
            checkpoint()
            others = [r for i, r in enumerate(chosen) if i != k]
            scores = _scores(H + S[others].sum(axis=0), S, W)
            scores[others] = np.inf
            best = int(np.argmin(scores))
            if scores[best] < scores[chosen[k]] * (1 - LEAST_GAIN):
                chosen[k], changed = best, True
        if not changed:
            break
    return chosen
