"""The constant offset between the clocks of camera and robot, from continuous motion.

    t_robot = t_camera + offset

First the angular speeds say where to look (`time_start`). From there offset, hand-eye transform and target are found in
one least-squares problem over the loop

    A(t_i + offset) X B_i = Z,

A(t) the robot's poses as a smooth function of time (`PoseSpline`). Where several shifts are likely, as with a motion
that repeats, the loop tells which is meant.

The noise of the loop is estimated with it; `time_covariance` says how well the offset is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.arrays import Array
from calibrant.calibrate.clocks.covariance import sandwich
from calibrant.calibrate.clocks.start import LEAST_SAMPLES, PoseSpline, shifts_by_speed
from calibrant.calibrate.reprojection.links import inverse_map
from calibrant.calibrate.solvers.registry import SOLVERS
from calibrant.calibrate.solvers.setup import SETUPS, Setup, get_setup
from calibrant.data import TransformEstimate
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.optimize.factors import Factor
from calibrant.optimize.manifolds import SE3, Euclidean, Variable
from calibrant.optimize.noise import NoiseEstimate, NoiseLevel, estimate_noise
from calibrant.optimize.problem import Problem

LOOP_ROTATION, LOOP_TRANSLATION = "loop rotation", "loop translation"
_FLOORS = {LOOP_ROTATION: 1e-7, LOOP_TRANSLATION: 1e-7}

CLOSED = 0.2
"""Share of the motion that may be left in the loop: noise of a fifth of the motion is no camera's."""
ALIKE = 1.2
"""Times the loop's error of the best offset below which another fits as well. Noise is correlated, so that a likelihood
ratio would decide on differences that are chance."""


