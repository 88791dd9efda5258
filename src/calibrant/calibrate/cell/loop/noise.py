"""Where the loop's disagreement comes from, and the target's size by the robot's motion.

Each view puts the target at Z_i = A_i X B_i(s), B(s) with its translation times the scale s. Its deviation from Z,

    d_i = local(Z, A_i X B_i(s)) ~ N(0, C_i),     C_i = sum_k theta_k V_ik,

has three sources that the lever arm from flange to target tells apart: turns of the flange, positions of the flange,
and the target pose itself. The last is what the images leave uncertain, V the covariance of B for unit pixel noise,
times a variance of its own: lens, flatness and blur err alike over a whole view, which makes its pose less certain
than the scatter of its points says, mostly its tilt. Put down to a robot that turns wrongly instead, a tilt would
count as an error of position by the lever arm, and the scale would follow. Target poses that were measured elsewhere
have a noise of rotation of their own, and share that of positions with the flange.

The variances are those of restricted maximum likelihood, found by scoring in ln theta about Gauss-Newton steps of X, Z
and s: with P = C^-1 - C^-1 J (J^T C^-1 J)^-1 J^T C^-1, the score of theta_k is (d^T P V_k P d - tr(P V_k)) / 2 and its
information at most sum_i tr(C_i^-1 V_ik C_i^-1 V_il) / 2, by which steps are never too long (Patterson and Thompson,
"Recovery of inter-block information when block sizes are unequal", 1971). The restricted log likelihood that they
climb, -(sum_i ln|C_i| + ln|J^T C^-1 J| + d^T P d) / 2, compares fits with and without a source (`image_poses`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.cell.loop.fit import Model, fit_loop, linearised, moved, plain_model, scaled
from calibrant.calibrate.reprojection.links import Link, link_maps
from calibrant.calibrate.solvers.setup import Setup
from calibrant.data import Measured

MAX_ROUNDS = 40
"""Scoring settles in five to ten rounds; a variance that goes to zero takes a few more to its floor."""
SETTLED = 1e-3
"""Change of ln theta, far below its own deviation, sqrt(2 / n) at best."""
LONGEST_STEP = 2.0
"""Of ln theta in a round: a variance that goes to zero goes there in steps."""
FLOORS = np.array([1e-7, 1e-7, 1e-7]) ** 2
"""rad^2, m^2 and rad^2: below is rounding."""
FLOOR_PX = 1e-3
"""Of the images' share, where no noise of the pixels is known: as in `views`, an exact fit."""
SHARES = 3
"""Sources that the numbers left free are divided among."""


@dataclass(frozen=True, eq=False)
class LoopNoise:
    """X, Z (4, 4) and scale with their covariance (in the order of the tangents), and the levels of the three sources.

    flange_rotation (rad), flange_translation (m), target: px per axis that the images' errors amount to, or rad of
    target poses that were measured elsewhere. deviation (n, 6) and statistic (n,) = d_i^T C_i^-1 d_i of every view.
    log_likelihood: restricted, up to a constant; target_spread: 1 sigma of ln target^2, by what the views can tell.
    """

    X: Array
    Z: Array
    scale: float
    covariance: Array
    flange_rotation: float
    flange_translation: float
    target: float
    deviation: Array
    statistic: Array
    used: NDArray[np.bool_]
    freedom: float
    log_likelihood: float
    target_spread: float

    @property
    def size(self) -> Measured:
        """The target's scale, sigma with what the noise of the target poses takes from it.

        The fit multiplies their noise by the scale, which makes it smaller than it is: by the other regression, of the
        robot's motion on theirs, it is larger by n sigma^2 / scale, n numbers of position. The truth lies between.
        """
        sigma = float(np.sqrt(self.covariance[-1, -1]))
        if not self.scale > 0:
            return Measured(self.scale, sigma)
        return Measured(self.scale, float(np.hypot(sigma, 3 * self.used.sum() * sigma**2 / self.scale)))

    @property
    def rms(self) -> tuple[float, float]:
        """Spread of the loop over the views used: mm and deg rms."""
        d = self.deviation[self.used]
        mm = 1e3 * np.sqrt(np.mean(np.sum(d[:, 3:] ** 2, axis=1)))
        return float(mm), float(np.rad2deg(np.sqrt(np.mean(np.sum(d[:, :3] ** 2, axis=1)))))


