"""Hand-eye from one point: where a depth camera stands, from a point on the gripper that it measures at every pose.

Eye-to-hand, the point p on the gripper:         T_base_camera q_i = T_base_gripper_i p
Eye-in-hand, the point p of the scene (base):    T_gripper_camera q_i = T_base_gripper_i^-1 p

q_i (3,) is the measured point, camera frame. Unknown are the camera's pose, the point, and the scale that all depths
share. Three equations a pose, 9 or 10 unknowns; not determined are

- where the point is along the axis that all poses turn about, and with it the camera along that axis;
- how the camera is turned about a line that all measured points lie on.

A depth camera's noise along its sight is another than across it: s_a z^2 and s_l z, both levels estimated from what the
poses leave, unless each point comes with its covariance. A pose is set aside when noise alone hardly leaves it so
far off (`ODD`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.calibrate.one_point.closed_form import robust_start, start_of
from calibrant.calibrate.one_point.factor import CAMERA, POINT, SCALE, PointFactor
from calibrant.data import RobotPoses, TransformEstimate, as_transform
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3
from calibrant.optimize import SE3, NoiseEstimate, Problem, Variable, VectorPrior, estimate_noise, vector
from calibrant.optimize.chances import f_tail

Setup = Literal["eye-to-hand", "eye-in-hand"]
LEAST_POSES = 6
"""18 equations for 10 unknowns: with fewer, noise and outliers are guessed from a handful of numbers."""
OUTLIERS_FROM = 9
"""Poses from which some may be set aside: a sample of six, and three that judge it."""
ODD = 0.01
"""Chance, all poses counted, below which a pose is set aside. The noise is that of the poses kept, so that it happens
oftener: of 120 good calibrations of 15 poses each, 5 lost a pose."""
WEAK = 1e-3
"""Turns below 0.1 degrees are nobody's intention (`calibrate.tool.tip`)."""
LINEAR = 0.2
"""Radians: a turn that is known no better is no turn that first order describes (it errs by 2 % there)."""
FLOOR = 1e-7
"""Relative noise below which data count as exact: 0.1 micrometres at 1 m."""
MAKERS = 0.02
"""1 sigma of a depth camera's scale before anything is measured: the 2 % that makers of stereo depth cameras state."""
ROUNDS = 12
ACROSS, ALONG, STATED = "across", "along", "stated"


@dataclass(frozen=True, eq=False)
class OnePoint:
    """transform: T_base_camera or T_gripper_camera. point (3,), metres, in the gripper or the base, covariance (3, 3).

    scale: measured over true depth, less 1, with scale_sigma. residuals (n, 3), metres, camera frame: predicted less
    measured; chances (n,): that noise alone leaves a pose as far off; used (n,). sigma_across, radians, and
    sigma_along, 1/m: noise of a point is sigma_across z across the sight and sigma_along z^2 along it; None where each
    point came with its covariance: then level is how many times as large the noise is.
    """

    setup: Setup
    transform: TransformEstimate
    point: Array
    point_covariance: Array
    scale: float
    scale_sigma: float
    residuals: Array
    chances: Array
    used: Mask
    ids: tuple[str, ...]
    sigma_across: float | None
    sigma_along: float | None
    level: float | None

    @property
    def rms_mm(self) -> float:
        """Of the used poses: distance between the predicted and the measured point."""
        return float(1e3 * np.sqrt(np.mean(np.sum(self.residuals[self.used] ** 2, axis=1))))

    @property
    def point_sigma_mm(self) -> Array:
        """1 sigma of the point along x, y, z of its frame."""
        return 1e3 * np.sqrt(np.diag(self.point_covariance))