@dataclass(frozen=True, eq=False)
class TimeOffset:
    """offset and sigma in seconds: t_robot = t_camera + offset.

    correlation: of the angular speeds at the shift that the refinement starts from.
    camera, target: the transforms refined with it. rms_mm, rms_deg: of the loop; at_zero_mm: of it without offset.
    unexplained: the loop's error over the size of the motion, rotation or translation, the worse.
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
    unexplained: float
    used: NDArray[np.bool_]

    @property
    def misfit(self) -> float:
        """What offsets are compared by: the logarithm of both noise levels, as in their likelihood."""
        return float(sum(np.log(level.sigma) for level in self.noise.values()))


class _LoopFactor(Factor):
    """r = Z^-1 A(t_i + offset) X B_i, as rotation vector or translation."""

    def __init__(self, name: str, spline: PoseSpline, t: Array, B: Array, *, inverted: bool, noise: str) -> None:
        self.spline, self.t, self.B, self.inverted = spline, t, B, inverted
        once = np.zeros(len(t), dtype=np.int64)
        self.rotations = noise == LOOP_ROTATION
        super().__init__(name, variables=("X", "Z", "offset"), indices=(once, once, once), dim=3, noise=noise)

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        X, Z, offset = values[0][0], values[1][0], float(values[2][0, 0])
        G, loop = self._loop(X, offset)
        R, arm_X = G[:, :3, :3], np.einsum("ij,nj->ni", X[:3, :3], self.B[:, :3, 3])
        n, rate = len(loop), self.spline.rate(self.t + offset)[:, :, None]
        # One common pose, Z, on the other side: residuals and derivatives in the axes of Z's parent.
        if self.rotations:
            r = so3.log(loop[:, :3, :3] @ Z[:3, :3].T)
            left = so3.left_jacobian_inverse(r)
            J_X = np.concatenate([left @ R, np.zeros((n, 3, 3))], axis=2)
            J_Z = np.concatenate([-np.swapaxes(left, -1, -2), np.zeros((n, 3, 3))], axis=2)
            return r, (J_X, J_Z, self._by_robot(G, loop, left) @ rate)
        r = loop[:, :3, 3] - Z[:3, 3]
        J_X = np.concatenate([-R @ so3.hat(arm_X), R], axis=2)
        J_Z = np.broadcast_to(np.concatenate([np.zeros((3, 3)), -np.eye(3)], axis=1), (n, 3, 6))
        return r, (J_X, J_Z, self._by_robot(G, loop, None) @ rate)

    def by_robot(self, X: Array, Z: Array, offset: float) -> Array:
        """Derivative (n, 3, 6) of the residuals by the robot's poses: a turn about the base's axes, and a shift."""
        G, loop = self._loop(X, offset)
        left = so3.left_jacobian_inverse(so3.log(loop[:, :3, :3] @ Z[:3, :3].T)) if self.rotations else None
        return self._by_robot(G, loop, left)

    def _by_robot(self, G: Array, loop: Array, left: Array | None) -> Array:
        """`by_robot` of a loop; left: the inverse left Jacobian of its rotations, None of translations."""
        if left is not None:
            D = np.concatenate([left, np.zeros_like(left)], axis=2)
        else:
            arm = loop[:, :3, 3] - G[:, :3, 3]
            D = np.concatenate([-so3.hat(arm), np.broadcast_to(np.eye(3), (len(arm), 3, 3))], axis=2)
        return np.asarray(D @ inverse_map(se3.inverse(G)) if self.inverted else D)

    def _loop(self, X: Array, offset: float) -> tuple[Array, Array]:
        """A(t_i + offset), (n, 4, 4), in the loop's direction, and A X B."""
        G = self.spline.pose(self.t + offset)
        G = se3.inverse(G) if self.inverted else G
        return G, G @ X @ self.B


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
    Raises: InputError for times that do not increase or too few samples; RefusedError when the motion is too slow, too
    even or repeats too well to tell, when the two motions do not belong together or the setup is the other one, or the
    offset may lie beyond `largest`.
    """
    place = get_setup(setup)
    t_robot, A = _checked_series(robot_times, T_base_gripper, "robot")
    t_camera, B = _checked_series(camera_times, T_camera_target, "camera")
    spline = PoseSpline(t_robot, A)
    found: list[TimeOffset] = []
    failure: RefusedError | None = None
    for start, correlation in shifts_by_speed(spline, t_robot, t_camera, B, largest):
        try:
            found.append(_from(place, spline, t_robot, t_camera, B, start, correlation))
        except RefusedError as error:
            failure = failure or error
    if not found:
        raise failure or RefusedError("no offset brings the two motions together; are they of one recording?")
    found.sort(key=lambda answer: answer.misfit)
    if found[0].unexplained > CLOSED:
        raise RefusedError(_open(found[0], place))
    _require_one(found)
    return found[0]


def _from(
    place: Setup, spline: PoseSpline, t_robot: Array, t_camera: Array, B: Array, start: float, correlation: float
) -> TimeOffset:
    """The answer refined from one start. Raises: RefusedError when the samples do not determine it."""
    reach = 5 * float(np.median(np.diff(t_robot)))  # room for the refinement to either side
    used = (t_camera + start - reach >= spline.start) & (t_camera + start + reach <= spline.end)
    if used.sum() < LEAST_SAMPLES:
        raise RefusedError(
            f"only {int(used.sum())} camera samples lie within the robot's; expected {LEAST_SAMPLES} and more"
        )
    t, seen = t_camera[used], B[used]
    try:
        seed = SOLVERS["park"].solve(place.normal_form(spline.pose(t + start)), seen)
    except RefusedError as error:
        raise RefusedError(f"the motion does not determine the offset together with the camera: {error}") from error
    factors = loop_factors(place, spline, t, seen)
    variables = (
        Variable("X", SE3(), seed.X[None]),
        Variable("Z", SE3(), seed.Z[None]),
        Variable("offset", Euclidean(("offset",)), np.array([[start]])),
    )
    sigmas = {LOOP_ROTATION: 1e-3, LOOP_TRANSLATION: 1e-3}
    estimate = estimate_noise(Problem(variables, factors), sigmas=sigmas, floors=_FLOORS)
    if not estimate.solution.converged:
        message = f"the offset did not settle: {estimate.solution.message}"
        raise RefusedError(f"{message}; check that both files show one motion")
    # What the robot's samples are off by is shared by the camera samples between two knots, and those some knots on.
    lags = int(np.ceil(6 * spline.spacing / np.median(np.diff(t_camera))))
    return _offset_answer(place, spline, factors, estimate, correlation, used, lags)


def loop_factors(place: Setup, spline: PoseSpline, t: Array, B: Array) -> tuple[_LoopFactor, ...]:
    """The residuals of the loop, rotations and translations, at moments t (n,) of the camera's clock."""
    return tuple(
        _LoopFactor(noise, spline, t, B, inverted=place.robot_inverted, noise=noise)
        for noise in (LOOP_ROTATION, LOOP_TRANSLATION)
    )


