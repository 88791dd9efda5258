"""What a picture that is taken early or late moves a target by that moves itself.

Pictures of one moment of a video were taken at one time as far as the clocks of the cameras go, and those may be off by
half of the step from one moment to the next: more would be another moment. A target that moves at v is then off by

    v dt / 2,

alike at all moments for a clock that is late, by itself at each for one that jitters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.problem.clocks import motion_of

ANYWHERE = 1e3
"""Radians and metres: nothing is known."""


def swept(moments: Sequence[str], T: Array, times: Mapping[str, float]) -> tuple[Array, Array]:
    """By how much a target at T (n, 4, 4) may be off, in `se3.retract`'s chart: its covariance by clocks that jitter,
    (n, 6, 6), and by one that is late, (n, 6). Zero where times are not known.

    Where no neighbour in time tells the motion, it is the fastest that others show; where none does, any.
    times: seconds by moment; none where pictures were taken of a target that stood still.
    """
    n = len(moments)
    if n < 2 or not set(moments) <= set(times):
        return np.zeros((n, 6, 6)), np.zeros((n, 6))
    step = float(np.median(np.diff(np.sort([times[m] for m in moments]))))
    motion = motion_of(moments, T, times)
    late = motion.velocity * step / 2
    covariance = late[:, :, None] * late[:, None, :]
    fastest = np.max(np.abs(late[motion.known]), axis=0) if motion.known.any() else np.full(6, ANYWHERE)
    covariance[~motion.known] = np.diag(fastest**2)
    return covariance, late