def calibrate_one_point(
    T_base_gripper: RobotPoses | ArrayLike,
    points: ArrayLike,
    *,
    setup: Setup = "eye-to-hand",
    covariances: ArrayLike | None = None,
    scale_sigma: float = MAKERS,
) -> OnePoint:
    """Where a depth camera is, from one point that it measures at n >= 6 robot poses.

    Args: T_base_gripper (n, 4, 4); points (n, 3) metres, camera frame; covariances (n, 3, 3) m^2 of them, by default
    found from what is left; scale_sigma, 1 sigma of the depths' common factor before, 0 where it is exact.
    Raises: InputError for shapes and too few poses; RefusedError for what these poses cannot tell, naming it.

    >>> import numpy as np
    >>> from calibrant.geometry import se3
    >>> rng = np.random.default_rng(0)
    >>> poses = se3.exp(rng.normal(size=(8, 6)) * [0.5, 0.5, 0.5, 0.1, 0.1, 0.1])
    >>> camera = se3.make(np.eye(3), [0.1, 0.2, -1.0])
    >>> seen = se3.apply(se3.inverse(camera) @ poses, [0.01, 0.02, 0.1])
    >>> found = calibrate_one_point(poses, seen)
    >>> bool(np.allclose(found.transform.matrix, camera, atol=1e-9))
    True
    """
    poses = T_base_gripper if isinstance(T_base_gripper, RobotPoses) else RobotPoses.from_matrices(T_base_gripper)
    q, whitening = _checked(poses, points, covariances, scale_sigma)
    if setup not in ("eye-to-hand", "eye-in-hand"):
        raise InputError(f"setup is eye-to-hand or eye-in-hand, got {setup!r}")
    T = poses.T_base_gripper if setup == "eye-to-hand" else se3.inverse(poses.T_base_gripper)
    data = _Data(T, q, whitening, scale_sigma, setup)
    _require_turns(T, setup)
    _require_spread(q, setup)
    used = np.ones(len(q), dtype=np.bool_)
    start = start_of(T, q)
    if len(q) >= OUTLIERS_FROM:
        start, used = robust_start(T, q, np.random.default_rng(0))
    place, point = start.T_a_camera, start.point
    for _ in range(ROUNDS):
        fit = _fit(data, used, place, point)
        place, point = fit.solution.value(CAMERA)[0], fit.solution.value(POINT)[0]
        chances = _chances(data, fit, used)
        keep = chances >= ODD / len(q)
        if len(q) < OUTLIERS_FROM or np.array_equal(keep, used) or keep.sum() < LEAST_POSES:
            break
        used = keep
    if 2 * used.sum() < len(q) + 1:
        raise RefusedError(
            f"only {used.sum()} of {len(q)} poses agree on one point: is it the same point in all of them, are points "
            "and poses in the same order, and is the unit metres?"
        )
    return _answer(data, fit, used, chances, poses.ids)


@dataclass(frozen=True, eq=False)
class _Data:
    T: Array
    q: Array
    whitening: Array | None
    scale_sigma: float
    setup: Setup


def _checked(
    poses: RobotPoses, points: ArrayLike, covariances: ArrayLike | None, scale_sigma: float
) -> tuple[Array, Array | None]:
    q = np.asarray(points, dtype=np.float64)
    n = len(poses)
    if q.shape != (n, 3) or not np.all(np.isfinite(q)):
        raise InputError(f"{n} poses need {n} finite measured points (n, 3), metres; got shape {q.shape}")
    if n < LEAST_POSES:
        raise InputError(
            f"{n} poses with a measured point; at least {LEAST_POSES} are needed, twice as many are better"
        )
    behind = np.flatnonzero(q[:, 2] <= 0)
    if len(behind):
        raise InputError(
            f"the point of {poses.ids[behind[0]]} has z = {q[behind[0], 2]:g} m: a camera measures in front of it, "
            "z > 0 along its axis, x right, y down"
        )
    if not (np.isfinite(scale_sigma) and scale_sigma >= 0):
        raise InputError(f"scale_sigma is 1 sigma of a factor, 0 or more (0.02 for 2 %); got {scale_sigma}")
    if covariances is None:
        return q, None
    C = np.asarray(covariances, dtype=np.float64)
    if C.shape != (n, 3, 3) or not np.allclose(C, np.swapaxes(C, 1, 2)) or np.linalg.eigvalsh(C).min() <= 0:
        raise InputError(f"covariances of the points are (n, 3, 3), symmetric and positive, m^2; got shape {C.shape}")
    return q, np.asarray(np.linalg.inv(np.linalg.cholesky(C)))


