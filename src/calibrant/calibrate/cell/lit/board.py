"""Is the board flat? All pictures of camera and projector fitted once more, with a bend of the board beside the rest.

    z = a (1 - x^2) + b x y + c (1 - y^2),    x and y in -1 ... 1 across the board,

is the same in every capture, while lenses, poses and the place of the projector are free again: one step of
Gauss-Newton from the calibration, each eye's residuals over their own rms, the terms that boards hardly tell held as
there. What triangulated corners alone would say is no measure of it: a lens that errs where all boards were bends them
alike. How sure it is says the jackknife: the step without each capture in turn. A bend is told where Student's t of
one of the three is beyond chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.reprojection.weak_terms import weak_terms_information
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Check, View
from calibrant.geometry import se3
from calibrant.optimize.chances import t_tail

NAME = "board-flatness"
CHANCE = 0.01
"""One of a hundred flat boards scatters so, the three ways to bend counted; by as much as `LEAST_BEND` fewer do."""
LEAST_CAPTURES = 5
"""Four leave-outs may be alike by chance, whatever the board is."""
LEAST_CORNERS = 12
LEAST_BEND = 5e-4
"""Of the board's longer side: less is how flat printed boards are, and moves a calibration by less than it states."""
_STEP = 1e-6
"""Of the central differences: metres and radians, and of each parameter's size."""
_FARTHEST = 4.0
"""Sigmas from which a corner was left out of the calibration, too."""


@dataclass(frozen=True, eq=False)
class _Eye:
    """A lens, where it stands to the camera, its views by capture, and the columns of its free parameters."""

    lens: Camera
    T_camera_eye: Array
    views: dict[str, View]
    free: tuple[int, ...]


def flatness_check(result: CalibrationResult, *, camera: str, projector: str, alone: bool) -> Check | None:
    """Whether the board is bent, by all pictures of both; None where too few captures tell."""
    found = bends(result, camera=camera, projector=projector)
    if found is None:
        return None
    shape, C, n, side = found
    name = NAME if alone else f"{NAME}-{projector}"
    shapes = _shapes()
    heights = shapes @ shape
    across = shapes[int(np.argmax(heights))] - shapes[int(np.argmin(heights))]
    size, sigma = float(np.ptp(heights)), float(np.sqrt(across @ C @ across))
    t = np.abs(shape) / np.maximum(np.sqrt(np.diag(C)), 1e-12)
    chance = float(min(1.0, 3 * 2 * np.min(t_tail(n - 1, t))))
    told = f"{1e3 * size:.2g} ± {1e3 * sigma:.1g} mm from highest to lowest corner"
    if chance > CHANCE or size < LEAST_BEND * side:
        return Check(name, "ok", f"the board is flat as far as camera and projector tell: {told}", 1e3 * size)
    word = "twisted" if abs(shape[1]) > max(abs(shape[0]), abs(shape[2])) else "bent"
    message = (
        f"the board is {word}: all pictures of camera and projector fit best with {told}, alike in {n} captures. "
        "Lenses and poses bend with it: what looks like a lens model that does not fit, or like keystone, may be the "
        "board. Fix it to a stiff plate"
    )
    return Check(name, "warn", message, 1e3 * size)


def bends(result: CalibrationResult, *, camera: str, projector: str) -> tuple[Array, Array, int, float] | None:
    """a, b, c (3,), metres, their covariance (3, 3), how many captures told, and the board's longer side."""
    between = [t.matrix for t in result.transforms if (t.parent, t.child) == (camera, projector)]
    if result.observations is None or not between:
        return None
    used = {(v.camera, v.id) for v in result.views if v.used}
    poses = {v.id: v.T_camera_target for v in result.views if v.camera == camera and v.T_camera_target is not None}
    seen = [v for v in result.observations.views if (v.camera, v.id) in used and len(v) >= LEAST_CORNERS]
    lit = {v.moment: v for v in seen if v.camera == projector}
    mine = {v.moment: v for v in seen if v.camera == camera and v.id in poses and v.moment in lit}
    if len(mine) < LEAST_CAPTURES:
        return None
    every = np.concatenate([v.points[:, :2] for v in mine.values()])
    low, high = every.min(axis=0), every.max(axis=0)
    if float((high - low).min()) <= 0:
        return None
    eyes = (
        _eye(result.cameras[camera], np.eye(4), mine),
        _eye(result.cameras[projector], between[0], {m: lit[m] for m in mine}),
    )
    of_each = [(m, poses[view.id]) for m, view in mine.items()]
    rows = [_linear(eyes, T, m, (k, len(mine)), (low, high)) for k, (m, T) in enumerate(of_each)]
    prior = _prior(eyes, rows[0][0].shape[1])
    whole = _solved(rows, prior)
    without = np.array([_solved([r for j, r in enumerate(rows) if j != k], prior) for k in range(len(rows))])
    n = len(rows)
    d = without - without.mean(axis=0)
    return whole, (n - 1) / n * d.T @ d, n, float((high - low).max())


