"""Where to look for the offset between two clocks: the shifts at which the angular speeds of two motions agree.

The board turns in the camera as fast as the gripper turns in the base, whatever the unknown transforms (Mair et al.
2011; Furrer et al. 2017), so that the correlation of both speeds over shifts peaks at the offset. A motion that repeats
has several peaks; all that are nearly as high are starts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import RefusedError
from calibrant.geometry import rotations, se3, so3

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

LEAST_CORRELATION = 0.6
"""Angular speeds that belong together agree beyond this at their best shift; by chance 20 samples reach it in one of a
hundred thousand."""
LEAST_SAMPLES = 10
LEAST_SPEED = np.deg2rad(1.0)
"""Radians a second: below it the motion is one of poses held, not of a continuous sweep."""
EVEN = 0.1
"""Variation of the angular speed, relative to its mean, below which its own noise is most of it."""
MOST_PEAKS = 6
_INTERVAL = 0.1
"""Seconds over which turns are taken: arms hardly change their speed within it, and the noise of a turn counts the less
the longer it is."""
_KNOTS = (2, 3, 4, 6, 8, 12, 16, 24, 32, 48)
"""Samples between knots that are tried."""
_VALLEY = 0.9
"""Share of a peak's height down to which its slopes belong to it; also the least height of another peak."""


class PoseSpline:
    """Robot poses as a smooth function of time. times (m,), increasing; T (m, 4, 4).

    Positions and unit quaternions are cubic splines, the quaternions brought back to length 1. Knots stand at every
    k-th sample, k by generalised cross-validation (Craven and Wahba 1978): noise that is followed from sample to
    sample would outrun a slow motion many times, m RSS / (m - parameters)^2 is least where it no longer is.

    spacing: seconds between knots, over which errors of the samples are shared. sigma: of one sample, 1 sigma an axis:
    a turn, radians, and a position, metres, by what the splines leave of the samples; 0 where they pass through all.
    """

    def __init__(self, times: Array, T: Array) -> None:
        self.start, self.end = float(times[0]), float(times[-1])
        w, x, y, z = so3.quaternion_wxyz(T[:, :3, :3]).T
        q = np.column_stack([x, y, z, w])
        q = q * np.cumprod(np.concatenate([[1.0], np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0)]))[:, None]
        self._times = times
        self._position, of_position, variance = _smooth(times, T[:, :3, 3])
        self._quaternion, of_rotation, of_quaternion = _smooth(times, q)
        self.spacing = max(of_position, of_rotation) * float(np.median(np.diff(times)))
        # A turn moves the quaternion by half of it, within the three directions that keep its length.
        self.sigma = (float(np.sqrt(4 / 3 * of_quaternion)), float(np.sqrt(variance / 3)))
        self._position_rate, self._quaternion_rate = self._position.derivative(), self._quaternion.derivative()

    def pose(self, t: Array) -> Array:
        """T (n, 4, 4) at times t (n,)."""
        return se3.make(rotations.matrix_from_quaternion_xyzw(self.quaternions(t)), self._position(t))

    def spread(self, t: Array, weights: Array) -> Array:
        """Covariance (p, p) of sum_i W_i d_i, by the noise of the samples, d_i what it moves the pose at t_i by.

        Args: t (n,); weights W (n, p, 6), of a turn and a shift in the base.
        """
        rotation, position = self.sigma
        turns = _of_samples(self._quaternion, self._times, t, weights[:, :, :3])
        return rotation**2 * turns + position**2 * _of_samples(self._position, self._times, t, weights[:, :, 3:])

    def quaternions(self, t: Array) -> Array:
        """Unit quaternions x, y, z, w (n, 4) at times t (n,), neighbours with like signs."""
        q = self._quaternion(t)
        return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))

    def rate(self, t: Array) -> Array:
        """Its derivative in the chart of `se3.retract`, (n, 6): angular velocity and velocity in the base."""
        # omega = 2 vec(q' q*), which the part of q' along q does not enter.
        q, rate = self._quaternion(t), self._quaternion_rate(t)
        v, a = q[:, :3], rate[:, :3]
        omega = 2 * (q[:, 3:] * a - rate[:, 3:] * v - np.cross(a, v)) / np.sum(q**2, axis=1, keepdims=True)
        return np.concatenate([omega, self._position_rate(t)], axis=1)