def _require_turns(T: Array, setup: Setup) -> None:
    """Raises: RefusedError where all poses turn about one axis, or not at all."""
    R = T[:, :3, :3]
    _, values, axes = np.linalg.svd((R - R.mean(axis=0)).reshape(-1, 3), full_matrices=False)
    open_ = values < WEAK * np.sqrt(len(R))
    where = "gripper" if setup == "eye-to-hand" else "base"
    if open_.all():
        raise RefusedError(
            f"all poses have the same orientation: where the point is in the {where}, and where the camera is, cannot "
            "be told apart; turn the gripper between poses, about two axes"
        )
    if open_.any():
        axis = ", ".join(f"{c:+.2f}" for c in axes[-1])
        raise RefusedError(
            f"all poses turn about one axis, ({axis}) in the {where}: where the point and the camera are along it "
            "stays open; turn about another axis as well"
        )


def _require_spread(q: Array, setup: Setup) -> None:
    """Raises: RefusedError where the measured points are one, or lie in a line."""
    centred = q - q.mean(axis=0)
    _, values, axes = np.linalg.svd(centred, full_matrices=False)
    far = float(np.linalg.norm(q, axis=1).mean()) * np.sqrt(len(q))
    if values[0] < WEAK * far:
        raise RefusedError(
            "the camera measures the point at one place in all poses: how it is turned cannot be told; move the "
            "gripper, not only turn it"
        )
    if values[1] < WEAK * values[0]:
        axis = ", ".join(f"{c:+.2f}" for c in axes[0])
        raise RefusedError(
            f"all measured points lie in a line, ({axis}) in the camera: how the camera is turned about it cannot be "
            "told; move the gripper to the side as well"
        )


def _sight_axes(q: Array) -> Array:
    """(n, 3, 3): two directions across the sight, and the sight."""
    d = q / np.linalg.norm(q, axis=1, keepdims=True)
    x = np.cross(d, np.eye(3)[np.argmin(np.abs(d), axis=1)])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(d, x), d], axis=1)


def _factors(data: _Data, used: Mask) -> tuple[list[PointFactor], dict[str, float]]:
    T, q = data.T[used], data.q[used]
    if data.whitening is not None:
        return [PointFactor(STATED, T, q, data.whitening[used], noise=STATED)], {STATED: 1.0}
    axes, z = _sight_axes(q), q[:, 2]
    across = PointFactor(ACROSS, T, q, axes[:, :2], noise=ACROSS, relative_sigma=z)
    along = PointFactor(ALONG, T, q, axes[:, 2:], noise=ALONG, relative_sigma=z**2)
    return [across, along], {ACROSS: 1e-3, ALONG: 2e-3}


def _fit(data: _Data, used: Mask, place: Array, point: Array) -> NoiseEstimate:
    factors, levels = _factors(data, used)
    hint = "turn the gripper about two axes, and move it to all sides"
    where = "gripper" if data.setup == "eye-to-hand" else "base"
    exact = data.scale_sigma == 0
    variables = (
        Variable(CAMERA, SE3(), place[None], words="the camera", hint=hint),
        Variable(
            POINT, vector(POINT, point, "xyz").manifold, point[None], words=f"the point in the {where}", hint=hint
        ),
        vector(SCALE, [0.0], ("scale",), held=("scale",) if exact else ()),
    )
    prior = () if exact else (_scale_prior(data.scale_sigma),)
    floors = dict.fromkeys(levels, FLOOR if data.whitening is None else 1e-6)
    fit = estimate_noise(Problem(variables, (*factors, *prior), levels), floors=floors)
    turn = float(np.sqrt(np.linalg.eigvalsh(fit.solution.covariance(CAMERA)[:3, :3])[-1]))
    if turn > LINEAR:
        off = np.concatenate([fit.solution.residuals(f.name) for f in factors], axis=1)
        if data.whitening is not None:
            off = np.linalg.solve(data.whitening[used], off[:, :, None])[:, :, 0]
        left = 1e3 * float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
        raise RefusedError(
            f"how the camera is turned is known to {np.rad2deg(turn):.0f} deg only (1 sigma; the poses agree to "
            f"{left:.2g} mm rms): the measured points lie nearly in a line or hardly move, or points and poses do not "
            "belong together; move the gripper to all sides"
        )
    return fit


