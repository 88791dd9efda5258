"""Where the uncertainty of a calibration comes from: its covariance as a sum of one term a source.

The unknowns x, all transforms of the cell, are estimated with the nuisances c, all lenses and target sizes, and the
robots' poses. Eliminating these leaves the normal matrix over (x, c); with C = H_xx^-1 the covariance of x for known c,
and G = -C H_xc the shift of x that an error of c causes,

    Cov(x, c) = sum_k [C S_k C, 0; 0, 0]  +  sum_c [G_c; I] Cov(c) [G_c; I]^T

S_k is what noise source k (pixels, robot rotation, robot translation) puts into H: with the poses' normal block H_rr
(all sources), K = H_rr^-1 H_rs, completing the square gives S exactly as a sum over sources,

    S = sum_k [I; -K]^T H_k [I; -K].

The first sum is the share of the noise, the second the share of intrinsics and target size. Cov(camera) is the one the
calibration ended with, whether the same images made it or it was given. A camera's budget is its part of the whole: its
own transform, its target's and its lens, with what it owes to other cameras already in their covariance.

All that holds for the noise levels found, and for errors as independent as they are taken. What the calibration's
covariance has more, because levels are estimates (`optimize.level_spread`) and neighbouring poses err alike
(`cell.certainty`), stands by itself: S, Cov(X, Z) as stated, less all of the above, K. Along directions where K is
above S, the lens owes its error to what moves the transforms too (shared errors, a size), and follows them less than it
would by G: there the transforms' part of all sources is scaled to S. With M for that,

    S = M K M^T + rest,     M = R min(1, L^-1/2) R^-1,     S = R R^T,     K = R L R^T,

so that the sources sum to what the calibration states. The size of a target is in S as far as the motion contradicts it
(`cell.certainty.size`); the rest of its share stands on top of S.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.cell.certainty.size import size_doubt
from calibrant.calibrate.cell.problem.groups import (
    PIXEL,
    TARGET_ROTATION,
    lens_variable,
    scale_variable,
)
from calibrant.calibrate.cell.problem.groups import (
    ROBOT_ROTATION as TURNS,
)
from calibrant.calibrate.cell.problem.groups import (
    ROBOT_TRANSLATION as PLACES,
)
from calibrant.calibrate.cell.problem.layout import Frame, poses_variable, variable
from calibrant.calibrate.cell.problem.problem import Cell
from calibrant.calibrate.solvers.setup import Setup, get_setup
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Measured
from calibrant.data.details import RobotParameters
from calibrant.diagnose.budget.fit_again import CellAgain, fit_again
from calibrant.diagnose.budget.views import PIXELS, ROBOT_ROTATION, ROBOT_TRANSLATION, NoiseLevels
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3
from calibrant.optimize.factors import Factor, FactorBlocks
from calibrant.optimize.problem import Problem

if TYPE_CHECKING:
    from scipy.sparse import csc_array

Columns = dict[str, NDArray[np.int64]]

INTRINSICS, TARGET, LEVELS = "intrinsics", "target", "shared errors and uncertain levels"
LOOP_SOURCES = {
    TARGET_ROTATION: "target rotation",
    TURNS: "flange rotation",
    PLACES: "positions of flange and target",
}
"""Measured target poses do not tell pixels from robot, nor whose positions are noisy (see `problem.pose_pairs`)."""
PHOTO_SOURCES = {PIXEL: PIXELS, TURNS: ROBOT_ROTATION, PLACES: ROBOT_TRANSLATION}

TARGET_SIGMA = 5e-4
"""Relative 1 sigma of a target's size unless stated: 0.1 mm on 200 mm, what a ruler on a print tells."""


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


@dataclass(frozen=True, eq=False)
class CameraBudget:
    """A camera of a cell: its budget, and for one on a gripper the robot poses (n, 4, 4) it looked from, with where the
    board's middle then was in the camera (n, 3); None for one that stands still.

    parent: the frame that a workspace is given in: the base of the robot that carries it, else the first robot's.
    """

    budget: ErrorBudget
    looks: tuple[Array, Array] | None
    parent: str


