"""Where the uncertainty of a hand-eye calibration comes from: its covariance as a sum of one term a source.

The unknowns x = (X, Z), camera and target transform, are estimated with the nuisances c = (camera, target scale) and a
correction of every robot pose. Eliminating the corrections view by view leaves the normal matrix over (x, c); with
C = H_xx^-1 the covariance of x for known c, and G = -C H_xc the shift of x that an error of c causes,

    Cov(x, c) = sum_k [C S_k C, 0; 0, 0]  +  sum_c [G_c; I] Cov(c) [G_c; I]^T

S_k is what noise source k (pixels, robot rotation, robot translation) puts into H_xx. For a view whose robot pose r has
the normal block H_rr (all sources), with K = H_rr^-1 H_rs, completing the square gives S exactly as a sum over sources,

    S = sum_k [I; -K]^T H_k [I; -K].

The first sum is the share of the noise, the second the share of intrinsics and target size. Cov(camera) is the one the
calibration ended with, whether the same images made it or it was given.

All that holds for the noise levels found. That they are estimates makes the calibration's covariance larger by a few
percent (`optimize.level_spread`), by f = tr(N^-1 (Cov(X) stated - intrinsics' share)) / 6 with N the noise's share of
Cov(X); f - 1 times that share stands by itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.cell.problem.camera_role import FLOORS
from calibrant.calibrate.cell.problem.pose_pairs import (
    FLANGE_ROTATION,
    SCALE,
    TARGET_ROTATION,
    TARGET_TRANSLATION,
    pose_pair_problem,
)
from calibrant.calibrate.reprojection.factor import ReprojectionFactor, TargetModes, stack
from calibrant.calibrate.reprojection.weights import completed
from calibrant.calibrate.solvers.setup import Setup, get_setup
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Measured, View, ViewResult
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3

if TYPE_CHECKING:
    from calibrant.optimize.factors import FactorBlocks

Array = NDArray[np.float64]

PIXELS, ROBOT_ROTATION, ROBOT_TRANSLATION = "pixels", "robot rotation", "robot translation"
INTRINSICS, TARGET, LEVELS = "intrinsics", "target", "uncertain noise levels"
LOOP_SOURCES = {
    TARGET_ROTATION: "target rotation",
    FLANGE_ROTATION: "flange rotation",
    TARGET_TRANSLATION: "positions of flange and target",
}
"""Measured target poses do not tell pixels from robot, nor whose positions are noisy (see `calibrate.pose_pairs`)."""

ROBOT = slice(6, 12)
"""Where a view's robot pose stands among its unknowns: after X, before Z, camera and target scale."""

TARGET_SIGMA = 5e-4
"""Relative 1 sigma of a target's size unless stated: 0.1 mm on 200 mm, what a ruler on a print tells."""


@dataclass(frozen=True)
class NoiseLevels:
    """1 sigma per axis: pixels, and the robot's poses in radians and metres."""

    pixel: float
    robot_rotation: float
    robot_translation: float


@dataclass(frozen=True, eq=False)
class ErrorBudget:
    """Covariance of (X, Z, camera) by source, each (12 + k, 12 + k) in `se3.retract`'s chart and the camera's units.

    X = T_camera-parent_camera, Z = T_target-parent_target; k is 0 for pose pairs. The sources are independent: their
    sum is the joint covariance. notes: what is not counted, in whole sentences.
    """

    setup: Setup
    X: Array
    Z: Array
    camera: Camera | None
    noise: NoiseLevels | None
    sources: Mapping[str, Array]
    target_sigma: float = 0.0
    notes: tuple[str, ...] = ()

    @property
    def covariance(self) -> Array:
        """Joint covariance of (X, Z, camera), all sources."""
        return np.sum(list(self.sources.values()), axis=0)

    def propagate(self, J: Array) -> dict[str, Array]:
        """Covariance (..., d, d) by source of any function with the Jacobian J (..., d, 12 + k)."""
        return {name: J @ C @ np.swapaxes(J, -1, -2) for name, C in self.sources.items()}


