"""What leaving each moment of a rig out would move: where its cameras are to the first, the lenses held.

A moment is one pose of the target, T_ref_target, seen by some of the cameras; with d = X_ref - t_ref_c,

    X_c = R_ref_c^T d,   dX_c = R_ref_c^T (hat(d) omega_c - v_c) + R_ref_c^T (-hat(X_ref - t_ref_target) omega + v)

for errors omega_c, v_c of T_ref_c and omega, v of the target's pose along the reference's axes (`se3.retract`). The
target's pose is eliminated, and the rest is `influence.left_out`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.review.target_points import target_points
from calibrant.data import CalibrationResult, View, ViewResult
from calibrant.geometry import se3, so3
from calibrant.geometry.frames import FrameGraph

_SAME = 1e-5
"""Metres and radians: how far the target's poses by two cameras of a moment may be apart where one pose was fitted."""

Part = tuple[Array, Array]
"""Reduced H (6 m, 6 m) and g (6 m,) of one moment on the places of m cameras."""


def moments_of_rig(result: CalibrationResult) -> tuple[tuple[str, ...], dict[str, Part]]:
    """The cameras whose places are unknown, and what each moment tells of them; none where the result is of a cell that
    is more than cameras and one target moved by hand.
    """
    names = tuple(result.cameras)
    places = _places(result, names)
    if result.observations is None or places is None or len(names) < 2:
        return (), {}
    fitted = {(v.camera or names[0], v.id): v for v in result.views if v.used and v.T_camera_target is not None}
    views = [v for v in result.observations.views if (v.camera, v.id) in fitted]
    moments: dict[str, list[tuple[View, ViewResult, Array]]] = {}
    for view, points in zip(views, target_points(result, views)):
        moments.setdefault(view.moment, []).append((view, fitted[view.camera, view.id], points))
    parts = {}
    for moment, seen in moments.items():
        poses = np.array([places[v.camera] @ np.asarray(row.T_camera_target) for v, row, _ in seen])
        if np.abs(se3.local(poses[:1], poses)).max() > _SAME:
            return (), {}
        parts[moment] = _part(result, names, places, seen, poses[0])
    return names[1:], parts


def _places(result: CalibrationResult, names: tuple[str, ...]) -> dict[str, Array] | None:
    """T_first_camera of each; None where the result does not tie them."""
    graph = FrameGraph(tolerance_m=np.inf, tolerance_rad=np.inf)
    for t in result.transforms:
        graph = graph.add(t.parent, t.child, t.matrix)
    if not any(set(names) <= set(group) for group in graph.groups()):
        return None
    return {name: np.eye(4) if name == names[0] else graph.T(names[0], name) for name in names}


def _part(
    result: CalibrationResult,
    names: tuple[str, ...],
    places: Mapping[str, Array],
    seen: list[tuple[View, ViewResult, Array]],
    T_ref_target: Array,
) -> Part:
    rows, pose, residuals = [], [], []
    for view, fitted, points in seen:
        camera, T = result.cameras[view.camera], places[view.camera]
        p_ref = se3.apply(T_ref_target, points)
        p = se3.apply(se3.inverse(T), p_ref)
        found, J_p, _ = camera.model.project_with_jacobians(camera.values, p)
        r = found - view.uv
        kept = np.sort(np.argsort(np.sum(r**2, axis=1), kind="stable")[: len(r) - fitted.points_left_out])
        sigma = _sigma(result, view.camera)
        J = J_p[kept] @ T[:3, :3].T / sigma
        own = np.zeros((len(kept), 2, 6 * (len(names) - 1)))
        if view.camera != names[0]:
            at = 6 * (names.index(view.camera) - 1)
            own[..., at : at + 6] = np.concatenate([J @ so3.hat(p_ref[kept] - T[:3, 3]), -J], axis=-1)
        rows.append(own.reshape(-1, own.shape[-1]))
        pose.append(np.concatenate([-J @ so3.hat(p_ref[kept] - T_ref_target[:3, 3]), J], axis=-1).reshape(-1, 6))
        residuals.append(r[kept].ravel() / sigma)
    J, r = np.concatenate(rows), np.concatenate(residuals)
    Q, _ = np.linalg.qr(np.concatenate(pose))
    J, r = J - Q @ (Q.T @ J), r - Q @ (Q.T @ r)
    return J.T @ J, J.T @ r


def _sigma(result: CalibrationResult, camera: str) -> float:
    stated = None if result.cell is None else result.cell.sigma_px.get(camera)
    return float(stated or result.sigma_px or 1.0)
