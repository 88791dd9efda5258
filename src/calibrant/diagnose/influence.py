"""What leaving each view out would move, from the linearised problem: no calibration is run again.

With the normal equations of the whole at its end, S dx = -g, each view adding S_i and g_i (its own pose eliminated:
S_i = H_ss - H_sp H_pp^-1 H_ps, and g alike), the calibration without view i ends, to first order, at

    dx_i = -(S - S_i)^-1 (g - g_i) + S^-1 g.

What is left at the end of the whole, S^-1 g, is taken off: it is rounding, or what the fit had beside squares of
residuals. Robust weights stay as they ended.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array, Indices, Mask
from calibrant.calibrate.cell.problem.layout import poses_variable, variable
from calibrant.calibrate.cell.problem.problem import cell_problem
from calibrant.calibrate.cell.stated import cell_layout
from calibrant.calibrate.review.target_points import target_points
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.diagnose.budget.fit_again import CellAgain, fit_again
from calibrant.diagnose.rig_influence import moments_of_rig
from calibrant.errors import CalibrantError
from calibrant.geometry import se3, so3
from calibrant.optimize.problem import Problem

_GRID = (20, 15)
_DEGENERATE = 1e-12
"""Relative eigenvalue of the rest's information below which leaving a view out would leave nothing determined."""


@dataclass(frozen=True)
class ViewInfluence:
    """One view left out: what moves, and how many of the result's own sigma at its most moved unknown.

    px: of a camera, RMS over the image without the rotation that the poses take up; mm, deg: of a camera's mounting, or
    of its place to the rig's first camera.
    sigmas is infinite where the others do not determine the result.
    """

    view: str
    camera: str
    sigmas: float
    px: float | None = None
    mm: float | None = None
    deg: float | None = None


def influence(result: CalibrationResult) -> tuple[ViewInfluence, ...]:
    """Of every used view, in order; empty for results that do not hold what it takes.

    >>> import calibrant as cb
    >>> worst = max(influence(cb.read("camera.json")), key=lambda v: v.sigmas)  # doctest: +SKIP
    """
    if result.observations is None:
        return ()
    if result.robot_poses is not None and result.transforms:
        return _of_mounting(result)
    if result.kind == "intrinsics" and len(result.cameras) == 1:
        return _of_lens(result)
    return _of_rig(result) if result.robot_poses is None else ()


def _of_rig(result: CalibrationResult) -> tuple[ViewInfluence, ...]:
    """Of each moment on the camera that it moves most, against the first one."""
    cameras, parts = moments_of_rig(result)
    if len(parts) < 2:
        return ()
    steps = _left_out(*([list(part) for part in zip(*parts.values())]))
    S = np.sum([H for H, _ in parts.values()], axis=0)
    if np.linalg.matrix_rank(S) < len(S):
        return ()
    sigma = np.sqrt(np.diag(np.linalg.inv(S))).reshape(-1, 6)
    out = []
    for moment, step in zip(parts, steps):
        if step is None:
            out.append(ViewInfluence(moment, cameras[0], np.inf))
            continue
        moved = step.reshape(-1, 6)
        most = np.max(np.abs(moved) / sigma, axis=1)
        k = int(np.argmax(most))
        mm, deg = 1e3 * np.linalg.norm(moved[k, 3:]), np.rad2deg(np.linalg.norm(moved[k, :3]))
        out.append(ViewInfluence(moment, cameras[k], float(most[k]), mm=float(mm), deg=float(deg)))
    return tuple(out)


def _of_lens(result: CalibrationResult) -> tuple[ViewInfluence, ...]:
    name, camera = next(iter(result.cameras.items()))
    C = camera.covariance
    if C is None or not result.sigma_px:
        return ()
    free = np.diag(C) > 0
    seen = _used(result, camera)
    parts = [_lens_part(camera, points, uv, T, free) for _, points, uv, T in seen]
    if len(parts) < 2 or not free.any():
        return ()
    steps = _left_out([H for H, _ in parts], [g for _, g in parts])
    sigma = np.sqrt(np.diag(C)[free])
    moves = _over_image(camera, free)
    out = []
    for (view, *_), step in zip(seen, steps):
        if step is None:
            out.append(ViewInfluence(view, name, np.inf))
            continue
        px = float(np.sqrt(np.sum((moves @ step) ** 2) / (len(moves) / 2)))
        out.append(ViewInfluence(view, name, float(np.max(np.abs(step) / sigma)), px=px))
    return tuple(out)


def _used(result: CalibrationResult, camera: Camera) -> list[tuple[str, Array, Array, Array]]:
    """Id, points (n, 3), pixels (n, 2) and pose of each used view, without the points that the fit left out."""
    fitted = {v.id: v for v in result.views if v.used and v.T_camera_target is not None}
    views = [v for v in (result.observations.views if result.observations else ()) if v.id in fitted]
    out = []
    for view, points in zip(views, target_points(result, views)):
        row = fitted[view.id]
        T = np.asarray(row.T_camera_target)
        square = np.sum((camera.project(se3.apply(T, points)) - view.uv) ** 2, axis=1)
        kept = np.sort(np.argsort(square, kind="stable")[: len(square) - row.points_left_out])
        out.append((view.id, points[kept], view.uv[kept], T))
    return out


def _lens_part(camera: Camera, points: Array, uv: Array, T: Array, free: Mask) -> tuple[Array, Array]:
    """Reduced H and g of one view's points (n, 3) on the lens, its pose eliminated; pixels of noise 1."""
    p = se3.apply(T, points)
    found, J_p, J_k = camera.model.project_with_jacobians(camera.values, p)
    pose = np.concatenate([-J_p @ so3.hat(p - T[:3, 3]), J_p], axis=-1).reshape(-1, 6)
    J, r = J_k[..., free].reshape(len(pose), -1), (found - uv).ravel()
    # By the residuals that no pose explains: the same as the Schur complement, without squares of condition.
    Q, _ = np.linalg.qr(pose)
    J, r = J - Q @ (Q.T @ J), r - Q @ (Q.T @ r)
    return J.T @ J, J.T @ r