def error_budget(result: CalibrationResult, *, target_sigma: float = TARGET_SIGMA) -> ErrorBudget:
    """The budget of a hand-eye result's camera, the first one, from what its file holds.

    Args: target_sigma, relative 1 sigma of the target's size as it was measured or made; what the robot's motion says
    of it is taken into account. Raises: InputError for a result of another kind or without the data it was made from;
    RefusedError where the motions do not determine it.
    """
    return next(iter(cell_budgets(result, target_sigma=target_sigma).values())).budget


def cell_budgets(result: CalibrationResult, *, target_sigma: float = TARGET_SIGMA) -> dict[str, CameraBudget]:
    """The budget of every camera, by name. Args and errors as for `error_budget`.

    Raises: InputError for a result whose robot's joints were free: its file does not hold their readings.
    """
    if result.kind != "hand-eye":
        raise InputError(f"an error budget needs a hand-eye result; this one is of kind {result.kind!r}")
    if result.detail(RobotParameters) is not None:
        raise InputError(
            "the uncertainty in a workspace is not available with --identify: what the offsets add to it is not in the "
            "result; calibrate with the corrected robot (its poses), without --identify"
        )
    again = fit_again(result)
    shared, poses = _columns(again.problem)
    totals = _information(again, shared, poses)
    columns = {name: c.ravel() for name, c in shared.items()}
    # The result states the size that the motion tells where there is one target.
    sizes = dict.fromkeys(again.cell.layout.target_names, with_motion(result.target_scale, target_sigma))
    sources = _sources(result, again.cell, columns, totals, sizes)
    out: dict[str, CameraBudget] = {}
    for i, p in enumerate(again.cell.layout.pictures):
        if p.camera not in out:
            out[p.camera] = _camera_budget(result, again, i, columns, sources, sizes[p.target])
    return out


def with_motion(measured: Measured | None, stated: float) -> float:
    """RMS error of the size that the calibration used, given what was known before and what the motion says.

    Both are normal: the size is m +- s with 1 / s^2 = 1 / stated^2 + 1 / sigma^2 and m between 1 and the measured
    value. The calibration used 1, so its error is sqrt((m - 1)^2 + s^2).
    """
    if stated == 0.0 or measured is None or measured.sigma == 0.0:
        return stated
    weight = stated**2 / (stated**2 + measured.sigma**2)
    return float(np.hypot(weight * (measured.value - 1), np.sqrt(weight) * measured.sigma))


def _columns(problem: Problem) -> tuple[Columns, Columns]:
    """Columns of all unknowns but the robots' poses, and behind them those of the poses: (count, size) by name."""
    shared: Columns = {}
    poses: Columns = {}
    at = 0
    arms = [v for v in problem.variables if v.name.startswith(poses_variable(""))]
    for v in (*(v for v in problem.variables if v not in arms), *arms):
        size = len(v.manifold.natural_names)
        (poses if v in arms else shared)[v.name] = at + np.arange(v.count * size).reshape(v.count, size)
        at += v.count * size
    return shared, poses


def _information(again: CellAgain, shared: Columns, poses: Columns) -> dict[str, Array]:
    """Normal matrices over the shared unknowns by source, robot poses eliminated."""
    from scipy.sparse import csc_array  # heavy, and needed only where a budget is asked for
    from scipy.sparse.linalg import splu

    columns, problem = shared | poses, again.problem
    size = 1 + max(int(c.max()) for c in columns.values())
    first = min(int(c.min()) for c in poses.values())
    H: dict[str, csc_array] = {}
    for k, factor in enumerate(problem.factors):
        blocks = factor.blocks(problem.gather(k, again.values), sigma=problem.sigma(factor, again.levels))
        source = _source_of(again.cell, factor)
        H[source] = H.get(source, csc_array((size, size))) + _sparse(factor, blocks, columns, size)
    total = sum(H.values(), csc_array((size, size)))
    K = splu(csc_array(total[first:, first:])).solve(total[first:, :first].toarray())
    lift = np.concatenate([np.eye(first), -K])
    return {source: lift.T @ (part @ lift) for source, part in H.items()}


