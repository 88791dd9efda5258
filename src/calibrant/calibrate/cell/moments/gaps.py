"""Did a camera's video lose frames: is it early by whole frames from some moment on?

Frames that a recorder lost leave those after them with numbers too low. With d_ms where b stands to a when its picture
is taken to be early by s (whole moments by another picture, a part of one by the target's motion), in a chart about a
common place and whitened by the views' own noise, three models are compared by what they leave, a mean square each:

    one clock           min_s      sum_m |d_ms - mu|^2
    a camera that moved min_s,k    the same, mu another from k on
    lost frames         min_s,u,k  sum_m<k |d_ms - mu|^2 + sum_m>=k |d_mu - mu|^2,     u - s a whole number.

No picture goes with those at which frames of b are lost: for u > s they count for nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.calibrate.cell.moments.sightings import relative
from calibrant.calibrate.cell.moments.swept import swept
from calibrant.calibrate.cell.starts.medoid import robust_mean
from calibrant.geometry import se3

MOST_LOST = 5
"""Frames of one gap."""
PARTS = (-0.5, -0.25, 0.0, 0.25)
"""Of a step between moments: clocks are early by these, too."""
LEAST_PART = 5
"""Pairs before and after: fewer agree with some shift by chance."""
EXPLAINED = 0.4
"""Mean square that lost frames leave over what one clock does, from which they are said."""
BY_NOISE = 1.5
"""Mean square that one clock leaves, in units of the views' own noise, up to which nothing is to be explained."""
FARTHEST = 5.0
"""Times the typical distance, that a pair counts for at most: single ones may belong to no moment."""


@dataclass(frozen=True)
class Gap:
    """first: the pair from which on b is early against a by that many frames more than before (late: below 0)."""

    first: int
    frames: int


@dataclass(frozen=True, eq=False)
class _Sums:
    """Of rows before each, for one lateness: x (n + 1, 6), |x|^2 and how many (n + 1,)."""

    x: Array
    squares: Array
    count: Array

    def before(self, k: Indices) -> _Sums:
        return _Sums(self.x[k], self.squares[k], self.count[k])

    def after(self, k: Indices) -> _Sums:
        return _Sums(self.x[-1] - self.x[k], self.squares[-1] - self.squares[k], self.count[-1] - self.count[k])

    def __add__(self, other: _Sums) -> _Sums:
        return _Sums(self.x + other.x, self.squares + other.squares, self.count + other.count)

    @property
    def left(self) -> Array:
        """What a common mean leaves; nothing is explained by a few."""
        left = self.squares - np.sum(self.x * self.x, axis=-1) / np.maximum(self.count, 1)
        return np.where(self.count >= LEAST_PART, left, np.inf)

    @property
    def mean_square(self) -> Array:
        """The same, a residual."""
        return self.left / np.maximum(6 * self.count - 6, 1)


def gap_between(T_a: Array, T_b: Array, C: Array, moments: Sequence[str], times: Mapping[str, float]) -> Gap | None:
    """The gap in one of two videos that their pairs show; None where none does, and where times are not known.

    Args: T_a, T_b (n, 4, 4), poses of the target at moments (n,) in their order; C (6, 6), typical of where one camera
    stands to the other by one of them; times: seconds of all moments.
    """
    n = len(T_a)
    if n < 2 * LEAST_PART + 1 or not set(moments) <= set(times):
        return None
    early = _by_lateness(T_a, T_b, np.linalg.inv(np.linalg.cholesky(C)), moments, times)
    every, at = np.full(1, n), np.arange(LEAST_PART, n - LEAST_PART + 1)
    once = min(float(s.before(every).mean_square[0]) for s in early.values())
    if once < BY_NOISE:
        return None
    moved = min(
        float(np.min((s.before(at).left + s.after(at).left) / np.maximum(6 * s.count[-1] - 12, 1)))
        for s in early.values()
    )
    best, least = None, np.inf
    for (shift, part), first in early.items():
        for then in range(-MOST_LOST, MOST_LOST + 1):
            lost = then - shift
            second = early[then, part].after(np.minimum(at + max(lost, 0), n))
            both = (first.before(at) + second).mean_square
            both = np.where(second.count >= LEAST_PART, both, np.inf)
            k = int(np.argmin(both))
            if lost and abs(lost) <= MOST_LOST and both[k] < least:
                least, best = float(both[k]), Gap(int(at[k]), lost)
    return best if least < EXPLAINED * once and least < moved else None


def _by_lateness(
    T_a: Array, T_b: Array, whiten: Array, moments: Sequence[str], times: Mapping[str, float]
) -> dict[tuple[int, float], _Sums]:
    """By whole and part steps between moments that b is early by."""
    numbers = _numbers(moments, times)
    _, half = swept(moments, T_b, times)
    row = {int(number): k for k, number in enumerate(numbers)}
    D = robust_mean(relative(T_a, T_b))
    found: dict[tuple[int, float], Array] = {}
    for shift in range(-MOST_LOST, MOST_LOST + 1):
        other = np.array([row.get(int(number) - shift, -1) for number in numbers])
        for part in PARTS:
            led = se3.retract(T_b[other], -2 * part * half[other])  # what is swept is half a step
            d = se3.local(np.broadcast_to(D, T_a.shape), relative(T_a, led)) @ whiten.T
            found[shift, part] = np.where((other >= 0)[:, None], d, np.nan)
    size = np.linalg.norm(list(found.values()), axis=2)
    far = FARTHEST * min(float(np.nanmedian(s)) for s in size if np.sum(np.isfinite(s)) >= LEAST_PART)
    return {way: _sums(d, far) for way, d in found.items()}


def _sums(d: Array, far: float) -> _Sums:
    there = np.isfinite(d[:, 0])
    d = np.where(there[:, None], d, 0.0)
    if far > 0:
        d = d * (far / np.maximum(np.linalg.norm(d, axis=1), far))[:, None]
    x, squares, count = (np.cumsum(v, axis=0) for v in (d, np.sum(d * d, axis=1), there.astype(np.float64)))
    return _Sums(*(np.concatenate([np.zeros_like(v[:1]), v]) for v in (x, squares, count)))


def _numbers(moments: Sequence[str], times: Mapping[str, float]) -> Indices:
    """Of moments, one by one by their times."""
    every = np.unique([*times.values()])
    step = float(np.median(np.diff(every)))
    return np.asarray(np.rint((np.array([times[m] for m in moments]) - every[0]) / step), dtype=np.int64)
