"""The constant offset between the clocks of camera and robot, from continuous motion.

    t_robot = t_camera + offset

First the angular speeds: the board turns in the camera as fast as the gripper turns in the base, whatever the unknown
transforms (Mair et al. 2011; Furrer et al. 2017), so their correlation over shifts peaks at the offset. Then offset,
hand-eye transform and target in one least-squares problem over the loop

    A(t_i + offset) X B_i = Z,

A(t) the robot's poses interpolated: rotations by a cubic spline of rotation vectors between neighbours, positions by a
cubic spline. Noise of the loop is estimated with it, so the sigma of the offset follows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.calibrate.hand_eye.setup import Setup, get_setup
from calibrant.calibrate.hand_eye.solvers.registry import SOLVERS
from calibrant.data import TransformEstimate
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.optimize.factors import Factor
from calibrant.optimize.manifolds import SE3, Euclidean, Variable
from calibrant.optimize.noise import NoiseLevel, estimate_noise
from calibrant.optimize.problem import Problem

Array = NDArray[np.float64]

LOOP_ROTATION, LOOP_TRANSLATION = "loop rotation", "loop translation"
_FLOORS = {LOOP_ROTATION: 1e-7, LOOP_TRANSLATION: 1e-7}

LEAST_CORRELATION = 0.6
"""Angular speeds that belong together agree beyond this at their best shift; by chance 20 samples reach it in one of a
hundred thousand."""
LEAST_SAMPLES = 10
LEAST_SPEED = np.deg2rad(1.0)
"""Radians a second: below it the motion is one of poses held, not of a continuous sweep."""


@dataclass(frozen=True, eq=False)
class TimeOffset:
    """offset and sigma in seconds: t_robot = t_camera + offset.

    correlation: of the angular speeds at the shift that the refinement starts from.
    camera, target: the transforms refined with it. rms_mm, rms_deg: of the loop; at_zero_mm: of it without offset.
    used (n,): camera samples whose moment the robot's samples cover.
    """

    offset: float
    sigma: float
    correlation: float
    camera: TransformEstimate
    target: TransformEstimate
    noise: dict[str, NoiseLevel]
    rms_mm: float
    rms_deg: float
    at_zero_mm: float
    used: NDArray[np.bool_]


class PoseSpline:
    """Robot poses as a smooth function of time. times (m,), increasing; T (m, 4, 4)."""

    def __init__(self, times: Array, T: Array) -> None:
        from scipy.interpolate import CubicSpline
        from scipy.spatial.transform import Rotation, RotationSpline

        self.start, self.end = float(times[0]), float(times[-1])
        self._position = CubicSpline(times, T[:, :3, 3])
        self._rotation = RotationSpline(times, Rotation.from_matrix(T[:, :3, :3]))

    def pose(self, t: Array) -> Array:
        """T (n, 4, 4) at times t (n,)."""
        return se3.make(self._rotation(t).as_matrix(), self._position(t))

    def quaternions(self, t: Array) -> Array:
        """Unit quaternions (n, 4) at times t (n,), neighbours with like signs."""
        q = self._rotation(t).as_quat()
        flips = np.cumprod(np.concatenate([[1.0], np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0)]))
        return q * flips[:, None]

    def rate(self, t: Array) -> Array:
        """Its derivative in the chart of `se3.retract`, (n, 6): angular velocity and velocity in the base."""
        # SciPy's angular rate is along the body's own axes.
        omega = self._rotation(t).apply(self._rotation(t, 1))
        return np.concatenate([omega, self._position(t, 1)], axis=1)


class _LoopFactor(Factor):
    """r = Z^-1 A(t_i + offset) X B_i, as rotation vector or translation."""

    def __init__(self, name: str, spline: PoseSpline, t: Array, B: Array, *, inverted: bool, noise: str) -> None:
        self.spline, self.t, self.B, self.inverted = spline, t, B, inverted
        once = np.zeros(len(t), dtype=np.int64)
        self.rotations = noise == LOOP_ROTATION
        super().__init__(name, variables=("X", "Z", "offset"), indices=(once, once, once), dim=3, noise=noise)

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        X, Z, offset = values[0][0], values[1][0], float(values[2][0, 0])
        at = self.t + offset
        G, rate = self.spline.pose(at), self.spline.rate(at)
        if self.inverted:
            # d(G^-1): omega <- -G^T omega; the position -R^T t moves by -R^T (v - omega x t).
            Rt = np.swapaxes(G[:, :3, :3], -1, -2)
            v = rate[:, 3:] - np.cross(rate[:, :3], G[:, :3, 3])
            rate = -np.concatenate([np.einsum("nij,nj->ni", Rt, w) for w in (rate[:, :3], v)], axis=1)
            G = se3.inverse(G)
        # One common pose, Z, on the other side: residuals and derivatives in the axes of Z's parent.
        loop = G @ X @ self.B
        R, arm_X = G[:, :3, :3], np.einsum("ij,nj->ni", X[:3, :3], self.B[:, :3, 3])
        arm_A = np.einsum("nij,nj->ni", R, arm_X + X[:3, 3])
        n = len(loop)
        if self.rotations:
            r = so3.log(loop[:, :3, :3] @ Z[:3, :3].T)
            left = so3.left_jacobian_inverse(r)
            J_X = np.concatenate([left @ R, np.zeros((n, 3, 3))], axis=2)
            J_Z = np.concatenate([-np.swapaxes(left, -1, -2), np.zeros((n, 3, 3))], axis=2)
            return r, (J_X, J_Z, (left @ rate[:, :3, None]))
        r = loop[:, :3, 3] - Z[:3, 3]
        J_X = np.concatenate([-R @ so3.hat(arm_X), R], axis=2)
        J_Z = np.broadcast_to(np.concatenate([np.zeros((3, 3)), -np.eye(3)], axis=1), (n, 3, 6))
        return r, (J_X, J_Z, (rate[:, 3:] + np.cross(rate[:, :3], arm_A))[:, :, None])


def estimate_time_offset(
    robot_times: ArrayLike,
    T_base_gripper: ArrayLike,
    camera_times: ArrayLike,
    T_camera_target: ArrayLike,
    *,
    setup: str = "eye-in-hand",
    largest: float = 2.0,
) -> TimeOffset:
    """The offset between the clocks, with its sigma.

    Args: times in seconds, increasing; T_base_gripper (m, 4, 4), T_camera_target (n, 4, 4), metres;
    setup, eye-in-hand or eye-to-hand; largest, the offset searched to either side, seconds.
    Raises: InputError for times that do not increase or too few samples; RefusedError when the motion is too slow or
    too even to tell, when the two motions do not belong together, or the offset may lie beyond `largest`.
    """
    place = get_setup(setup)
    t_robot, A = _checked(robot_times, T_base_gripper, "robot")
    t_camera, B = _checked(camera_times, T_camera_target, "camera")
    start, correlation = _by_speed(t_robot, A, t_camera, B, largest)
    spline = PoseSpline(t_robot, A)
    used = (t_camera + start - _reach(t_robot) >= spline.start) & (t_camera + start + _reach(t_robot) <= spline.end)
    if used.sum() < LEAST_SAMPLES:
        raise RefusedError(
            f"only {int(used.sum())} camera samples lie within the robot's; expected {LEAST_SAMPLES} and more"
        )
    t, B = t_camera[used], B[used]
    normal = place.normal_form(spline.pose(t + start))
    try:
        seed = SOLVERS["park"].solve(normal, B)
    except RefusedError as error:
        raise RefusedError(f"the motion does not determine the offset together with the camera: {error}") from error
    return _refined(place, spline, t, B, seed.X, seed.Z, start, correlation, used)


def _refined(
    place: Setup, spline: PoseSpline, t: Array, B: Array, X: Array, Z: Array, start: float, correlation: float,
    used: NDArray[np.bool_],
) -> TimeOffset:  # fmt: skip
    factors = tuple(
        _LoopFactor(noise, spline, t, B, inverted=place.robot_inverted, noise=noise)
        for noise in (LOOP_ROTATION, LOOP_TRANSLATION)
    )
    variables = (
        Variable("X", SE3(), X[None]),
        Variable("Z", SE3(), Z[None]),
        Variable("offset", Euclidean(("offset",)), np.array([[start]])),
    )
    problem = Problem(variables, factors)
    estimate = estimate_noise(problem, sigmas={LOOP_ROTATION: 1e-3, LOOP_TRANSLATION: 1e-3}, floors=_FLOORS)
    solution = estimate.solution
    if not solution.converged:
        raise RefusedError(f"the offset did not settle: {solution.message}; check that both files show one motion")
    offset = float(solution.value("offset")[0, 0])
    sigma = float(np.sqrt(solution.covariance("offset")[0, 0]))
    X, Z = solution.value("X")[0], solution.value("Z")[0]
    turn, shift = (solution.residuals(noise) for noise in (LOOP_ROTATION, LOOP_TRANSLATION))
    unshifted = place.normal_form(spline.pose(np.clip(t, spline.start, spline.end))) @ X @ B
    spread = unshifted[:, :3, 3] - unshifted[:, :3, 3].mean(axis=0)
    return TimeOffset(
        offset=offset,
        sigma=sigma,
        correlation=correlation,
        camera=TransformEstimate(place.camera_parent, "camera", X, solution.covariance("X")),
        target=TransformEstimate(place.target_parent, "target", Z, solution.covariance("Z")),
        noise=dict(estimate.levels),
        rms_mm=1e3 * float(np.sqrt(np.mean(np.sum(shift**2, axis=1)))),
        rms_deg=float(np.rad2deg(np.sqrt(np.mean(np.sum(turn**2, axis=1))))),
        at_zero_mm=1e3 * float(np.sqrt(np.mean(np.sum(spread**2, axis=1)))),
        used=used,
    )


def _checked(times: ArrayLike, poses: ArrayLike, who: str) -> tuple[Array, Array]:
    t = np.asarray(times, dtype=np.float64)
    T = se3.check(poses, name=f"{who} poses")
    if t.ndim != 1 or T.shape != (len(t), 4, 4):
        raise InputError(f"the {who} has {t.shape} times and poses of shape {T.shape}; expected one time a pose")
    if len(t) < LEAST_SAMPLES:
        raise InputError(f"the {who} has {len(t)} samples; expected {LEAST_SAMPLES} and more, of one continuous motion")
    if not np.all(np.isfinite(t)) or np.any(np.diff(t) <= 0):
        i = int(np.argmax(~(np.diff(t) > 0)))
        raise InputError(
            f"the {who}'s times do not increase at sample {i + 1}: {t[i]:.6f} s, then {t[i + 1]:.6f} s; sort the "
            "samples and remove repeated ones"
        )
    return t, T


def _reach(t_robot: Array) -> float:
    """Room that the refinement needs to either side of the best shift: a few of the robot's own steps."""
    return 5 * float(np.median(np.diff(t_robot)))