def _source_of(cell: Cell, factor: Factor) -> str:
    """What the factor's noise is called; without images the robot's is not told from the target's."""
    names = PHOTO_SOURCES if cell.roles else {}
    for group, source in {**LOOP_SOURCES, **names}.items():
        if factor.noise.startswith(group):
            return source
    return factor.noise


def _sparse(factor: Factor, blocks: FactorBlocks, columns: Columns, size: int) -> csc_array:
    """A factor's normal matrix over all unknowns."""
    from scipy.sparse import coo_array, csc_array

    rows: list[NDArray[np.int64]] = []
    cols: list[NDArray[np.int64]] = []
    values: list[Array] = []
    for (a, b), block in blocks.hessian.items():
        i = columns[factor.variables[a]][factor.indices[a]][:, :, None]
        j = columns[factor.variables[b]][factor.indices[b]][:, None, :]
        i, j = np.broadcast_arrays(i, j)
        rows.append(i.ravel())
        cols.append(j.ravel())
        values.append(block.ravel())
        if a != b:
            rows.append(j.ravel())
            cols.append(i.ravel())
            values.append(block.ravel())
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(cols)))
    return csc_array(coo_array(entries, shape=(size, size)))


def _sources(
    result: CalibrationResult,
    cell: Cell,
    columns: Columns,
    totals: Mapping[str, Array],
    sizes: Mapping[str, float],
) -> dict[str, Array]:
    """Covariance over all shared unknowns by source."""
    H = np.sum(list(totals.values()), axis=0)
    size = len(H)
    x = np.concatenate([columns[variable(f)] for f in cell.layout.unknown])
    C = inverse_information(H[np.ix_(x, x)])
    out = {}
    for name, S in totals.items():
        out[name] = np.zeros((size, size))
        out[name][np.ix_(x, x)] = C @ S[np.ix_(x, x)] @ C
    if cell.roles:
        out[INTRINSICS] = np.zeros((size, size))
    for name, role in cell.roles.items():
        if role.camera.covariance is not None and lens_variable(name) in columns:
            lift = _lift(H, C, x, columns[lens_variable(name)])
            out[INTRINSICS] += lift @ role.camera.covariance @ lift.T
    out[TARGET] = np.zeros((size, size))
    for target, sigma in sizes.items():
        if scale_variable(target) in columns:
            lift = _lift(H, C, x, columns[scale_variable(target)])
            out[TARGET] += sigma**2 * lift @ lift.T
    return out


def _lift(H: Array, C: Array, x: NDArray[np.int64], c: NDArray[np.int64]) -> Array:
    """What an error of the nuisances c does to everything: to x by -C H_xc, to themselves as it is."""
    lift = np.zeros((len(H), len(c)))
    lift[x] = -C @ H[np.ix_(x, c)]
    lift[c, np.arange(len(c))] = 1.0
    return lift


