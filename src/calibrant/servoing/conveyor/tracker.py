"""Where a moving thing is, how fast it moves and turns: a Kalman filter of constant velocity on SE(3) or SE(2).

State: T_base_object and its rate (omega, v), both along the base's axes, v that of its origin. Over dt

    T <- retract(T, rate dt),   (delta, rate errors) <- [[1, dt], [0, 1]] (delta, rate errors)

exact for a thing that turns about its own origin at a constant rate while it is carried along straight. Noise is an
acceleration that is white, of sqrt(density) m/s^1.5 and rad/s^1.5 (Bar-Shalom, Li and Kirubarajan 2001, section 6.2).
On a belt the rate and the corrections keep to the belt's plane: SE(2) is the subspace of turn about its normal and
shifts along it, and the height and tilt stay what the measurements say they are, as constants.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.optimize.chances import chi2_tail

FIRST_SPEED, FIRST_TURN = 0.5, 2.0
"""1 sigma of the rate before anything is known, m/s and rad/s: wider than belts go."""
FLAT_RAD = np.deg2rad(0.3)
"""1 sigma of how flat a thing lies on its belt: 0.2 mm under one side of 40 mm."""
UNLIKELY = 1e-4
"""Chance below which a measurement is none of this thing's."""


@dataclass(frozen=True)
class Unsteadiness:
    """How far the rate wanders: sigma of its change in one second, m/s and rad/s. Belts and turntables hold theirs."""

    linear: float = 0.02
    angular: float = 0.1


@dataclass(frozen=True, eq=False)
class Tracked:
    """The estimate at time_s: T_base_object (4, 4), rate (6,), covariance (12, 12) of (delta, rate), `se3.retract`'s
    chart; moves (6, k): the rates that are possible; misses: measurements left out in a row."""

    time_s: float
    T_base_object: Array
    rate: Array
    covariance: Array
    moves: Array
    unsteadiness: Unsteadiness
    misses: int = 0

    def at(self, time_s: float) -> Tracked:
        """The estimate for another time, later or somewhat earlier."""
        dt = time_s - self.time_s
        F = np.eye(12)
        F[:6, 6:] = dt * np.eye(6)
        h = abs(dt)
        density = np.r_[np.full(3, self.unsteadiness.angular**2), np.full(3, self.unsteadiness.linear**2)]
        P = self.moves @ self.moves.T
        Q = P * np.sqrt(np.outer(density, density))
        noise = np.block([[Q * h**3 / 3, Q * h**2 / 2], [Q * h**2 / 2, Q * h]])
        return replace(
            self, time_s=time_s, T_base_object=se3.retract(self.T_base_object, self.rate * dt),
            covariance=F @ self.covariance @ F.T + noise,
        )  # fmt: skip

    def measured(self, T_base_object: Array, covariance: Array, time_s: float) -> Tracked:
        """After a measured pose (4, 4) with its covariance (6, 6); one that is too unlikely is left out and counted."""
        before = self.at(time_s)
        off = se3.local(before.T_base_object, T_base_object)
        S = before.covariance[:6, :6] + covariance
        if chi2_tail(6, float(off @ np.linalg.solve(S, off))) < UNLIKELY:
            return replace(before, misses=self.misses + 1)
        gain = np.linalg.solve(S, before.covariance[:6]).T
        step = gain @ off
        keep = np.eye(12)
        keep[:, :6] -= gain
        C = keep @ before.covariance @ keep.T + gain @ covariance @ gain.T
        return replace(
            before, T_base_object=se3.retract(before.T_base_object, step[:6]),
            rate=self.moves @ (self.moves.T @ (before.rate + step[6:])), covariance=0.5 * (C + C.T), misses=0,
        )  # fmt: skip

    @property
    def speed_sigma(self) -> float:
        """1 sigma of the velocity's worst direction, m/s."""
        return float(np.sqrt(max(np.linalg.eigvalsh(self.covariance[9:, 9:])[-1], 0.0)))


def first_seen(
    T_base_object: Array,
    covariance: Array,
    time_s: float,
    *,
    normal: Array | None = None,
    unsteadiness: Unsteadiness | None = None,
) -> Tracked:
    """A thing at its first measurement, of which no motion is known.

    normal (3,): of the belt's plane, base axes, for things that stay on it; None: free in space.
    Raises: InputError for a normal without length.
    """
    moves = np.eye(6) if normal is None else on_plane(normal)
    P = moves @ moves.T
    size = np.r_[np.full(3, FIRST_TURN), np.full(3, FIRST_SPEED)]
    C = np.zeros((12, 12))
    C[:6, :6] = covariance
    C[6:, 6:] = P * np.outer(size, size)
    return Tracked(time_s, T_base_object, np.zeros(6), C, moves, unsteadiness or Unsteadiness())


def laid_flat(T_base_object: Array, covariance: Array, normal: Array) -> tuple[Array, Array]:
    """A measured pose (4, 4) and its covariance (6, 6), of a thing whose z is known to be a plane's normal (3,).

    The tilt that was measured is an observation of its own error, and what goes with it in the covariance is corrected
    too: a small tag tells its tilt badly, and its place where the tilt is known.
    """
    tangents = on_plane(normal)[3:, 1:].T
    z = T_base_object[:3, 2]
    n = np.asarray(normal, dtype=np.float64) / np.linalg.norm(normal)
    tilt = tangents @ np.cross(z, n)  # the turn that brings z to n
    H = np.zeros((2, 6))
    H[:, :3] = tangents
    S = H @ covariance @ H.T + FLAT_RAD**2 * np.eye(2)
    gain = np.linalg.solve(S, H @ covariance).T
    C = covariance - gain @ H @ covariance
    return se3.retract(T_base_object, gain @ tilt), 0.5 * (C + C.T)


def on_plane(normal: Array) -> Array:
    """(6, 3): the turn about a plane's normal and the shifts along it, orthonormal."""
    length = float(np.linalg.norm(normal))
    if not np.isfinite(length) or length == 0:
        raise InputError(f"the belt's normal is {normal}; expected a direction")
    n = np.asarray(normal, dtype=np.float64) / length
    along = np.linalg.svd(n[None])[2][1:]
    out = np.zeros((6, 3))
    out[:3, 0] = n
    out[3:, 1:] = along.T
    return out