def _eye(lens: Camera, T_camera_eye: Array, views: dict[str, View]) -> _Eye:
    free = tuple(j for j, name in enumerate(lens.model.parameter_names) if lens.sigma.get(name, 0.0) > 0)
    return _Eye(lens, T_camera_eye, views, free)


def _linear(
    eyes: tuple[_Eye, _Eye], T_camera_target: Array, moment: str, at_of: tuple[int, int], ends: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Rows of one capture, the k-th of n (at_of), over their rms: derivatives after (bend 3, lenses, place of the
    projector 6, poses 6 n), and observed less predicted."""
    k, n = at_of
    lenses = [len(eye.free) for eye in eyes]
    first, place = (3, 3 + lenses[0]), 3 + sum(lenses)
    pose = place + 6 + 6 * k
    A_all, r_all = [], []
    for i, eye in enumerate(eyes):
        view = eye.views[moment]
        bend = _heights(view.points, *ends)

        def pixels(x: Array, lens: Array, eye: _Eye = eye, view: View = view, bend: Array = bend) -> Array:
            T = se3.inverse(se3.retract(eye.T_camera_eye, x[9:])) @ se3.retract(T_camera_target, x[3:9])
            p = view.points + np.outer(bend @ x[:3], [0.0, 0.0, 1.0])
            return np.asarray(eye.lens.model.project(lens, se3.apply(T, p))).ravel()

        x0, at = np.zeros(15), eye.lens.values
        A = np.zeros((view.uv.size, place + 6 + 6 * n))
        steps = [_STEP * np.eye(15)[j] for j in range(15)]
        found = np.stack([(pixels(s, at) - pixels(-s, at)) / (2 * _STEP) for s in steps], axis=1)
        A[:, :3], A[:, pose : pose + 6] = found[:, :3], found[:, 3:9]
        if i:
            A[:, place : place + 6] = found[:, 9:]
        for column, j in enumerate(eye.free):
            h = _STEP * max(abs(at[j]), 1.0) * np.eye(len(at))[j]
            A[:, first[i] + column] = (pixels(x0, at + h) - pixels(x0, at - h)) / (2 * h[j])
        r = view.uv.ravel() - pixels(x0, at)
        off = np.linalg.norm(r.reshape(-1, 2), axis=1)
        rms = float(np.median(off)) / np.sqrt(np.log(4.0))  # per axis: the median of Rayleigh's distribution
        keep = np.repeat(np.isfinite(off) & (off <= _FARTHEST * max(rms, 1e-9)), 2)
        A_all.append(A[keep] / max(rms, 1e-9))
        r_all.append(r[keep] / max(rms, 1e-9))
    return np.concatenate(A_all), np.concatenate(r_all)


def _prior(eyes: tuple[_Eye, _Eye], columns: int) -> tuple[Array, Array]:
    """What lenses do, where the boards tell hardly: rows and what they ask for."""
    A_all, r_all, first = [], [], 3
    for eye in eyes:
        W = weak_terms_information(eye.lens)
        A = np.zeros((len(W), columns))
        A[:, first : first + len(eye.free)] = W[:, list(eye.free)]
        A_all.append(A)
        r_all.append(-W @ eye.lens.values)
        first += len(eye.free)
    return np.concatenate(A_all), np.concatenate(r_all)


def _solved(rows: list[tuple[Array, Array]], prior: tuple[Array, Array]) -> Array:
    """The bend (3,) of the least squares of these captures; columns are scaled to be alike in size."""
    A, r = (np.concatenate(part) for part in zip(*rows, prior))
    scale = np.maximum(np.linalg.norm(A, axis=0), 1e-12)
    return np.asarray((np.linalg.lstsq(A / scale, r)[0] / scale)[:3])


def _heights(points: Array, low: Array, high: Array) -> Array:
    """What a bend of 1 raises points by, (n, 3)."""
    x, y = (2 * (points[:, :2] - low) / (high - low) - 1).T
    return np.stack([1 - x * x, x * y, 1 - y * y], axis=1)


def _shapes() -> Array:
    """The three ways to bend over a board, (81, 3)."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)))
    return np.stack([1 - x * x, x * y, 1 - y * y], axis=1)
