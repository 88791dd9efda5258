"""The plane of the table: what a thing that lies on it cannot be, and what that says of a pose.

A target that lies on the table has the table's normal, and where the table's height is known, that too. Both enter as
measurements of T_base_target with their own sigma (a Kalman update); a height that contradicts the plane is no
measurement but a fault, and the arm does not go there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, isfinite

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import RefusedError
from calibrant.geometry import se3
from calibrant.verification.touch.placing import Placing

OFF = 4.0
"""Sigmas by which a height may differ from the table's: by chance once in 16,000."""


@dataclass(frozen=True)
class Table:
    """A horizontal plane at height z in the base, metres, with sigma_z; sigma_tilt, radians, of its normal and of
    things that lie on it. lies: sigma of the height of what lies on it, where that may be used; inf: it is checked
    alone."""

    z: float = 0.0
    sigma_z: float = 1e-3
    sigma_tilt: float = 2e-3
    lies: float = inf


def check_height(placing: Placing, point: Array, table: Table, *, camera: str) -> None:
    """Raises: RefusedError for a point of the target that is off the table by more than both uncertainties allow."""
    place, J = placing.at(point)
    sigma = float(np.hypot(np.sqrt(J[2] @ placing.covariance @ J[2]), table.sigma_z))
    off = float(place[2]) - table.z
    if abs(off) > OFF * sigma:
        side = "below" if off < 0 else "above"
        raise RefusedError(
            f"camera {camera} puts the target {1e3 * abs(off):.1f} mm {side} the table, {abs(off) / sigma:.1f} times "
            "what "
            f"both are known to ({1e3 * sigma:.2f} mm, 1 sigma): the robot was not sent there. Has the camera been "
            "moved? "
            "Is the marker's size right? Verify the calibration, or say where the table is (--table)"
        )


def lying_on(placing: Placing, table: Table) -> Placing:
    """The placing of a target that lies on the table."""
    normal = placing.T_base_target[:3, 2]
    up = normal if normal[2] > 0 else -normal
    rows, measured, noise = [0, 1], [float(up[1]), float(-up[0])], [table.sigma_tilt**2] * 2
    if isfinite(table.lies):
        rows, noise = [0, 1, 5], [*noise, table.lies**2 + table.sigma_z**2]
        measured = [*measured, table.z - float(placing.T_base_target[2, 3])]
    H, R = np.eye(6)[rows], np.diag(noise)
    K = placing.covariance @ H.T @ np.linalg.inv(H @ placing.covariance @ H.T + R)
    # n x z: the turn that brings the normal upright.
    step = K @ np.array(measured)
    left = np.eye(6) - K @ H
    return replace(
        placing,
        T_base_target=se3.retract(placing.T_base_target, step),
        calibration=left @ placing.calibration @ left.T,
        picture=left @ placing.picture @ left.T + K @ R @ K.T,
        robot=left @ placing.robot @ left.T,
        of_move=left @ placing.of_move,
    )
