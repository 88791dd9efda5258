"""Hand-camera calibration by self-visibility: the camera sees the gripper it is mounted on, and a plane (closed form).

The gripper is put flat on a planar target, so that its contact plane and the target's plane coincide. Slides 80-86 of
the 2013 lecture, S9, write C_H_G = C_H_W W_H_G; read here as

    T_camera_gripper = T_camera_target T_target_gripper,    T_target_gripper = [Rz(phi), (x, y, 0)]

C the camera, W (world) the target, G the gripper: a matrix maps coordinates of its right frame into its left one. The
gripper's z points out of it, into the board, as the target's z does; features above the contact plane have z < 0.

    1. T_camera_target from the target's points in the image (any pose estimate with its covariance).
    2. Each feature's pixel gives a ray; where it meets the plane z = z_j of the target is q_j, (x, y) of the target.
    3. Two or more features g_j, known in the gripper, give the planar motion in closed form: with centred g and q,
           phi = atan2(sum g x q, sum g . q),    (x, y) = mean(q) - Rz(phi) mean(g).

Two features have one equation to spare, the distance between them, which tells a wrong feature or a gripper that does
not lie flat. The covariance is that of the inputs i = (pixels, target pose, camera) carried through by first order: q
is held by u = project(theta, T (q, z)), so that dq = (dproject/dq)^-1 (du - dproject/dT dT - dproject/dtheta dtheta).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import TransformEstimate, View, as_transform
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3

LEAST_FEATURES = 2
DISAGREEMENT = 4.0
"""Sigmas by which the features may miss each other on the plane: pure chance does so once in 15,000."""


@dataclass(frozen=True, eq=False)
class SelfVisibility:
    """T_gripper_camera with its covariance, from one image.

    angle phi, radians, and position (2,), metres: the gripper on the target's plane. misfit_mm: RMS distance between
    features as seen and as known, with sigma_misfit_mm what the inputs' noise explains of it.
    """

    gripper_camera: TransformEstimate
    angle: float
    position: Array
    misfit_mm: float
    sigma_misfit_mm: float


def calibrate_self_visibility(
    camera: Camera,
    T_camera_target: ArrayLike,
    features_uv: ArrayLike,
    features_gripper: ArrayLike,
    *,
    sigma_px: float,
    covariance_target: ArrayLike | None = None,
    target_by_camera: ArrayLike | None = None,
) -> SelfVisibility:
    """The camera in the gripper from features that it sees of the gripper, which lies flat on a planar target.

    Args: T_camera_target (4, 4) with covariance_target (6, 6) of its points' noise, in `se3.retract`'s chart, and
    target_by_camera (6, k), what it moves by with the camera's parameters (`moved_by_camera`): an error of the lens
    moves board and features alike, and mostly cancels; features_uv (m, 2) px, m >= 2;
    features_gripper (m, 3) metres, gripper frame, z = 0 in the contact plane; sigma_px, noise of a feature per axis.
    Raises: InputError for shapes, fewer than two features, features on one spot, rays that miss the plane; RefusedError
    when the features do not fit each other.
    """
    T, uv, g = _checked_sights(T_camera_target, features_uv, features_gripper, sigma_px)
    _in_image(camera, uv)
    target = np.zeros((6, 6)) if covariance_target is None else np.asarray(covariance_target, dtype=np.float64)
    lens = np.zeros((len(camera.values),) * 2) if camera.covariance is None else camera.covariance

    C = np.zeros((uv.size + 6 + len(lens),) * 2)
    C[: uv.size, : uv.size] = sigma_px**2 * np.eye(uv.size)
    C[uv.size : uv.size + 6, uv.size : uv.size + 6] = target
    C[uv.size + 6 :, uv.size + 6 :] = lens
    if target_by_camera is not None:
        moved = np.eye(len(C))
        moved[uv.size : uv.size + 6, uv.size + 6 :] = np.asarray(target_by_camera, dtype=np.float64)
        C = moved @ C @ moved.T
    q = _on_plane(camera, T, uv, g)
    found = _planar(q, g)
    J = _planar_derivative(found, q, g, _plane_derivative(camera, T, q, g))
    misfit = found[3:]
    expected = J[3:] @ C @ J[3:].T
    rms, sigma = (float(1e3 * np.sqrt(s / len(g))) for s in (misfit @ misfit, np.trace(expected)))
    if rms > DISAGREEMENT * sigma and rms > 1e-6:
        raise RefusedError(
            f"the gripper's features lie {rms:.3g} mm from where they should on the plane, "
            f"{rms / max(sigma, 1e-9):.1f} times what the noise explains; check their "
            "coordinates (their unit, too) and order, and that the gripper lies flat"
        )
    return SelfVisibility(
        as_transform("gripper", "camera", *_gripper_camera(T, found[:3], J[:3], C, uv.size)),
        float(found[0]),
        found[1:3],
        rms,
        sigma,
    )


def moved_by_camera(camera: Camera, view: View, T_camera_target: ArrayLike) -> Array:
    """What a target's pose, fitted to a view with the camera held, moves by with its parameters: (6, k).

    The pose keeps J^T r = 0, so that dT = -(J^T J)^-1 J^T J_theta dtheta.
    """
    T = se3.check(T_camera_target, name="T_camera_target")
    rotated = view.points @ T[:3, :3].T
    _, J_point, J_camera = camera.model.project_with_jacobians(camera.values, rotated + T[:3, 3])
    J = np.concatenate([-J_point @ so3.hat(rotated), J_point], axis=-1).reshape(-1, 6)
    return np.asarray(-np.linalg.lstsq(J, J_camera.reshape(len(J), -1), rcond=None)[0], dtype=np.float64)


def _in_image(camera: Camera, uv: Array) -> None:
    """Raises: InputError for a feature's pixel outside the image."""
    width, height = camera.image_size
    outside = np.any((uv < -0.5) | (uv > [width - 0.5, height - 0.5]), axis=1)
    if outside.any():
        i = int(np.flatnonzero(outside)[0])
        raise InputError(
            f"feature {i + 1} is at pixel ({uv[i, 0]:.6g}, {uv[i, 1]:.6g}), outside the image of {width}x{height} px; "
            "check its u and v"
        )


