"""What an error of the lens moves the offset of two clocks by: all poses of the target share it, and no noise shows it.

With L L^T the covariance of the lens' parameters, B_k the target's poses by the lens moved by column k of L, and J, r
of the loop at the solution in units of its noise, a Gauss-Newton step from there gives

    d_k = -[(J^T J)^-1 J^T (r(B_k) - r(B))]_offset,     sigma^2 = sigma_noise^2 + sum_k d_k^2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.calibrate.clocks.offset import TimeOffset, loop_factors
from calibrant.calibrate.clocks.start import PoseSpline
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.cameras import Camera


def with_lens_error(
    found: TimeOffset,
    camera: Camera,
    target_poses: Callable[[Camera], Array],
    *,
    robot_times: ArrayLike,
    T_base_gripper: ArrayLike,
    camera_times: ArrayLike,
    setup: str,
) -> TimeOffset:
    """The offset with what the camera's covariance adds to its sigma; as it is where the camera is exact.

    Args: target_poses: T_camera_target (n, 4, 4) by a camera, of the moments `camera_times` (n,); the others as
    `estimate_time_offset` had them.
    """
    if camera.covariance is None:
        return found
    t_robot, A = np.asarray(robot_times, float), np.asarray(T_base_gripper, float)
    t = np.asarray(camera_times, float)[found.used]
    values, vectors = np.linalg.eigh(camera.covariance)
    columns = (vectors * np.sqrt(np.maximum(values, 0.0))).T
    moving = columns[np.max(np.abs(columns), axis=1) > 0]
    place, spline = get_setup(setup), PoseSpline(t_robot, A)
    start = [found.camera.matrix[None], found.target.matrix[None], np.array([[found.offset]])]

    def loop(T: Array) -> tuple[Array, Array]:
        r, J = [], []
        for factor in loop_factors(place, spline, t, T[found.used]):
            off, by = factor.linearize(*(np.repeat(v, len(t), axis=0) for v in start))
            sigma = found.noise[factor.noise].sigma
            r.append(off.ravel() / sigma)
            J.append(np.concatenate(by, axis=2).reshape(-1, 13) / sigma)
        return np.concatenate(r), np.concatenate(J)

    r, J = loop(target_poses(camera))
    scale = 1 / np.linalg.norm(J, axis=0)  # radians, metres and seconds: scaled, no digits are lost
    step = np.linalg.pinv(J * scale)[-1] * scale[-1]
    shifts = [step @ (loop(target_poses(replace(camera, values=camera.values + c)))[0] - r) for c in moving]
    return replace(found, sigma=float(np.sqrt(found.sigma**2 + np.sum(np.square(shifts)))))