def _smooth(times: Array, values: Array) -> tuple[BSpline, int, float]:
    """The cubic spline of values (m, d), the samples between its knots, and a sample's variance, of all d together."""
    from scipy.interpolate import make_interp_spline, make_lsq_spline

    m = len(times)
    tried: list[tuple[float, int, BSpline, float]] = []
    for k in _KNOTS:
        inner = times[k : m - 2 : k]
        if len(inner) < 2:
            break
        knots = np.concatenate([np.repeat(times[0], 4), inner, np.repeat(times[-1], 4)])
        spline = make_lsq_spline(times, values, knots)
        spare = m - (len(knots) - 4)
        squares = float(np.sum((spline(times) - values) ** 2))
        tried.append((squares / spare**2, k, spline, squares / spare))
    # Without noise the error of approximation is all there is: it falls by (2/3)^8 from knots 3 apart to 2 apart.
    if len(tried) < 2 or tried[0][0] < 0.5 * tried[1][0]:
        return make_interp_spline(times, values, k=3), 1, 0.0
    # One step finer than the least: there the error of approximation is as large as the noise, and has a sign.
    best = min(range(len(tried)), key=lambda i: tried[i][0])
    _, k, spline, variance = tried[max(best - 1, 0)]
    return spline, k, variance


def _of_samples(spline: BSpline, times: Array, t: Array, weights: Array) -> Array:
    """Covariance (p, p) of sum_i w_i s(t_i), for samples of unit variance in each of d components: weights w (n, p, d).

    The least-squares spline is s(t) = b(t)^T (B^T B)^-1 B^T y with the B-splines' values b at t and B at the samples.
    """
    from scipy.interpolate import BSpline
    from scipy.sparse.linalg import splu

    # Beyond the samples it is continued, as its poses are: a start that is not the offset may lead there.
    B, b = (BSpline.design_matrix(at, spline.t, spline.k, extrapolate=True) for at in (times, t))
    wanted = np.ascontiguousarray(b.T @ weights.reshape(len(t), -1))
    of_samples = (B @ splu((B.T @ B).tocsc()).solve(wanted)).reshape(len(times), *weights.shape[1:])
    return np.asarray(np.einsum("mpd,mqd->pq", of_samples, of_samples, optimize=True))