def _checked_sights(T: ArrayLike, uv: ArrayLike, g: ArrayLike, sigma_px: float) -> tuple[Array, Array, Array]:
    pose = se3.check(T, name="T_camera_target")
    pixels, features = np.asarray(uv, dtype=np.float64), np.asarray(g, dtype=np.float64)
    m = len(pixels)
    if pixels.shape != (m, 2) or features.shape != (m, 3):
        raise InputError(
            f"features: pixels (m, 2) and gripper points (m, 3) go together, got {pixels.shape}, {features.shape}"
        )
    if m < LEAST_FEATURES:
        raise InputError(f"{m} gripper features; two are needed, more are better")
    if not (np.all(np.isfinite(pixels)) and np.all(np.isfinite(features))):
        raise InputError("features hold NaN or infinite numbers")
    if np.ptp(features[:, :2], axis=0).max() <= 0:
        raise InputError("the gripper's features lie above one spot of the plane: their direction tells nothing")
    if not (np.isfinite(sigma_px) and sigma_px >= 0):
        raise InputError(f"sigma_px is the noise of a feature in pixels, 0 or more, got {sigma_px}")
    return pose, pixels, features


def _on_plane(camera: Camera, T_camera_target: Array, uv: Array, g: Array) -> Array:
    """Where the pixels' rays meet the features' planes, (m, 2) metres, x and y of the target."""
    T_target_camera = se3.inverse(T_camera_target)
    ray = camera.unproject(uv) @ T_target_camera[:3, :3].T
    origin = T_target_camera[:3, 3]
    if not np.all(np.isfinite(ray)):
        raise InputError("a feature's pixel lies outside the camera's valid field")
    reach = (g[:, 2] - origin[2]) / ray[:, 2]
    if np.any(~np.isfinite(reach) | (reach <= 0)):
        raise InputError("a feature's ray does not meet the target's plane in front of the camera; check its pixel")
    return np.asarray((origin + reach[:, None] * ray)[:, :2])


