"""A recorded motion: poses at times, interpolated between them, and the moments in which it stands still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

STILL_WINDOW_S = 0.25
STILL_M, STILL_RAD = 0.3e-3, np.deg2rad(0.05)
"""How far a pose may be off within the window, in metres and radians, and still stand: above what encoders' noise moves
a flange by, below what a board's corners show."""


@dataclass(frozen=True, eq=False)
class Motion:
    """times (n,), seconds, increasing; T (n, 4, 4), metres: T_a_b at these times.

    >>> import numpy as np
    >>> T = np.stack([np.eye(4)] * 2); T[1, 0, 3] = 0.2
    >>> float(Motion(np.array([0.0, 2.0]), T).at([0.5])[0, 0, 3])
    0.05
    """

    times: Array
    T: Array

    def __post_init__(self) -> None:
        T = se3.check(self.T, name="T")
        if T.shape != (len(self.times), 4, 4) or len(T) < 1:
            raise InputError(
                f"{len(self.times)} times and poses of shape {T.shape}; expected (n, 4, 4), n of 1 or more"
            )
        if np.any(np.diff(self.times) <= 0):
            raise InputError("the times of a motion increase from each pose to the next")

    @property
    def step(self) -> float:
        """Median time between samples, seconds; 0 of one sample."""
        return float(np.median(np.diff(self.times))) if len(self.times) > 1 else 0.0

    def covers(self, t: ArrayLike) -> Array:
        """Which of the times (k,) lie within the recorded ones."""
        t = np.asarray(t, float)
        return np.asarray((t >= self.times[0]) & (t <= self.times[-1]))

    def at(self, t: ArrayLike) -> Array:
        """T (k, 4, 4) at times (k,): between samples along the geodesic of the rotation and straight in position,

            R(t) = R_i exp(s log(R_i^T R_(i+1))),   p(t) = p_i + s (p_(i+1) - p_i),   s = (t - t_i) / (t_(i+1) - t_i);

        before the first sample and after the last these stand.
        """
        at = np.clip(np.asarray(t, float), self.times[0], self.times[-1])
        if len(self.times) == 1:
            return np.repeat(self.T, len(at), axis=0)
        i = np.clip(np.searchsorted(self.times, at, side="right") - 1, 0, len(self.times) - 2)
        s = ((at - self.times[i]) / (self.times[i + 1] - self.times[i]))[:, None]
        before, after = self.T[i], self.T[i + 1]
        turn = so3.log(np.swapaxes(before[:, :3, :3], -1, -2) @ after[:, :3, :3])
        R = before[:, :3, :3] @ so3.exp(s * turn)
        return se3.make(R, before[:, :3, 3] + s * (after[:, :3, 3] - before[:, :3, 3]))

    def still(self) -> list[tuple[float, float]]:
        """(begin, end) of every stretch, seconds, over which the pose stays within STILL_M and STILL_RAD for
        STILL_WINDOW_S at least; longer gaps between samples count as still where both ends are one pose."""
        if len(self.times) < 2:
            return []
        moving = self._moving()
        edges = np.flatnonzero(np.diff(np.concatenate([[True], moving, [True]]).astype(int)))
        found = [(float(self.times[a]), float(self.times[b])) for a, b in zip(edges[::2], edges[1::2])]
        return [(a, b) for a, b in found if b - a >= STILL_WINDOW_S]

    def _moving(self) -> Array:
        """Whether the pose moves between each sample and the next, (n - 1,)."""
        begin, end = self.times[:-1], self.times[1:]
        centre = (begin + end) / 2
        half = np.maximum(STILL_WINDOW_S, end - begin) / 2
        before, after = self.at(centre - half), self.at(centre + half)
        # A window that leaves the recording at one end is a part of one: what moved in it counts for the whole.
        there = np.minimum(centre + half, self.times[-1]) - np.maximum(centre - half, self.times[0])
        scale = 2 * half / np.maximum(there, 1e-9)
        metres = scale * np.linalg.norm(after[:, :3, 3] - before[:, :3, 3], axis=1)
        radians = scale * so3.angle(np.swapaxes(before[:, :3, :3], -1, -2) @ after[:, :3, :3])
        return np.asarray((metres > STILL_M) | (radians > STILL_RAD))