def _over_image(camera: Camera, free: Mask) -> Array:
    """d pixel / d lens (2n, k) over the image, without what a rotation of the rays takes up."""
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, _GRID[0]), np.linspace(0, height - 1, _GRID[1]))
    p = camera.unproject(np.stack([u.ravel(), v.ravel()], axis=-1))
    p = p[np.isfinite(p).all(axis=-1)]
    _, P, J = camera.model.project_with_jacobians(camera.values, p)
    turn, J = (-P @ so3.hat(p)).reshape(-1, 3), J[..., free].reshape(2 * len(p), -1)
    Q, _ = np.linalg.qr(turn)
    return np.asarray(J - Q @ (Q.T @ J))


def _left_out(H: list[Array], g: list[Array]) -> list[Array | None]:
    """dx of the unknowns without each part; None where the others do not determine them."""
    S, whole = np.sum(H, axis=0), np.sum(g, axis=0)
    scale = 1 / np.sqrt(np.maximum(np.diag(S), np.finfo(float).tiny))
    S, whole = S * scale[:, None] * scale, whole * scale
    at_end = np.linalg.lstsq(S, whole, rcond=None)[0]
    out: list[Array | None] = []
    for part, mine in zip(H, g):
        rest = S - part * scale[:, None] * scale
        if np.linalg.eigvalsh(rest)[0] < _DEGENERATE:
            out.append(None)
        else:
            out.append(scale * (at_end - np.linalg.solve(rest, whole - mine * scale)))
    return out


def _of_mounting(result: CalibrationResult) -> tuple[ViewInfluence, ...]:
    """Of the transforms, lens and target size held, each robot pose eliminated with its view."""
    try:
        again = fit_again(result)
    except CalibrantError:
        return ()
    layout = again.cell.layout
    if len(layout.robots) != 1 or len(layout.pictures) != 1:
        return ()
    p = layout.pictures[0]
    names = [variable(f) for f in layout.unknown]
    columns: dict[str, Indices] = {name: 6 * i + np.arange(6) for i, name in enumerate(names)}
    parts = _moments(again, _as_said(result, again), poses_variable(p.robot), columns)
    if len(parts) < 2:
        return ()
    steps = _left_out(*([list(part) for part in zip(*parts.values())]))
    S = np.sum([H for H, _ in parts.values()], axis=0)
    stated = [result.transform(*f).covariance for f in layout.unknown]
    known = (
        np.concatenate([np.diag(C) for C in stated if C is not None]) if all(c is not None for c in stated) else None
    )
    sigma = np.sqrt(np.diag(np.linalg.inv(S)) if known is None else known)
    at = columns[variable((layout.camera_parent(p), p.camera))]
    out = []
    for moment, step in zip(parts, steps):
        if step is None:
            out.append(ViewInfluence(moment, p.camera, np.inf))
            continue
        mm, deg = 1e3 * np.linalg.norm(step[at[3:]]), np.rad2deg(np.linalg.norm(step[at[:3]]))
        most = float(np.max(np.abs(step) / np.maximum(sigma, np.finfo(float).tiny)))
        out.append(ViewInfluence(moment, p.camera, most, mm=float(mm), deg=float(deg)))
    return tuple(out)


def _as_said(result: CalibrationResult, again: CellAgain) -> Problem:
    """The problem with the robot's poses as the robot said them: `fit_again` holds them where the fit ended, where
    they have their information, and no gradient."""
    layout = cell_layout(result)
    if layout is None:
        return again.problem
    transforms = {f: result.transform(*f).matrix for f in layout.unknown}
    said = replace(again.cell, layout=layout)
    return cell_problem(said, transforms, again.levels, free_sizes=layout.target_names)


def _moments(
    again: CellAgain, problem: Problem, poses: str, columns: Mapping[str, Indices]
) -> dict[str, tuple[Array, Array]]:
    """Reduced H and g by the id of the robot's pose."""
    size = sum(map(len, columns.values()))
    ids = again.cell.data[0].ids
    H, g = np.zeros((len(ids), size + 6, size + 6)), np.zeros((len(ids), size + 6))
    pose: Indices = size + np.arange(6)
    for k, factor in enumerate(problem.factors):
        if poses not in factor.variables:
            continue
        moment = factor.indices[factor.variables.index(poses)]
        blocks = factor.blocks(problem.gather(k, again.values), sigma=problem.sigma(factor, again.levels))
        at = {
            i: pose if n == poses else columns[n] for i, n in enumerate(factor.variables) if n == poses or n in columns
        }
        for a, part in enumerate(blocks.gradient):
            if a in at:
                np.add.at(g, (moment[:, None], at[a]), part)
        for (a, b), block in blocks.hessian.items():
            if a not in at or b not in at:
                continue
            np.add.at(H, (moment[:, None, None], at[a][:, None], at[b]), block)
            if a != b:
                np.add.at(H, (moment[:, None, None], at[b][:, None], at[a]), np.swapaxes(block, 1, 2))
    K = np.linalg.solve(H[:, size:, size:], np.concatenate([H[:, size:, :size], g[:, size:, None]], axis=2))
    S = H[:, :size, :size] - H[:, :size, size:] @ K[:, :, :size]
    return dict(zip(ids, zip(S, g[:, :size] - (H[:, :size, size:] @ K[:, :, size:])[:, :, 0])))
