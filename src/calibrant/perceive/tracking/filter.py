"""An object from picture to picture: a filter of constant velocity over poses, each measurement gated.

State: T_frame_object and its twist (omega, v) in the frame, rad/s and m/s, errors in `se3.retract`'s chart. Between
pictures the twist is integrated, and drifts as white acceleration would make it (Bar-Shalom, Li and Kirubarajan 2001,
"Estimation with applications to tracking and navigation", section 6.2.2): with density q,

    Q = q [[dt^3 / 3, dt^2 / 2], [dt^2 / 2, dt]]

Of the poses that look the same, that nearest to the prediction is the measurement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.optimize.chances import chi2_tail
from calibrant.perceive.object_pose.poses import ObjectPose

GATE = 1e-4
"""Chance below which a measurement is another object's or an outlier: one good picture in ten thousand is left out."""
LOST = 5
"""Pictures in a row without a measurement that fits, after which the object counts as lost."""


@dataclass(frozen=True)
class Motion:
    """How restless things are: acceleration's density, rad^2/s^3 and m^2/s^3. A thing on a belt: 1 mm/s in a second."""

    turn: float = (0.02) ** 2
    shift: float = (0.005) ** 2
    start_turn: float = 1.0
    start_speed: float = 0.5
    """1 sigma of the twist before anything is known, rad/s and m/s."""

    def __post_init__(self) -> None:
        if min(self.turn, self.shift, self.start_turn, self.start_speed) <= 0:
            raise InputError("a filter's densities and first sigmas are above 0")


@dataclass(frozen=True, eq=False)
class Track:
    """What is known of an object at a time. covariance (12, 12): pose, then twist; accepted: whether the last
    measurement was taken; chance: of a disagreement as large, NaN before a second one; missed: pictures in a row
    without one."""

    pose: ObjectPose
    twist: Array
    covariance: Array
    time_s: float
    motion: Motion
    accepted: bool = True
    chance: float = float("nan")
    missed: int = 0

    @classmethod
    def start(cls, pose: ObjectPose, time_s: float, *, motion: Motion | None = None) -> Track:
        """From a first pose, its speed unknown."""
        m = motion or Motion()
        P = np.zeros((12, 12))
        P[:6, :6] = pose.covariance
        P[6:, 6:] = np.diag([m.start_turn**2] * 3 + [m.start_speed**2] * 3)
        return cls(pose, np.zeros(6), P, time_s, m)

    @property
    def lost(self) -> bool:
        """Whether the object has not been seen for too long."""
        return self.missed >= LOST

    @property
    def velocity_sigma(self) -> Array:
        """1 sigma of the twist (6,), rad/s and m/s."""
        return np.sqrt(np.diag(self.covariance)[6:])

    def at(self, time_s: float) -> Track:
        """The prediction at a later time. Raises: InputError for an earlier one."""
        dt = time_s - self.time_s
        if dt < 0:
            raise InputError(f"a track at {self.time_s:g} s cannot be asked about {time_s:g} s, which is before")
        F = np.eye(12)
        # The position moves by v dt; the attitude's error is carried around by its own turn.
        F[:3, :3] = so3.exp(dt * self.twist[:3])
        F[:3, 6:9] = dt * so3.left_jacobian(dt * self.twist[:3])
        F[3:6, 9:12] = dt * np.eye(3)
        q = np.diag([self.motion.turn] * 3 + [self.motion.shift] * 3)
        Q = np.block([[dt**3 / 3 * q, dt**2 / 2 * q], [dt**2 / 2 * q, dt * q]])
        P = F @ self.covariance @ F.T + Q
        moved = replace(self.pose, matrix=se3.retract(self.pose.matrix, dt * self.twist), covariance=P[:6, :6])
        return replace(self, pose=moved, covariance=P, time_s=time_s)

    def seen(self, measured: ObjectPose, time_s: float) -> Track:
        """After a measurement: taken where it fits what was predicted, left out where it does not."""
        before = self.at(time_s)
        nearest = measured.nearest_to(before.pose.matrix)
        delta = se3.local(before.pose.matrix, nearest.matrix)
        S = before.covariance[:6, :6] + nearest.covariance
        chance = chi2_tail(6, float(delta @ np.linalg.solve(S, delta)))
        if chance < GATE:
            return replace(before, accepted=False, chance=chance, missed=self.missed + 1)
        K = np.linalg.solve(S, before.covariance[:6]).T
        step = K @ delta
        # Joseph's form: symmetric and positive whatever the rounding.
        A = np.eye(12)
        A[:, :6] -= K
        P = A @ before.covariance @ A.T + K @ nearest.covariance @ K.T
        pose = replace(nearest, matrix=se3.retract(before.pose.matrix, step[:6]), covariance=P[:6, :6])
        return replace(
            before, pose=pose, twist=self.twist + step[6:], covariance=P, accepted=True, chance=chance, missed=0
        )

    def not_seen(self, time_s: float) -> Track:
        """After a picture in which nothing was found."""
        return replace(self.at(time_s), accepted=False, missed=self.missed + 1)

    def one_of(self, measured: Sequence[ObjectPose], time_s: float) -> Track:
        """After a picture with several objects: the one that fits best is this one, if any does."""
        if not measured:
            return self.not_seen(time_s)
        return max((self.seen(m, time_s) for m in measured), key=lambda t: t.chance)