def view_information(
    setup: Setup, views: Sequence[View], T_base_gripper: Array, camera: Camera, X: Array, Z: Array, noise: NoiseLevels
) -> dict[str, Array]:
    """Information of each view about (X, Z, camera, target scale), its robot pose eliminated, by noise source.

    Returns arrays (n, 13 + k, 13 + k) by source; over the sources they sum to the view's reduced normal matrix.
    """
    n, k = len(views), len(camera.values)
    stacked = stack(views)
    factor = ReprojectionFactor(
        "reprojection",
        model=camera.model,
        camera="camera",
        links=setup.links(np.arange(n)),
        views=stacked,
        modes=TargetModes("scale", stacked.points[None]),
    )
    values = (np.tile(X, (n, 1, 1)), T_base_gripper, np.tile(Z, (n, 1, 1)), np.tile(camera.values, (n, 1)))
    blocks = factor.blocks([*values, np.zeros((n, 1))], sigma=noise.pixel)
    H = _stacked(blocks, (6, 6, 6, k, 1))
    robot = {
        ROBOT_ROTATION: np.diag([noise.robot_rotation**-2] * 3 + [0.0] * 3),
        ROBOT_TRANSLATION: np.diag([0.0] * 3 + [noise.robot_translation**-2] * 3),
    }
    return _without_robot({PIXELS: H} | {name: _widened(L, H.shape) for name, L in robot.items()})


def _widened(prior: Array, shape: tuple[int, ...]) -> Array:
    """Information about the robot's pose alone, (6, 6), at its place among all unknowns."""
    out = np.zeros(shape)
    out[:, ROBOT, ROBOT] = prior
    return out


def _without_robot(information: Mapping[str, Array]) -> dict[str, Array]:
    """Information (n, m, m) by source with each view's robot pose eliminated: L^T H_k L, L = [I; -K] (see above)."""
    H = np.sum(list(information.values()), axis=0)
    shared = np.r_[0 : ROBOT.start, ROBOT.stop : H.shape[-1]]
    lift = np.zeros((len(H), H.shape[-1], len(shared)))
    lift[:, shared, np.arange(len(shared))] = 1.0
    lift[:, ROBOT] = -np.linalg.solve(H[:, ROBOT, ROBOT], H[:, ROBOT][..., shared])
    return {name: np.swapaxes(lift, -1, -2) @ S @ lift for name, S in information.items()}


def error_budget(result: CalibrationResult, *, target_sigma: float = TARGET_SIGMA) -> ErrorBudget:
    """The budget of a hand-eye result, from what its file holds.

    Args: target_sigma, relative 1 sigma of the target's size as it was measured or made; what the robot's motion says
    of it is taken into account. Raises: InputError for a result of another kind or without the data it was made from;
    RefusedError where the motions do not determine it.
    """
    setup = _setup_of(result)
    target_sigma = with_motion(result.target_scale, target_sigma)
    X = result.transform(setup.camera_parent, "camera").matrix
    Z = result.transform(setup.target_parent, "target").matrix
    if result.observations is None:
        return _of_pose_pairs(result, setup, X, Z, target_sigma)
    camera, noise = result.camera, noise_of(result)
    views, robot = used_views(result, setup, X, Z)
    information = view_information(setup, views, robot, camera, X, Z, noise)
    totals = {name: S.sum(axis=0) for name, S in information.items()}
    known = {INTRINSICS: (np.arange(12, 12 + len(camera.values)), camera.covariance)}
    notes: tuple[str, ...] = ()
    if camera.covariance is None:
        notes = ("The camera was given without a covariance: its error is not counted.",)
    sources = _with_levels(result, setup, _sources(totals, known, target_sigma))
    return ErrorBudget(setup, X, Z, camera, noise, sources, target_sigma, notes)


