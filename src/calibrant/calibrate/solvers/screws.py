"""Do robot and camera see the same motions? What no X can change, against what wrongly matched motions would differ by.

The screws of A_ij and B_ij are congruent: they turn by the same angle and advance as far along their axis (Chen, "A
screw motion approach to uniqueness analysis of head-eye geometry", CVPR 1991). Motions about one fixed point (a wrist
alone, a tracker on a ball joint) do not advance at all: their advances differ by noise, rightly matched or wrongly, and
decide nothing. What is left to compare there is the whole translation, R_A t_X + t_A = R_X t_B + t_X.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.solvers.relative import PosePairs
from calibrant.geometry import so3

WRONG_MATCHES = 20
"""Cyclic shifts that stand for wrong matches: their median is then known to a few per cent."""
LEAST_SCALE = 1e-9
"""Metres and radians: motions that are all alike to this cannot tell a right pairing from a wrong one."""
L1_STEPS = 8
"""Weighted steps towards the least sum of distances, which wrong views hardly move; they settle in five or six."""


@dataclass(frozen=True)
class Agreement:
    """median: of the differences of matching motions, rad or metres; ratio: that over the median of wrong matches."""

    median: float
    ratio: float


def turns(pairs: PosePairs) -> Agreement:
    """Angles of the motions of robot and camera."""
    m = pairs.motions
    return _agreement(np.linalg.norm(m.alpha, axis=1), np.linalg.norm(m.beta, axis=1))


def advances(pairs: PosePairs) -> Agreement:
    """Translations along the axes, of the half of the motions that turn more: those have the better axes."""
    m = pairs.motions
    angle = np.linalg.norm(m.alpha, axis=1)
    turning = angle >= np.median(angle)
    return _agreement(_advance(m.A[turning], m.alpha[turning]), _advance(m.B[turning], m.beta[turning]))


def translations(pairs: PosePairs) -> Agreement:
    """R_A t_X + t_A against R_X t_B + t_X, with the R_X and t_X that fit the motions best."""
    m = pairs.motions
    R_x = so3.nearest(m.alpha.T @ m.beta)
    lever = m.A[:, :3, :3] - np.eye(3)
    seen = m.B[:, :3, 3] @ R_x.T
    t_x = _least_distances(lever, seen - m.A[:, :3, 3])
    return _agreement(lever @ t_x + m.A[:, :3, 3], seen)


def _least_distances(M: Array, y: Array) -> Array:
    """x (3,) of the least sum of |M_p x - y_p|, M (p, 3, 3), y (p, 3); of least length where x is left open."""
    weight = np.ones(len(M))
    for _ in range(L1_STEPS):
        normal, right = np.einsum("p,pij,pik->jk", weight, M, M), np.einsum("p,pij,pi->j", weight, M, y)
        x: Array = np.linalg.lstsq(normal, right, rcond=None)[0]
        weight = 1 / np.maximum(np.linalg.norm(M @ x - y, axis=1), LEAST_SCALE)
    return x


def _advance(T: Array, omega: Array) -> Array:
    """Translation along the rotation axis, metres: n^T t."""
    angle = np.linalg.norm(omega, axis=1)
    return np.einsum("pi,pi->p", omega, T[:, :3, 3]) / np.where(angle > 0, angle, 1.0)


def _agreement(a: Array, b: Array) -> Agreement:
    """Differences of a and b (p,) or (p, 3), and of a and cyclic shifts of b."""
    count = len(b)
    # A step of 1 and more: none is there twice.
    shifts = np.linspace(1, count - 1, min(WRONG_MATCHES, count - 1)).astype(int) if count > 1 else np.array([1])
    scale = float(np.median(np.concatenate([_distance(a, np.roll(b, int(s), axis=0)) for s in shifts])))
    median = float(np.median(_distance(a, b)))
    return Agreement(median, median / scale if scale > LEAST_SCALE else 0.0)


def _distance(a: Array, b: Array) -> Array:
    d = np.abs(a - b)
    return d if d.ndim == 1 else np.asarray(np.linalg.norm(d, axis=1))