def inverse_information(H: Array) -> Array:
    """Inverse of the information of all transforms, scaled. Raises: RefusedError when it is singular."""
    scale = 1 / np.sqrt(np.maximum(np.diag(H), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(H * scale[:, None] * scale)
    # Entries carry rounding of some 1e-16 times the number of sums; four digits of margin.
    if values[0] < 1e-12:
        raise RefusedError("the views do not determine the calibration: no uncertainty can be stated")
    inverse = (vectors / values) @ vectors.T
    return inverse * scale[:, None] * scale


def _camera_budget(
    result: CalibrationResult,
    again: CellAgain,
    i: int,
    columns: Columns,
    sources: Mapping[str, Array],
    size: float,
) -> CameraBudget:
    """The part of the whole that belongs to the camera of list i."""
    layout, p = again.cell.layout, again.cell.layout.pictures[i]
    at, on = (layout.camera_parent(p), p.camera), (layout.target_parent(p), layout.target(p))
    role = again.cell.roles.get(p.camera)
    lens = [] if role is None else [columns[lens_variable(p.camera)]]
    mine = np.concatenate([columns[variable(at)], columns[variable(on)], *lens])
    in_hand = p.camera_robot is not None
    budget = ErrorBudget(
        get_setup("eye-in-hand" if in_hand else "eye-to-hand"),
        result.transform(*at).matrix,
        result.transform(*on).matrix,
        None if role is None else role.camera,
        again.noise_of(p) if role is not None else None,
        _with_rest(
            _stated(result, at, on),
            {name: C[np.ix_(mine, mine)] for name, C in sources.items()},
            size_in_stated=_size_in_stated(result, size),
        ),
        size,
        _notes(again.cell, p.camera),
    )
    if p.camera_robot is None:
        return CameraBudget(budget, None, layout.root)
    data = again.cell.data[i]
    points = [np.zeros(3)] * len(data) if data.views is None else [v.points.mean(axis=0) for v in data.views]
    return CameraBudget(budget, (data.T_base_gripper, se3.apply(data.B, np.array(points))), layout.base(p.robot))


def _notes(cell: Cell, camera: str) -> tuple[str, ...]:
    role = cell.roles.get(camera)
    if role is None:
        return ("Made from target poses: pixels, intrinsics and robot are one noise of the loop.",)
    if role.camera.covariance is None:
        return ("The camera was given without a covariance: its error is not counted.",)
    return ()


def _stated(result: CalibrationResult, *frames: Frame) -> Array | None:
    """The covariance (12, 12) of two transforms together, as the result has it; None where it has none."""
    joint = result.joint_covariance
    if joint is None or result.transform(*frames[0]).covariance is None:
        return None
    rows = np.concatenate([6 * joint.frames.index(f) + np.arange(6) for f in frames])
    return np.asarray(joint.matrix)[np.ix_(rows, rows)]


def _size_in_stated(result: CalibrationResult, sigma: float) -> float:
    """How much of the variance sigma^2 of the target's size the result's covariance holds."""
    if result.target_scale is None or sigma == 0.0:
        return 0.0
    return min(1.0, size_doubt(result.target_scale) / sigma**2)


def _with_rest(stated: Array | None, sources: dict[str, Array], *, size_in_stated: float) -> dict[str, Array]:
    """The sources summing to what the result states, with what it has more; as they are where it states nothing."""
    if stated is None:
        return sources
    held = {**sources, TARGET: size_in_stated * sources[TARGET]}
    beyond = sources[TARGET] - held[TARGET]
    K = np.sum(list(held.values()), axis=0)[:12, :12]
    scale = np.sqrt(np.diag(stated))
    scale = np.where(scale > 0, scale, 1.0)
    values, axes = np.linalg.eigh(stated / scale[:, None] / scale)
    root = scale[:, None] * axes * np.sqrt(np.maximum(values, max(float(values[-1]) * 1e-12, np.finfo(float).tiny)))
    back = np.linalg.inv(root)
    ratios, turned = np.linalg.eigh(back @ K @ back.T)
    root, back = root @ turned, turned.T @ back
    M = np.eye(len(beyond))
    M[:12, :12] = (root / np.sqrt(np.maximum(ratios, 1.0))) @ back
    rest = np.zeros_like(beyond)
    rest[:12, :12] = (root * np.maximum(1 - ratios, 0.0)) @ root.T
    out = {name: M @ C @ M.T for name, C in held.items()}
    return {**out, TARGET: out[TARGET] + beyond, LEVELS: rest}