def _by_speed(t_robot: Array, A: Array, t_camera: Array, B: Array, largest: float) -> tuple[float, float]:
    """Shift (s) at which the angular speeds agree best, and their correlation there."""
    speed = so3.angle(B[1:, :3, :3] @ np.swapaxes(B[:-1, :3, :3], -1, -2)) / np.diff(t_camera)
    if np.median(speed) < LEAST_SPEED and speed.max() < 10 * LEAST_SPEED:
        raise RefusedError(
            f"the target turns at {np.rad2deg(speed.max()):.2g} deg/s at most: too slow to tell an offset; record one "
            "continuous motion that turns about several axes, speeding up and slowing down"
        )
    # The robot's turn over each of the camera's own intervals: the same smoothing on both sides. Both ends are taken
    # from a fine grid of quaternions, chords of which give the angle: |q1 - q0| = 2 sin(angle / 4).
    step = min(float(np.median(np.diff(t_camera))), float(np.median(np.diff(t_robot)))) / 2
    grid = np.arange(t_robot[0], t_robot[-1], step)
    q = PoseSpline(t_robot, A).quaternions(grid)
    first, last = (np.round((t - grid[0]) / step).astype(np.int64) for t in (t_camera[:-1], t_camera[1:]))
    widest = int(np.ceil(largest / step))
    shifts = np.arange(-widest, widest + 1)
    scores = np.full(len(shifts), -1.0)
    for k, shift in enumerate(shifts.tolist()):
        inside = (first + shift >= 0) & (last + shift < len(grid))
        if inside.sum() < max(LEAST_SAMPLES - 1, len(speed) // 3):
            continue
        chord = np.linalg.norm(q[last[inside] + shift] - q[first[inside] + shift], axis=1)
        turned = 4 * np.arcsin(np.minimum(chord / 2, 1.0)) / ((last - first)[inside] * step)
        if turned.std() > 1e-9 and speed[inside].std() > 1e-9:
            scores[k] = np.corrcoef(turned, speed[inside])[0, 1]
    best = int(np.argmax(scores))
    _require_peak(scores, shifts * float(step), best, largest)
    return float(shifts[best] * step), float(scores[best])


def _require_peak(scores: Array, shifts: NDArray[np.floating], best: int, largest: float) -> None:
    """Raises: RefusedError when no shift within the range brings the speeds together."""
    if scores[best] < LEAST_CORRELATION:
        raise RefusedError(
            f"no offset within {largest:g} s brings the two motions together: the angular speeds correlate by "
            f"{max(scores[best], 0.0):.2f} at best; check that the files are of one recording, or search wider "
            "(--largest 10s)"
        )
    if best in (0, len(shifts) - 1):
        raise RefusedError(
            f"the best offset is at the edge of the search, {shifts[best]:.3g} s; search wider (--largest 10s)"
        )
