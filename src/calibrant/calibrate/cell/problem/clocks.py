"""Clocks of a rig's cameras: offsets between them and the time that a picture takes to be read.

A camera that is tau late sees a handheld target where it will be; one whose rows are read one after the other sees
every row at a time of its own,

    t_j = t_moment + e_cm + tau_c + rho_c (v_j / h - 1/2),    p_j(t) = T_m^-1 T(t) p_j,

with e_cm what the picture's own time stamp says, v_j / h the row as a part of the image's height, tau_c the offset to
the reference camera's clock at the picture's middle row and rho_c the readout time. T(t) near a moment is a parabola in
`se3.retract`'s chart that its neighbours in time tell. The displaced points stand in the place of the target's own: tau
and rho are amplitudes of its modes, dp/dt and dp/dt (v / h - 1/2), so that their sigma and what they do to everything
else come from the one problem. The parabola is that of the last fit: the fit is made again until the clocks stand still
(`cell.clocks`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.calibrate.reprojection.factor import StackedViews, TargetModes
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.optimize.manifolds import Euclidean, Variable

OFFSET, READOUT = "offset", "readout"
FURTHEST_STEPS = 2.5
"""A neighbour in time that is further away than this many typical steps between moments says nothing of a moment's
motion: one or two pictures may fail to show the board."""


@dataclass(frozen=True, eq=False)
class Times:
    """When pictures were taken: seconds by moment; apart, by camera and moment, what a picture's own time is beyond its
    moment's."""

    moments: Mapping[str, float] = field(default_factory=dict)
    apart: Mapping[tuple[str, str], float] = field(default_factory=dict)

    @classmethod
    def told(cls, times: Mapping[str, float] | Mapping[str, Mapping[str, float]] | None) -> Times:
        """From seconds by moment, or by camera and moment: the time of a moment is the mean of its pictures'.

        Raises: InputError for what is no finite number.
        """
        own = {c: m for c, m in (times or {}).items() if isinstance(m, Mapping)}
        plain = {m: t for m, t in (times or {}).items() if not isinstance(t, Mapping)}
        if own and plain:
            raise InputError(f"the times of moments are given by camera ({next(iter(own))}) and without one")
        every: dict[str, list[float]] = {}
        for by_moment in (plain, *own.values()):
            for moment, t in by_moment.items():
                if not isinstance(t, (int, float, np.number)) or not np.isfinite(t):
                    raise InputError(f"the time of moment {moment!r} is {t!r}; times are seconds, finite numbers")
                every.setdefault(moment, []).append(float(t))
        mean = {m: float(np.mean(t)) for m, t in every.items()}
        return cls(mean, {(c, m): float(t) - mean[m] for c, by_moment in own.items() for m, t in by_moment.items()})


@dataclass(frozen=True, eq=False)
class Motion:
    """How a handheld target moved: poses (m, 4, 4) at moments, with their velocity and acceleration (m, 6) in
    `se3.retract`'s chart, rad/s, m/s; known (m,) where neighbours in time tell them."""

    moments: tuple[str, ...]
    T: Array
    velocity: Array
    acceleration: Array
    known: Mask

    def of_carried(self, T_carrier_target: Array) -> Motion:
        """The motion of what this one's target carries: a point off it is swept along, t' = t + R x,
        v' = v + omega x R x, a' = a + alpha x R x + omega x (omega x R x)."""
        arm = self.T[:, :3, :3] @ T_carrier_target[:3, 3]
        omega, alpha = self.velocity[:, :3], self.acceleration[:, :3]
        velocity, acceleration = self.velocity.copy(), self.acceleration.copy()
        velocity[:, 3:] += np.cross(omega, arm)
        acceleration[:, 3:] += np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
        return replace(self, T=self.T @ T_carrier_target, velocity=velocity, acceleration=acceleration)

    def rows(self, moments: Sequence[str]) -> Array:
        """Positions of these moments."""
        index = {m: k for k, m in enumerate(self.moments)}
        return np.array([index[m] for m in moments], dtype=np.int64)


@dataclass(frozen=True)
class Smoothness:
    """A motion near a moment: a polynomial of that degree through it, by that many moments in a row."""

    moments: int
    degree: int


PARABOLA = Smoothness(3, 2)
SMOOTHNESSES = (Smoothness(5, 4), PARABOLA, Smoothness(5, 2))
"""Through five moments, for a motion that turns quickly beside the pictures; through three; smoothed over five, for
poses that are noisy beside the motion: the least biased first."""


def motion_of(
    moments: Sequence[str], T: Array, times: Mapping[str, float], *, smoothness: Smoothness = PARABOLA
) -> Motion:
    """The motion through poses T (m, 4, 4) at moments whose times, seconds, are known.

    With x_i the step of the chart to the pose at time s_i from here, sum_k c_k s_i^k = x_i by least squares: c_1 is
    the velocity, 2 c_2 the acceleration. At an end, and beside a gap, moments of one side serve; three where there are
    no more.
    """
    t = np.array([times[m] for m in moments])
    n, order = len(t), np.argsort(t, kind="stable")
    velocity, acceleration = np.zeros((n, 6)), np.zeros((n, 6))
    known = np.zeros(n, dtype=bool)
    steps = np.diff(t[order])
    near = (steps > 0) & (steps <= FURTHEST_STEPS * (np.median(steps) if len(steps) else 0.0))
    for k, here in enumerate(order.tolist()):
        around = _neighbours(k, near, smoothness.moments)
        if around is None:
            continue
        others = order[[i for i in around if i != k]]
        span = np.ptp(t[others])
        s = (t[others] - t[here]) / span
        powers = s[:, None] ** np.arange(1, min(smoothness.degree, len(others)) + 1)
        steps_to = se3.local(np.broadcast_to(T[here], (len(others), 4, 4)), T[others])
        c = np.linalg.lstsq(powers, steps_to, rcond=None)[0]
        velocity[here], acceleration[here], known[here] = c[0] / span, 2 * c[1] / span**2, True
    return Motion(tuple(moments), T, velocity, acceleration, known)