def with_motion(measured: Measured | None, stated: float) -> float:
    """RMS error of the size that the calibration used, given what was known before and what the motion says.

    Both are normal: the size is m +- s with 1 / s^2 = 1 / stated^2 + 1 / sigma^2 and m between 1 and the measured
    value. The calibration used 1, so its error is sqrt((m - 1)^2 + s^2).
    """
    if stated == 0.0 or measured is None or measured.sigma == 0.0:
        return stated
    weight = stated**2 / (stated**2 + measured.sigma**2)
    return float(np.hypot(weight * (measured.value - 1), np.sqrt(weight) * measured.sigma))


def noise_of(result: CalibrationResult) -> NoiseLevels:
    """The noise levels that a result made from images states. Raises: InputError when it does not."""
    if result.sigma_px is None or result.sigma_robot is None:
        raise InputError("the result states no noise of pixels and robot; calibrate again from images")
    robot = result.sigma_robot
    floor = FLOORS  # a level at 0 would be infinite information
    return NoiseLevels(
        max(result.sigma_px, floor["pixel"]),
        max(float(np.deg2rad(robot.deg)), floor["robot rotation"]),
        max(1e-3 * robot.mm, floor["robot translation"]),
    )


def used_views(result: CalibrationResult, setup: Setup, X: Array, Z: Array) -> tuple[list[View], Array]:
    """Views that the joint fit used, without the points it left out, and the robot poses (n, 4, 4) it ended with."""
    of_id = {v.id: v for v in result.views if v.used and v.T_camera_target is not None}
    found = [v for v in (result.observations.views if result.observations else ()) if v.moment in of_id]
    if len(found) < 3:
        raise InputError(
            f"the result names {len(found)} used views with their observations, at least 3 are needed; "
            "calibrate again with this version"
        )
    camera = result.camera
    kept, poses, squares = [], [], []
    for view in found:
        fitted = of_id[view.moment]
        T = np.asarray(fitted.T_camera_target)
        residual = camera.project(se3.apply(T, view.points)) - view.uv
        size = np.sum(residual**2, axis=1)
        keep = _kept_points(fitted, view, size)
        kept.append(view.subset(keep))
        squares.append(size[keep])
        poses.append(T)
    B = np.array(poses)
    A = Z @ se3.inverse(B) @ se3.inverse(X)
    all_squares = np.concatenate(squares)
    weighed = completed(kept, all_squares, keep=np.ones(len(all_squares), dtype=bool), unknowns=6 * len(kept))
    return list(weighed), se3.inverse(A) if setup.robot_inverted else A


def _kept_points(fitted: ViewResult, view: View, squares: Array) -> NDArray[np.bool_]:
    """The points of a view without the worst ones: as many as the calibration left out."""
    keep = np.ones(len(view), dtype=bool)
    if fitted.points_left_out:
        keep[np.argsort(squares)[-fitted.points_left_out :]] = False
    return keep


def _setup_of(result: CalibrationResult) -> Setup:
    pairs = {(t.parent, t.child) for t in result.transforms}
    mounted = {"eye-in-hand": ("gripper", "camera"), "eye-to-hand": ("base", "camera")}
    setup = next((name for name, frames in mounted.items() if frames in pairs), None)
    if setup is None or result.robot_poses is None:
        raise InputError(f"an error budget needs a hand-eye result; this one is of kind {result.kind!r}")
    return get_setup(setup)