def fit_loop_noise(
    setup: Setup,
    T_base_gripper: Array,
    B: Array,
    X: Array,
    *,
    used: NDArray[np.bool_] | None = None,
    covariance: Array | None = None,
    least_px: float = FLOOR_PX,
    common: Array | None = None,
    free_scale: bool = True,
    held_px: float | None = None,
) -> LoopNoise:
    """Fit the loop and its noise from a start X (4, 4).

    Args: T_base_gripper, B = T_camera_target (n, 4, 4), metres; used (n,), the views that count; covariance (n, 6, 6)
    of B for unit pixel noise, None for poses measured elsewhere; least_px, noise per axis that the points' scatter
    shows: their poses are no better; common (n, 6, p), how B answers p independent errors of unit variance that all
    views share; free_scale, whether the target's scale is unknown; held_px, the images' level where it is known.
    """
    n = len(B)
    used = np.ones(n, dtype=bool) if used is None else used
    model = plain_model(n, free_scale=free_scale)
    A = setup.normal_form(T_base_gripper)
    begin = fit_loop(A, B, X, model=model, used=used)
    of_A, of_B = _maps(setup, T_base_gripper, begin.X[0], scaled(B, begin.scale))
    V = _sources(of_A, of_B, covariance)
    shared = np.zeros((n, 6, 0)) if common is None else of_B @ common
    state = _State(begin.X, begin.Z, begin.scale, np.zeros(shared.shape[2]))
    floors = FLOORS if covariance is None else np.array([*FLOORS[:2], least_px**2])
    V_used = V if used.all() else V[:, used]
    theta = np.maximum(_first_guess(V_used, begin.deviation[used]), floors)
    moving = slice(None) if held_px is None else slice(2)
    if held_px is not None:
        theta[2] = held_px**2
    for _ in range(MAX_ROUNDS):
        d, J = _linearised(A, B, state, shared, model)
        step, change, N = _round(d[used], J[used], state, theta, V_used, moving, model)
        state = _moved(state, step, model)
        new = theta * np.exp(np.clip(change, -LONGEST_STEP, LONGEST_STEP))
        new[moving] = np.maximum(new[moving], floors[moving])
        settled = bool(np.all(np.abs(np.log(new / theta)) < SETTLED))
        theta = new
        if settled:
            break
    d, J = _linearised(A, B, state, shared, model)
    noise = _noise(theta, V)
    # A view that did not take part is besides off by what the fit leaves uncertain.
    noise[~used] += J[~used] @ N @ np.swapaxes(J[~used], 1, 2)
    levels = np.sqrt(theta)
    return LoopNoise(
        state.Xs[0], state.Zs[0], state.scale, N[: model.unknowns, : model.unknowns],
        float(levels[0]), float(levels[1]), float(levels[2]), d,
        np.einsum("ni,ni->n", d, np.linalg.solve(noise, d[..., None])[..., 0]), used,
        (6 * int(used.sum()) - model.unknowns) / SHARES,
        _log_likelihood(_noise(theta, V_used), d[used], N, state.errors),
        float(np.sqrt(np.linalg.pinv(_information(theta, V_used), hermitian=True)[2, 2])),
    )  # fmt: skip


def _round(
    d: Array, J: Array, state: _State, theta: Array, V: Array, moving: slice, model: Model
) -> tuple[Array, Array, Array]:
    """The step of the unknowns, that of the logarithms of the noise's variances theta, and the unknowns' covariance.

    Args: d (n, 6) and J, as `_linearised` has them for the views that count; V, their sources; moving: the levels that
    are estimated.
    """
    weight = np.asarray(np.linalg.inv(_noise(theta, V)), dtype=np.float64)
    rows = weight @ J
    N = _covariance(J, rows, model.unknowns)
    gradient = _flat(rows).T @ d.reshape(-1)
    gradient[model.unknowns :] += state.errors
    step = -N @ gradient
    change = np.zeros(len(theta))
    change[moving] = _scoring(theta[moving], V[moving], weight, rows, N, d + J @ step)
    return step, change, N


@dataclass(frozen=True, eq=False)
class _State:
    """The unknowns of `loop_fit`, and the errors (p,) that all views share, in their sigmas."""

    Xs: Array
    Zs: Array
    scale: float
    errors: Array


def _linearised(A: Array, B: Array, state: _State, shared: Array, model: Model) -> tuple[Array, Array]:
    """Deviations (n, 6) and rows (n, 6, unknowns + p)."""
    d, J = linearised(A, B, state.Xs, state.Zs, state.scale, model)
    return d + shared @ state.errors, np.concatenate([J, shared], axis=2)


def _moved(state: _State, step: Array, model: Model) -> _State:
    Xs, Zs, scale = moved(state.Xs, state.Zs, state.scale, step[: model.unknowns], model)
    return _State(Xs, Zs, scale, state.errors + step[model.unknowns :])