def _neighbours(k: int, near: Mask, most: int) -> range | None:
    """So many moments in a row with k among them, else three, k as near their middle as can be; near (n - 1,): whether
    each follows the one before closely."""
    for size in dict.fromkeys((most, 3)):
        starts = sorted(range(k - size + 1, k + 1), key=lambda first: abs(first + size // 2 - k))
        for first in starts:
            if first >= 0 and first + size <= len(near) + 1 and near[first : first + size - 1].all():
                return range(first, first + size)
    return None


@dataclass(frozen=True, eq=False)
class Clocks:
    """What is asked of clocks, and where they stand.

    times: of pictures; terms: by camera, which of offset and readout are unknown; at: their values, seconds, in
    the order of the terms; motions: by the frame of the handheld target; carried: T_carrier_target of those that one
    carries, by frame.
    """

    times: Times
    terms: Mapping[str, tuple[str, ...]]
    at: Mapping[str, Array]
    motions: Mapping[str, Motion]
    carried: Mapping[str, Array] = field(default_factory=dict)

    def displaces(self, camera: str) -> bool:
        """Whether a camera's pictures were taken at other times than their moments."""
        return camera in self.terms or any(c == camera and t != 0 for (c, _), t in self.times.apart.items())

    def _apart(self, camera: str, moments: Sequence[str]) -> Array:
        return np.array([self.times.apart.get((camera, m), 0.0) for m in moments])

    def variable(self, camera: str) -> Variable:
        """The unknown of a camera's clock."""
        names = tuple(f"{term} of {camera}" for term in self.terms[camera])
        return Variable(clock_variable(camera), Euclidean(names), self.at[camera][None], words="the clock of")

    def _motion(self, carrier: str, target: str) -> Motion:
        """The motion of a target: its carrier's, with what is between them."""
        motion, between = self.motions[carrier], self.carried.get(target)
        return motion if between is None else motion.of_carried(between)

    def lateness(self, camera: str, carrier: str, target: str, moments: Sequence[str]) -> Array:
        """T_m^-1 T(t_m + tau) (n, 4, 4): how the target had moved when the camera took its picture of each moment."""
        motion = self._motion(carrier, target)
        row, terms = motion.rows(moments), self.terms.get(camera, ())
        offset = sum(float(a) for a, t in zip(self.at.get(camera, ()), terms) if t == OFFSET)
        tau = (self._apart(camera, moments) + offset)[:, None]
        delta = motion.velocity[row] * tau + motion.acceleration[row] * (tau * tau / 2)
        return np.asarray(se3.inverse(motion.T[row]) @ se3.retract(motion.T[row], delta))

    def displaced(
        self, camera: str, carrier: str, target: str, moments: Sequence[str], views: StackedViews, height: int
    ) -> tuple[StackedViews, TargetModes | None]:
        """The views' points less their modes at where the clock stands, and the modes: exact there, tangent beside.
        None where nothing of the camera's clock is unknown."""
        motion, terms = self._motion(carrier, target), self.terms.get(camera, ())
        each = np.repeat(np.arange(len(moments)), np.diff(views.offsets))
        row, own = motion.rows(moments)[each], self._apart(camera, moments)[each]
        if not terms:
            return replace(views, points=_moved(motion, row, views.points, own)[0]), None
        late = np.stack([np.ones(len(row)) if term == OFFSET else views.uv[:, 1] / height - 0.5 for term in terms])
        points, speed = _moved(motion, row, views.points, own + self.at[camera] @ late)
        modes = late[:, :, None] * speed
        start = points - np.tensordot(self.at[camera], modes, axes=1)
        return (
            replace(views, points=start),
            TargetModes(clock_variable(camera), modes),
        )


def _moved(motion: Motion, row: Array, points: Array, dt: Array) -> tuple[Array, Array]:
    """T_m^-1 T(t_m + dt) p, metres, and its derivative by the time, m/s; (N, 3) each."""
    R, velocity, acceleration = motion.T[row, :3, :3], motion.velocity[row], motion.acceleration[row]
    delta = velocity * dt[:, None] + acceleration * (dt * dt / 2)[:, None]
    rate = velocity + acceleration * dt[:, None]
    arm = np.einsum("nij,nj->ni", R, points)
    turned = np.einsum("nij,nj->ni", so3.exp(delta[:, :3]), arm)
    # d exp(delta) = hat(J_left(delta) d delta) exp(delta)
    spin = np.einsum("nij,nj->ni", so3.left_jacobian(delta[:, :3]), rate[:, :3])
    back = np.swapaxes(R, -1, -2)
    place = np.einsum("nij,nj->ni", back, turned + delta[:, 3:])
    speed = np.einsum("nij,nj->ni", back, np.cross(spin, turned) + rate[:, 3:])
    return place, speed


def clock_variable(camera: str) -> str:
    """Name of a camera's clock."""
    return f"clock of {camera}"