def _offset_answer(
    place: Setup, spline: PoseSpline, factors: tuple[_LoopFactor, ...], estimate: NoiseEstimate, correlation: float,
    used: NDArray[np.bool_], lags: int,
) -> TimeOffset:  # fmt: skip
    solution, t, B = estimate.solution, factors[0].t, factors[0].B
    X, Z, offset = solution.value("X")[0], solution.value("Z")[0], float(solution.value("offset")[0, 0])
    covariance = _offset_covariance(factors, estimate, lags)
    mm, deg = (
        unit * float(np.sqrt(np.mean(np.sum(solution.residuals(noise) ** 2, axis=1))))
        for noise, unit in ((LOOP_TRANSLATION, 1e3), (LOOP_ROTATION, 180 / np.pi))
    )
    robot = spline.pose(t + offset)
    unshifted = place.normal_form(spline.pose(np.clip(t, spline.start, spline.end))) @ X @ B
    moved = max(_spread_of_points(robot[:, :3, 3]), _spread_of_points(B[:, :3, 3]))
    turned = np.sqrt(np.mean(so3.angle(robot[:, :3, :3] @ robot[len(robot) // 2, :3, :3].T) ** 2))
    return TimeOffset(
        offset=offset,
        sigma=float(np.sqrt(covariance[12, 12])),
        correlation=correlation,
        camera=TransformEstimate(place.camera_parent, "camera", X, covariance[:6, :6]),
        target=TransformEstimate(place.target_parent, "target", Z, covariance[6:12, 6:12]),
        noise=dict(estimate.levels),
        rms_mm=mm,
        rms_deg=deg,
        at_zero_mm=1e3 * _spread_of_points(unshifted[:, :3, 3]),
        unexplained=float(max(1e-3 * mm / moved, np.deg2rad(deg) / turned)),
        used=used,
    )


def _offset_covariance(factors: tuple[_LoopFactor, ...], estimate: NoiseEstimate, lags: int) -> Array:
    """Covariance (13, 13) of X, Z and offset."""
    solution = estimate.solution
    X, Z, offset = (solution.value(name) for name in ("X", "Z", "offset"))
    J, r, by_robot = [], [], []
    for factor in factors:
        sigma, n = estimate.levels[factor.noise].sigma, len(factor.t)
        off, by_variable = factor.linearize(*(np.repeat(v, n, axis=0) for v in (X, Z, offset)))
        r.append(off / sigma)
        J.append(np.concatenate(by_variable, axis=2) / sigma)
        by_robot.append(factor.by_robot(X[0], Z[0], float(offset[0, 0])) / sigma)
    return sandwich(
        np.concatenate(J, axis=1),
        np.concatenate(r, axis=1),
        np.concatenate(by_robot, axis=1),
        spline=factors[0].spline,
        t=factors[0].t + float(offset[0, 0]),
        lags=lags,
    )


def _spread_of_points(points: Array) -> float:
    """Root mean square distance of points (n, 3) from their mean."""
    return float(np.sqrt(np.mean(np.sum((points - points.mean(axis=0)) ** 2, axis=1))))


def _open(found: TimeOffset, place: Setup) -> str:
    other = next(name for name in SETUPS if name != place.name)
    return (
        f"the loop does not close: {found.rms_mm:.3g} mm and {found.rms_deg:.3g} deg rms are left of it, "
        f"{100 * found.unexplained:.0f} % of the motion; is the camera mounted otherwise (--setup {other}), are both "
        "files of one recording, and are the poses read as they were written?"
    )


def _require_one(found: list[TimeOffset]) -> None:
    """Raises: RefusedError when another offset closes the loop as well as the best."""
    best = found[0]
    for other in found[1:]:
        alike = other.rms_mm < ALIKE * best.rms_mm and other.rms_deg < ALIKE * best.rms_deg
        apart = abs(other.offset - best.offset)
        if alike and apart > 10 * best.sigma:
            raise RefusedError(
                f"the motion repeats: offsets of {best.offset:.3f} s and {other.offset:.3f} s fit alike; record a "
                f"motion that does not repeat, or search less far (--largest {500 * apart:.0f}ms) where the clocks are "
                "known to be that near"
            )


def _checked_series(times: ArrayLike, poses: ArrayLike, who: str) -> tuple[Array, Array]:
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