def _covariance(J: Array, rows: Array, unknowns: int) -> Array:
    """(J^T C^-1 J + prior)^-1; the prior is the unit variance of what all views share."""
    normal = _flat(J).T @ _flat(rows)
    normal[range(unknowns, len(normal)), range(unknowns, len(normal))] += 1.0
    return np.asarray(np.linalg.pinv(normal, rcond=1e-14, hermitian=True), dtype=np.float64)


def _maps(setup: Setup, T_base_gripper: Array, X: Array, B: Array) -> tuple[Array, Array]:
    """(n, 6, 6) each: how d_i answers the tangent of T_base_gripper and of B."""
    rows = np.arange(len(B))
    links = [Link("A", rows, inverted=setup.robot_inverted), Link("X", rows), Link("B", rows)]
    maps = link_maps(links, [T_base_gripper, np.broadcast_to(X, B.shape), B])
    return np.broadcast_to(maps[0], (len(B), 6, 6)), np.broadcast_to(maps[2], (len(B), 6, 6))


def _sources(of_A: Array, of_B: Array, covariance: Array | None) -> Array:
    """V (3, n, 6, 6): covariance of d_i that a unit of each source gives."""
    if covariance is None:
        return np.stack([_outer(of_A[..., :3]), _outer(of_A[..., 3:]) + _outer(of_B[..., 3:]), _outer(of_B[..., :3])])
    by_images = of_B @ covariance @ np.swapaxes(of_B, 1, 2)
    return np.stack([_outer(of_A[..., :3]), _outer(of_A[..., 3:]), by_images])


def _outer(M: Array) -> Array:
    return np.asarray(M @ np.swapaxes(M, -1, -2))


def _first_guess(V: Array, d: Array) -> Array:
    """A third of the spread from each source: by its positions, which every source moves, or its turns."""
    squares = np.array([np.mean(np.sum(d[:, part] ** 2, axis=1)) for part in (slice(0, 3), slice(3, 6))])
    diagonals = np.einsum("knii->ki", V) / V.shape[1]
    traces = np.column_stack([diagonals[:, :3].sum(axis=1), diagonals[:, 3:].sum(axis=1)])
    with np.errstate(divide="ignore"):
        return np.asarray(np.min(np.where(traces > 0, squares / traces, np.inf), axis=1) / SHARES)


def _log_likelihood(C: Array, d: Array, N: Array, errors: Array) -> float:
    """Restricted log likelihood, up to a constant, at the unknowns' best values, where P d = C^-1 d."""
    values = np.linalg.eigvalsh(N)
    volume = float(np.sum(np.log(values[values > 0])))
    squares = float(np.einsum("ni,ni->", d, np.linalg.solve(C, d[..., None])[..., 0])) + float(errors @ errors)
    return 0.5 * (volume - float(np.linalg.slogdet(C)[1].sum()) - squares)


def _information(theta: Array, V: Array) -> Array:
    """(3, 3) of ln theta, restricted to first order: tr(C^-1 V_k C^-1 V_l) / 2 over the views."""
    return np.asarray(0.5 * _traces(np.linalg.inv(_noise(theta, V)) @ V) * np.outer(theta, theta))


def _scoring(theta: Array, V: Array, weight: Array, rows: Array, N: Array, d: Array) -> Array:
    """Change of ln theta of the sources given: theta_k score_k over the information, of REML.

    weight: C^-1; rows: C^-1 J; d, after the step, where P d = C^-1 d. With g = C^-1 d and M = C^-1 J N J^T C^-1 the
    score of each is the sum of V_k times g g^T + M - C^-1, number by number.
    """
    g = weight @ d[..., None]
    inner = g @ np.swapaxes(g, 1, 2) + rows @ N @ np.swapaxes(rows, 1, 2) - weight
    score = theta * (V.reshape(len(V), -1) @ inner.reshape(-1))
    information = _traces(weight @ V) * np.outer(theta, theta)
    return np.asarray(np.linalg.lstsq(information, score, rcond=1e-9)[0])


def _noise(theta: Array, V: Array) -> Array:
    """C (n, 6, 6), the sum of theta_k V_k."""
    return np.asarray((theta @ V.reshape(len(V), -1)).reshape(V.shape[1:]))


def _traces(M: Array) -> Array:
    """(k, l) sums over the views of tr(M_k M_l) for M (k, n, 6, 6)."""
    return np.asarray(M.reshape(len(M), -1) @ np.swapaxes(M, 2, 3).reshape(len(M), -1).T)


def _flat(blocks: Array) -> Array:
    """(n, 6, p) as (6 n, p)."""
    return blocks.reshape(-1, blocks.shape[-1])
