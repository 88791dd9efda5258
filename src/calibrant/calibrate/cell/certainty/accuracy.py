"""How accurate a robot is, as it is told: errors of its geometry, which no number of poses averages.

An arm of accuracy a reports a flange that is off by a, rms over where it works (and by an angle b; where that is not
said, by a over half the flange's distance from the base: an error of the angle of a joint moves the flange by about
that lever). Links, joints and gears make errors that are functions of the joints, sines and cosines of angles: they are
alike at poses less than a radian, or half that distance, from each other. As a field over poses,

    k(i, j) = exp(-|t_i - t_j|^2 / 2 m^2 - 2 sin^2(angle / 2)),     m half the flange's distance from the base,

half of the variance along the axes of the base and half along those of the flange, a third for each axis. What it moves
everything by does not fall with the number of poses: C_s G F F^T G^T C_s (`pose_errors`). Errors that are the same
everywhere along the base's axes are a move of the base and move nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.certainty.alike import by_place
from calibrant.calibrate.cell.certainty.pose_errors import PoseErrors
from calibrant.errors import InputError
from calibrant.targets.lengths import check_length, format_length, parse_length

LEVER = 0.5
"""Of the flange's distance from its base: simulated arms with errors of links, joints, gears and play have 0.3 to 1."""
ALIKE_RADIANS = 1.0
"""Where the cosine of an angle has fallen to a half."""
WHAT = "robot accuracy"


@dataclass(frozen=True)
class RobotAccuracy:
    """How far the flange is from where the robot says it is, rms: metres, and radians where that is said too."""

    metres: float
    radians: float | None = None

    @property
    def text(self) -> str:
        """As it is typed: 0.3mm, or 0.3mm,0.02deg."""
        angle = "" if self.radians is None else f",{np.rad2deg(self.radians):.6g}deg"
        return f"{format_length(self.metres)}{angle}"


def robot_accuracy(given: RobotAccuracy | float | str) -> RobotAccuracy:
    """From 0.3mm, from 0.3mm,0.02deg, or from metres. Raises: InputError for anything else."""
    if isinstance(given, RobotAccuracy):
        return given
    if not isinstance(given, str):
        return RobotAccuracy(check_length(float(given), what=WHAT))
    length, comma, angle = given.partition(",")
    metres = parse_length(length, what=WHAT)
    if not comma:
        return RobotAccuracy(metres)
    number = angle.strip().removesuffix("deg").strip()
    try:
        degrees = float(number)
    except ValueError:
        degrees = -1.0
    if not angle.strip().endswith("deg") or not 0 < degrees < 180:
        raise InputError(f"{WHAT}: {angle.strip()!r} is not an angle above 0 with its unit, such as 0.02deg")
    return RobotAccuracy(metres, float(np.deg2rad(degrees)))


def accuracy_shares(errors: PoseErrors, accuracy: RobotAccuracy) -> Array:
    """What errors of the robot's geometry add to the covariance (s, s) of the shared unknowns."""
    turn = 1.0 if accuracy.radians is None else accuracy.radians * _lever(errors.T_base_gripper) / accuracy.metres
    E = geometry_field(errors.T_base_gripper, reach=LEVER, radians=ALIKE_RADIANS, turning=turn)
    moved = accuracy.metres * errors.moved(E)
    return np.asarray(moved @ moved.T)


def geometry_field(T: Array, *, reach: float, radians: float, turning: float = 1.0) -> Array:
    """Patterns E (n, 6, k), E E^T the field at poses T (n, 4, 4) of an arm that is off by a metre, rms.

    reach, radians: over what errors are alike, in shares of the flange's distance from the base, and angles; turning:
    the angle of its errors over a metre by the lever.
    """
    lever = _lever(T)
    F = by_place(T, metres=reach / LEVER * lever, radians=radians)
    per_axis = np.array([turning / lever] * 3 + [1.0] * 3) / np.sqrt(3)
    parts = []
    for axes in (T[:, :3, :3], np.broadcast_to(np.eye(3), (len(T), 3, 3))):
        both = np.zeros((len(T), 6, 6))
        both[:, :3, :3] = both[:, 3:, 3:] = axes
        parts.append(np.sqrt(0.5) * np.einsum("nab,nf->nafb", both * per_axis, F).reshape(len(T), 6, -1))
    return np.concatenate(parts, axis=2)


def _lever(T: Array) -> float:
    """By which an angle moves the flange."""
    distance = float(np.sqrt(np.mean(np.sum(T[:, :3, 3] ** 2, axis=1))))
    return max(LEVER * distance, float(np.finfo(float).tiny))