def _plane_derivative(camera: Camera, T_camera_target: Array, q: Array, g: Array) -> Array:
    """d q / d (pixels, target pose, camera), (m, 2, 2m + 6 + k); see the module."""
    m, R = len(q), T_camera_target[:3, :3]
    rotated = np.column_stack([q, g[:, 2]]) @ R.T
    _, J_point, J_camera = camera.model.project_with_jacobians(camera.values, rotated + T_camera_target[:3, 3])
    inputs = np.zeros((m, 2, 2 * m + 6 + J_camera.shape[-1]))
    inputs[np.arange(m), 0, 2 * np.arange(m)] = inputs[np.arange(m), 1, 2 * np.arange(m) + 1] = 1.0
    inputs[..., 2 * m : 2 * m + 6] = -np.concatenate([-J_point @ so3.hat(rotated), J_point], axis=-1)
    inputs[..., 2 * m + 6 :] = -J_camera
    return np.asarray(np.linalg.solve(J_point @ R[:, :2], inputs))


def _planar(q: Array, g: Array) -> Array:
    """phi, x, y and the misfits (2m,) of the features on the plane, metres."""
    centred = g[:, :2] - g[:, :2].mean(axis=0)
    phi = np.arctan2(np.sum(centred[:, 0] * q[:, 1] - centred[:, 1] * q[:, 0]), np.sum(centred * q))
    R = _plane_turn(float(phi))
    position = q.mean(axis=0) - R @ g[:, :2].mean(axis=0)
    return np.concatenate([[phi], position, (g[:, :2] @ R.T + position - q).ravel()])


def _planar_derivative(found: Array, q: Array, g: Array, dq: Array) -> Array:
    """Derivative of `_planar`, (3 + 2m, inputs), from d q / d inputs (m, 2, inputs)."""
    centred = g[:, :2] - g[:, :2].mean(axis=0)
    cross, dot = np.sum(centred[:, 0] * q[:, 1] - centred[:, 1] * q[:, 0]), np.sum(centred * q)
    d_cross = np.einsum("m,mi->i", centred[:, 0], dq[:, 1]) - np.einsum("m,mi->i", centred[:, 1], dq[:, 0])
    d_phi = (dot * d_cross - cross * np.einsum("ma,mai->i", centred, dq)) / (cross**2 + dot**2)
    turned = g[:, :2] @ _plane_turn(float(found[0]) + np.pi / 2).T  # d R / d phi is R a quarter turn on
    d_position = dq.mean(axis=0) - turned.mean(axis=0)[:, None] * d_phi
    misfit = turned[:, :, None] * d_phi + d_position - dq
    return np.concatenate([d_phi[None], d_position, misfit.reshape(-1, len(d_phi))])


def _plane_turn(angle: float) -> Array:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _gripper_camera(T: Array, planar: Array, J: Array, C: Array, pixels: int) -> tuple[Array, Array]:
    """T_gripper_camera = T_target_gripper^-1 T_camera_target^-1 and its covariance (6, 6), gripper axes.

    T_camera_gripper moves by omega_t + R_t (0, 0, dphi) and v_t + omega_t x R_t (x, y, 0) + R_t (dx, dy, 0).
    """
    phi, x, y = planar
    R, place = T[:3, :3], np.array([x, y, 0.0])
    T_camera_gripper = T @ se3.make(so3.exp([0, 0, phi]), place)
    D = np.zeros((6, C.shape[0]))
    D[:3] = R[:, 2:] @ J[:1]
    D[3:] = R[:, :2] @ J[1:3]
    columns = slice(pixels, pixels + 6)
    D[:3, columns] += np.eye(3, 6)
    D[3:, columns] += np.hstack([-so3.hat(R @ place), np.eye(3)])
    Rt = T_camera_gripper[:3, :3].T
    # Tangent of the inverse: [[-R^T, 0], [-R^T hat(t), -R^T]].
    inverse = np.block([[-Rt, np.zeros((3, 3))], [-Rt @ so3.hat(T_camera_gripper[:3, 3]), -Rt]])
    E = inverse @ D
    return se3.inverse(T_camera_gripper), E @ C @ E.T
