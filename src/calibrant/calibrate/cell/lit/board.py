"""Is the board flat? Camera and projector triangulate every corner of every capture; a bend is alike in all of them.

On the board's own pose, as the calibration of flat boards has it, the heights of a capture's corners are

    z = p (1, x, y) + a (1 - x^2) + b x y + c (1 - y^2),    x and y in -1 ... 1 across the board,

and a, b, c of all captures scatter about the board's own: their mean over its sigma is Student's t. Lenses that are too
simple bend each capture in another way, by where it is in the picture. A bend has taken poses and lenses along where
few captures hold them, so that what is left of it is the least that it can be.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Check, View
from calibrant.geometry import se3
from calibrant.geometry.triangulation import refine_points, triangulate
from calibrant.optimize.chances import t_tail

NAME = "board-flatness"
CHANCE = 0.01
"""One of a hundred flat boards scatters so, the three ways to bend counted; by as much as `LEAST_BEND` fewer do."""
LEAST_CAPTURES = 4
LEAST_CORNERS = 12
LEAST_BEND = 5e-4
"""Of the board's longer side: less is how flat printed boards are, and moves a calibration by less than it states."""


def flatness_check(result: CalibrationResult, *, camera: str, projector: str, alone: bool) -> Check | None:
    """Whether the board is bent, by the heights of its corners; None where too few captures tell."""
    modes = _modes(result, camera=camera, projector=projector)
    if modes is None:
        return None
    bends, side = modes
    name = NAME if alone else f"{NAME}-{projector}"
    n = len(bends)
    mean = bends.mean(axis=0)
    C = np.atleast_2d(np.cov(bends.T)) / n
    shapes = _shapes()
    heights = shapes @ mean
    across = shapes[int(np.argmax(heights))] - shapes[int(np.argmin(heights))]
    size, sigma = float(np.ptp(heights)), float(np.sqrt(across @ C @ across))
    t = np.abs(mean) / np.maximum(np.sqrt(np.diag(C)), 1e-12)
    chance = float(min(1.0, 3 * 2 * np.min(t_tail(n - 1, t))))
    told = f"{1e3 * size:.2g} ± {1e3 * sigma:.1g} mm from highest to lowest corner, alike in {n} captures"
    if chance > CHANCE or size < LEAST_BEND * side:
        return Check(name, "ok", f"the board is flat as far as camera and projector tell: {told}", 1e3 * size)
    word = "twisted" if abs(mean[1]) > max(abs(mean[0]), abs(mean[2])) else "bent"
    message = (
        f"the board is {word}: its corners, triangulated by camera and projector, are {told}. Lenses and poses bend "
        "with it: what looks like a lens model that does not fit, or like keystone, may be the board. Fix it to a "
        "stiff plate"
    )
    return Check(name, "warn", message, 1e3 * size)


def _modes(result: CalibrationResult, *, camera: str, projector: str) -> tuple[Array, float] | None:
    """a, b, c (n, 3) of every capture, metres, and the board's longer side."""
    between = [t.matrix for t in result.transforms if (t.parent, t.child) == (camera, projector)]
    if result.observations is None or not between:
        return None
    used = {(v.camera, v.id) for v in result.views if v.used}
    pose = {v.id: v.T_camera_target for v in result.views if v.camera == camera}
    seen: dict[str, list[View]] = {
        name: [v for v in result.observations.views if v.camera == name and (name, v.id) in used]
        for name in (camera, projector)
    }
    every = np.concatenate([v.points[:, :2] for v in seen[camera]]) if seen[camera] else np.zeros((0, 2))
    if not len(every) or float(np.ptp(every, axis=0).min()) <= 0:
        return None
    low, high = every.min(axis=0), every.max(axis=0)
    eyes = result.cameras[camera], result.cameras[projector]
    out = []
    lit = {v.moment: v for v in seen[projector]}
    for view in seen[camera]:
        T_camera_target = pose.get(view.id)
        if T_camera_target is None or view.moment not in lit:
            continue
        p = se3.apply(se3.inverse(T_camera_target), _triangulated(view, lit[view.moment], eyes, between[0]))
        p = p[np.isfinite(p).all(axis=1)]
        x, y = 2 * (p[:, 0] - low[0]) / (high[0] - low[0]) - 1, 2 * (p[:, 1] - low[1]) / (high[1] - low[1]) - 1
        A = np.stack([np.ones(len(p)), x, y, 1 - x * x, x * y, 1 - y * y], axis=1)
        if len(p) >= LEAST_CORNERS and np.linalg.matrix_rank(A) == A.shape[1]:
            out.append(np.linalg.lstsq(A, p[:, 2])[0][3:])
    return (np.array(out), float((high - low).max())) if len(out) >= LEAST_CAPTURES else None


def _triangulated(seen: View, lit: View, eyes: tuple[Camera, Camera], T_camera_projector: Array) -> Array:
    """The corners (n, 3) that both have, camera frame, metres."""
    _, i, j = np.intersect1d(seen.point_ids, lit.point_ids, return_indices=True)
    T = np.stack([np.eye(4), T_camera_projector])
    rays = np.stack([eyes[0].unproject(seen.uv[i]), eyes[1].unproject(lit.uv[j])])
    rays = rays[:, np.isfinite(rays).all(axis=(0, 2))]
    if rays.shape[1] < LEAST_CORNERS:
        return np.zeros((0, 3))
    return refine_points(triangulate(rays, T_world_camera=T), rays, T_world_camera=T)


def _shapes() -> Array:
    """The three ways to bend over a board, (81, 3)."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)))
    return np.stack([1 - x * x, x * y, 1 - y * y], axis=1)