def _scale_prior(sigma: float) -> VectorPrior:
    return VectorPrior("scale before", SCALE, 0, np.zeros(1), sqrt_information=np.array([[1 / sigma]]))


def _noise_of(data: _Data, fit: NoiseEstimate) -> Array:
    """Covariances (n, 3, 3) of the measured points at the estimated levels, camera frame."""
    sigmas = fit.solution.sigmas
    if data.whitening is not None:
        root = np.linalg.inv(data.whitening)
        return np.asarray(sigmas[STATED] ** 2 * root @ np.swapaxes(root, 1, 2))
    z = data.q[:, 2]
    sigma = np.stack([sigmas[ACROSS] * z, sigmas[ACROSS] * z, sigmas[ALONG] * z**2], axis=1)
    axes = _sight_axes(data.q)
    return np.asarray(np.swapaxes(axes, 1, 2) @ (sigma[:, :, None] ** 2 * axes))


def _linear(data: _Data, fit: NoiseEstimate) -> tuple[Array, Array]:
    """Residuals (n, 3) of all poses, camera frame, and their slopes (n, 3, 10)."""
    n = len(data.q)
    every = PointFactor("all", data.T, data.q, np.broadcast_to(np.eye(3), (n, 3, 3)), noise="all")
    values = [np.repeat(fit.solution.value(name), n, axis=0) for name in (CAMERA, POINT, SCALE)]
    r, J = every.linearize(*values)
    return r, np.concatenate(J, axis=2)


def _chances(data: _Data, fit: NoiseEstimate, used: Mask) -> Array:
    """Probability (n,) that noise leaves a pose as far off as it is from what the others say."""
    r, J = _linear(data, fit)
    C = fit.solution.joint_covariance([(CAMERA, 0), (POINT, 0), (SCALE, 0)])
    of_fit = J @ C @ np.swapaxes(J, 1, 2)
    noise = _noise_of(data, fit)
    spare = max(3.0 * used.sum() - (10 if data.scale_sigma else 9), 4.0)
    # What is used bends the fit towards itself, what is not is off by both.
    Q = noise + np.where(used, -1.0, 1.0)[:, None, None] * of_fit
    values, vectors = np.linalg.eigh(Q)
    least = 1e-3 * np.linalg.eigvalsh(noise)[:, :1]
    turned = np.einsum("nij,ni->nj", vectors, r)
    chi2 = np.sum(turned**2 / np.maximum(values, least), axis=1)
    inside = np.minimum(chi2, spare * (1 - 1e-12))
    F = np.where(used, inside * (spare - 3) / (spare - inside), chi2) / 3
    return np.where(used, f_tail(3, spare - 3, F), f_tail(3, spare, F))


def _answer(data: _Data, fit: NoiseEstimate, used: Mask, chances: Array, ids: tuple[str, ...]) -> OnePoint:
    solution = fit.solution
    parent = "base" if data.setup == "eye-to-hand" else "gripper"
    level = {name: found.sigma for name, found in fit.levels.items()}
    return OnePoint(
        data.setup,
        as_transform(parent, "camera", solution.value(CAMERA)[0], solution.covariance(CAMERA)),
        solution.value(POINT)[0],
        solution.covariance(POINT),
        float(solution.value(SCALE)[0, 0]),
        float(np.sqrt(solution.covariance(SCALE)[0, 0])),
        _linear(data, fit)[0],
        chances,
        used,
        ids,
        level.get(ACROSS),
        level.get(ALONG),
        level.get(STATED),
    )
