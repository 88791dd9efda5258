"""The target's size by the robot's motion: one estimate for the calibration and for the doctor."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.cell.loop.noise import LoopNoise, fit_loop_noise
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.calibrate.reprojection.derivatives import derivatives
from calibrant.calibrate.reprojection.factor import stack
from calibrant.calibrate.solvers.setup import Setup
from calibrant.cameras import Camera
from calibrant.geometry import so3

LEAST_POSES = 4
"""Three poses are 18 numbers for 13 unknowns and three levels of noise."""


def target_size(
    setup: Setup, data: HandEyeViews, X: Array, *, used: NDArray[np.bool_], camera: Camera | None = None
) -> LoopNoise | None:
    """The loop over the views `used` (n,) with the target's scale free; None where they cannot tell it.

    X (4, 4): where the fit starts. camera: with its covariance, where the target poses come from its images.
    """
    if int(used.sum()) < LEAST_POSES:
        return None
    fit = loop_of_views(setup, data, X, used=used, camera=camera)
    value, sigma = fit.size.value, fit.size.sigma
    return fit if np.isfinite(value) and np.isfinite(sigma) and value > 0 and sigma < value else None


def loop_of_views(
    setup: Setup,
    data: HandEyeViews,
    X: Array,
    *,
    used: NDArray[np.bool_],
    camera: Camera | None = None,
    held_px: float | None = None,
) -> LoopNoise:
    """The loop and its noise over the views `used`, the target's scale free; held_px: the images' level, if known."""
    rows = np.flatnonzero(data.use)
    covariance = common = None
    if data.views is not None:
        covariance = data.covariance[rows]
        common = None if camera is None else camera_share(camera, data, rows)
    return fit_loop_noise(
        setup,
        data.T_base_gripper[rows],
        data.B[rows],
        X,
        used=used[rows],
        covariance=covariance,
        least_px=data.sigma_px,
        common=common,
        held_px=held_px,
    )


def camera_share(camera: Camera, data: HandEyeViews, rows: NDArray[np.intp]) -> Array | None:
    """(m, 6, p) change of B of the views `rows` (m,) along p independent errors of the camera, each of 1 sigma.

    dB = -C sum_j J_pose^T W J_camera d(theta) at fixed pixels; d(theta) = L e with L L^T the camera's covariance, whose
    absence means a camera that is exact: None.
    """
    if camera.covariance is None or data.views is None:
        return None
    values, axes = np.linalg.eigh(camera.covariance)
    kept = values > 0
    L = axes[:, kept] * np.sqrt(values[kept])
    stacked = stack(data.views)
    ends, out = stacked.offsets, np.empty((len(rows), 6, L.shape[1]))
    mine = np.concatenate([np.arange(ends[i], ends[i + 1]) for i in rows])
    B = np.repeat(data.B[rows], np.diff(ends)[rows], axis=0)
    arm = np.einsum("nij,nj->ni", B[:, :3, :3], stacked.points[mine])
    _, of_point, of_camera = derivatives(camera, arm + B[:, :3, 3])
    weighted = of_point / stacked.sigma[mine, None, None] ** 2
    of_pose = np.concatenate([-weighted @ so3.hat(arm), weighted], axis=2)
    by_error = of_camera @ L
    stops = np.cumsum(np.diff(ends)[rows])
    for k, (first, last) in enumerate(pairwise((0, *stops.tolist()))):
        pull = of_pose[first:last].reshape(-1, 6).T @ by_error[first:last].reshape(-1, L.shape[1])
        out[k] = -data.covariance[rows[k]] @ pull
    return out