def shifts_by_speed(
    spline: PoseSpline, t_robot: Array, t_camera: Array, T_camera_target: Array, largest: float
) -> list[tuple[float, float]]:
    """Shifts (s) at which the angular speeds agree, the best first, and their correlations there.

    Raises: RefusedError when the motion is too slow or too even, or no shift within `largest` brings them together.
    """
    _require_overlap(t_robot, t_camera, largest)
    # A sixteenth of the camera's interval is fine enough for a start, however often the robot reports.
    of_camera, of_robot = float(np.median(np.diff(t_camera))), float(np.median(np.diff(t_robot)))
    step = max(min(of_camera, of_robot) / 2, of_camera / 16)
    over = int(np.clip(round(_INTERVAL / of_camera), 1, len(t_camera) // LEAST_SAMPLES))
    turns = T_camera_target[over:, :3, :3] @ np.swapaxes(T_camera_target[:-over, :3, :3], -1, -2)
    speed = so3.angle(turns) / (t_camera[over:] - t_camera[:-over])
    if np.median(speed) < LEAST_SPEED and speed.max() < 10 * LEAST_SPEED:
        raise RefusedError(
            f"the target turns at {np.rad2deg(speed.max()):.2g} deg/s at most: too slow to tell an offset; record one "
            "continuous motion that turns about several axes, speeding up and slowing down"
        )
    # The robot's turn over each of the camera's own intervals: the same smoothing on both sides. Both ends are taken
    # from a fine grid of quaternions, chords of which give the angle: |q1 - q0| = 2 sin(angle / 4).
    grid = np.arange(t_robot[0], t_robot[-1], step)
    q = spline.quaternions(grid)
    first, last = (np.round((t - grid[0]) / step).astype(np.int64) for t in (t_camera[:-over], t_camera[over:]))
    widest = int(np.ceil(largest / step))
    shifts = np.arange(-widest, widest + 1)
    scores = np.full(len(shifts), -1.0)
    for k, shift in enumerate(shifts.tolist()):
        inside = (first + shift >= 0) & (last + shift < len(grid))
        if inside.sum() < max(LEAST_SAMPLES - 1, len(speed) // 3):
            continue
        chord = np.linalg.norm(q[last[inside] + shift] - q[first[inside] + shift], axis=1)
        turned = 4 * np.arcsin(np.minimum(chord / 2, 1.0)) / ((last - first)[inside] * step)
        if turned.std() > 1e-9 and speed[inside].std() > 1e-9:
            scores[k] = np.corrcoef(turned, speed[inside])[0, 1]
    times = np.asarray(shifts * float(step), dtype=np.float64)
    _require_peak(scores, times, largest, _turning(spline, t_robot))
    return [(float(times[k]), float(scores[k])) for k in _peaks(scores)]


def _require_overlap(t_robot: Array, t_camera: Array, largest: float) -> None:
    """Raises: RefusedError for clocks whose zeros are farther apart than any offset that is searched."""
    ahead, behind = float(t_robot[0] - t_camera[-1]), float(t_camera[0] - t_robot[-1])
    apart = max(ahead, behind)
    if apart <= largest:
        return
    first, second = ("camera", "robot") if ahead > behind else ("robot", "camera")
    raise RefusedError(
        f"the times do not overlap: the {first}'s recording ends {apart:.6g} s before the {second}'s begins, and "
        f"offsets up to {largest:g} s are searched. The clocks have different zeros, or the files are two recordings: "
        "give both the times of one clock, or count each from its own first sample and search as far as one may have "
        "been started before the other (--largest 30s)"
    )


def _turning(spline: PoseSpline, t_robot: Array) -> Array:
    """The gripper's angular speed (n,) over the recording, at most 500 moments of it."""
    at = np.linspace(t_robot[0], t_robot[-1], min(len(t_robot), 500))
    return np.asarray(np.linalg.norm(spline.rate(at)[:, :3], axis=1))


def _require_peak(scores: Array, shifts: Array, largest: float, turning: Array) -> None:
    """Raises: RefusedError when no shift within the range brings the speeds together."""
    best = int(np.argmax(scores))
    if scores[best] < LEAST_CORRELATION:
        variation = float(turning.std() / max(turning.mean(), 1e-12))
        if variation < EVEN and turning.mean() > LEAST_SPEED:
            raise RefusedError(
                f"the gripper turns evenly, at {np.rad2deg(turning.mean()):.3g} deg/s with less than "
                f"{100 * EVEN:.0f} % of variation: every moment looks like the next, which tells no offset; record a "
                "motion that speeds up and slows down"
            )
        raise RefusedError(
            f"no offset within {largest:g} s brings the two motions together: the angular speeds correlate by "
            f"{max(scores[best], 0.0):.2f} at best; check that the files are of one recording, or search wider "
            "(--largest 10s)"
        )
    if best in (0, len(shifts) - 1):
        raise RefusedError(
            f"the best offset is at the edge of the search, {shifts[best]:.3g} s; search wider (--largest 10s)"
        )


def _peaks(scores: Array) -> list[int]:
    """The highest peaks, those nearly as high as the best, with their slopes taken away one after the other."""
    left = scores.copy()
    found: list[int] = []
    height = float(scores.max())
    while len(found) < MOST_PEAKS:
        k = int(np.argmax(left))
        if left[k] < _VALLEY * height:
            break
        low, high = k, k
        while low > 0 and scores[low - 1] >= _VALLEY * scores[k]:
            low -= 1
        while high < len(scores) - 1 and scores[high + 1] >= _VALLEY * scores[k]:
            high += 1
        left[low : high + 1] = -1.0
        if 0 < k < len(scores) - 1:
            found.append(k)
    return found
