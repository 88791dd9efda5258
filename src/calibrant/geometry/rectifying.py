"""The turns that rectify a pair: about their centres, until both cameras look the same way, the baseline along an axis.

    r = exp(-log(R_right_left) / 2),    R_rectified_right = w r,    R_rectified_left = w r^T

w the least turn that takes the baseline to x (or, where the cameras stand above each other, to y): J.-Y. Bouguet,
Camera Calibration Toolbox for Matlab.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3, so3


class Turns(NamedTuple):
    """R_rectified_camera (2, 3, 3) of left and right; along: 0 for a baseline along x, 1 along y; baseline: where right
    is from left along it, metres, negative where the sides are exchanged."""

    R_rectified_camera: Array
    along: int
    baseline: float


def rectifying_turns(T_left_right: ArrayLike, *, names: tuple[str, str] = ("left", "right")) -> Turns:
    """How both cameras turn. T_left_right (4, 4): the right camera in the left one, metres; names: for messages.

    Raises: InputError for cameras in one place, or one before the other, whose pictures have no common rows.

    >>> import numpy as np
    >>> turns = rectifying_turns(np.array([[1, 0, 0, 0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]))
    >>> turns.along, turns.baseline, bool(np.allclose(turns.R_rectified_camera, np.eye(3)))
    (0, 0.1, True)
    """
    T_right_left = se3.inverse(np.asarray(T_left_right, dtype=np.float64))
    r = so3.exp(-so3.log(T_right_left[:3, :3]) / 2)
    t = r @ T_right_left[:3, 3]
    along = int(abs(t[1]) > abs(t[0]))
    length = float(np.linalg.norm(t))
    if length == 0 or abs(t[along]) <= abs(t[2]):
        raise InputError(
            f"{names[1]} stands {'where' if length == 0 else 'before or behind'} {names[0]} "
            f"{'is' if length == 0 else 'rather than beside it'}: their pictures have no common rows"
        )
    axis = np.zeros(3)
    axis[along] = np.sign(t[along])
    turn = np.cross(t, axis)
    sine = float(np.linalg.norm(turn))
    w = np.eye(3) if sine == 0 else so3.exp(turn / sine * np.arctan2(sine, float(t @ axis)))
    return Turns(np.stack([w @ r.T, w @ r]), along, -float(np.sign(t[along])) * length)