def _of_pose_pairs(result: CalibrationResult, setup: Setup, X: Array, Z: Array, target_sigma: float) -> ErrorBudget:
    from calibrant.optimize.noise import estimate_noise

    if result.robot_poses is None or result.T_camera_target is None:
        raise InputError("the result holds neither observations nor target poses; calibrate again with this version")
    use = np.array([v.used for v in result.views]) if result.views else np.ones(len(result.robot_poses), dtype=bool)
    robot, B = result.robot_poses.T_base_gripper[use], result.T_camera_target[use]
    start = {TARGET_ROTATION: 1e-3, TARGET_TRANSLATION: 1e-3}
    problem = pose_pair_problem(setup, robot, B, X=X, Z=Z, sigmas=start)
    solution = estimate_noise(problem, floors=FLOORS).solution
    information = {name: np.zeros((len(B), 19, 19)) for name in LOOP_SOURCES.values()}
    for k, factor in enumerate(problem.factors):
        blocks = factor.blocks(problem.gather(k, solution.values), sigma=problem.sigma(factor, solution.sigmas))
        sizes = [1 if name == SCALE else 6 for name in factor.variables]
        H = information[LOOP_SOURCES[factor.noise]]
        begin = ROBOT.start if len(sizes) == 1 else 0
        end = begin + sum(sizes)
        H[:, begin:end, begin:end] += _stacked(blocks, sizes)
    totals = {name: S.sum(axis=0) for name, S in _without_robot(information).items()}
    notes = ("Made from target poses: pixels, intrinsics and robot are one noise of the loop.",)
    sources = _with_levels(result, setup, _sources(totals, {}, target_sigma))
    return ErrorBudget(setup, X, Z, None, None, sources, target_sigma, notes)


def _sources(
    totals: Mapping[str, Array], known: Mapping[str, tuple[NDArray[np.int64], Array | None]], target_sigma: float
) -> dict[str, Array]:
    """Covariances by source from information by noise source over (X, Z, nuisances, scale); see the module."""
    H = np.sum(list(totals.values()), axis=0)
    size = len(H) - 1
    C = inverse_information(H[:12, :12])
    out = {}
    for name, S in totals.items():
        out[name] = np.zeros((size, size))
        out[name][:12, :12] = C @ S[:12, :12] @ C
    for name, (columns, covariance) in known.items():
        lift = np.zeros((size, len(columns)))
        lift[:12] = -C @ H[:12, columns]
        lift[columns, np.arange(len(columns))] = 1.0
        out[name] = np.zeros((size, size)) if covariance is None else lift @ covariance @ lift.T
    shift = np.zeros(size)
    shift[:12] = -C @ H[:12, -1]
    out[TARGET] = target_sigma**2 * np.outer(shift, shift)
    return out


def _with_levels(result: CalibrationResult, setup: Setup, sources: dict[str, Array]) -> dict[str, Array]:
    """The sources with what the noise levels' own uncertainty adds; as they are where the result states nothing."""
    stated = result.transform(setup.camera_parent, "camera").covariance
    if stated is None:
        return sources
    noise = np.sum([C for name, C in sources.items() if name not in (TARGET, INTRINSICS)], axis=0)
    by_noise = stated - sources[INTRINSICS][:6, :6] if INTRINSICS in sources else stated
    # An inverse is convex: less than 1 is rounding, or the weights of points that were left out.
    factor = float(np.trace(np.linalg.solve(noise[:6, :6], by_noise))) / 6
    return {**sources, LEVELS: max(factor - 1, 0.0) * noise}


def inverse_information(H: Array) -> Array:
    """Inverse of the information of (X, Z), scaled. Raises: RefusedError when it is singular."""
    scale = 1 / np.sqrt(np.maximum(np.diag(H), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(H * scale[:, None] * scale)
    # Entries carry rounding of some 1e-16 times the number of sums; four digits of margin.
    if values[0] < 1e-12:
        raise RefusedError("the views do not determine the calibration: no uncertainty can be stated")
    inverse = (vectors / values) @ vectors.T
    return inverse * scale[:, None] * scale


def _stacked(blocks: FactorBlocks, sizes: Sequence[int]) -> Array:
    """Hessian blocks of a factor's slots as one matrix an edge, (m, sum sizes, sum sizes)."""
    starts = np.concatenate([[0], np.cumsum(sizes)])
    m = len(blocks.gradient[0])
    H = np.zeros((m, int(starts[-1]), int(starts[-1])))
    for (a, b), block in blocks.hessian.items():
        rows, columns = slice(starts[a], starts[a + 1]), slice(starts[b], starts[b + 1])
        H[:, rows, columns] = block
        H[:, columns, rows] = np.swapaxes(block, -1, -2)
    return H
