"""Was something pushed between two poses? A step in what the loop leaves, over the order of the poses.

What stands (a board, a camera beside the arm, the arm's stand) is moved by P from pose k on as if the robot had said
P T_i; what hangs from the flange as if it had said T_i P. With b the six numbers of P, the errors are e_i = F_i b of
every later pose, and the gradients of `pose_errors` give z = sum F_i^T g_i with the information M, so that

    b = M^-1 z,     Q = z^T M^-1 z,     F = (Q / 6) / ((R - Q) / (D - 6)),

R the squares that the loop leaves and D its degrees of freedom: the noise levels are those of a fit that took the step
for noise. The chance is over all steps on both sides. Errors that neighbours share, a drift, a wandering, the arm's
geometry, make a step too, whose chance means nothing: of an even drift the best step explains three quarters, and one
counts that explains more.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.certainty.pose_errors import PoseErrors
from calibrant.geometry import so3
from calibrant.optimize.chances import share_tail

BY_CHANCE = 1e-3
"""Of a thousand cells that nobody touched, one is said to have been pushed at most."""
LEAST_EXPLAINED = 0.75
"""Of the loop's variance. The best step takes that much of an even ramp: 1/12 of its square, of which 1/48 is left."""
FEWEST = 3
"""Poses before and after: fewer hang from their own noise."""
_SINGULAR = 1e-9
SIZE = 6
"""Numbers of a push."""


@dataclass(frozen=True, eq=False)
class Moved:
    """first: the pose from which on; standing: in the axes of the base, else of the flange; chance: of as large a step
    without one; way (6,): rotation and translation there, rad and m, with its covariance (6, 6)."""

    first: int
    standing: bool
    chance: float
    way: Array
    covariance: Array

    def at(self, place: Array) -> tuple[Array, Array]:
        """How a point (3,) of the base, or of the flange, went: (3,) m and its covariance (3, 3)."""
        J = np.concatenate([-so3.hat(place), np.eye(3)], axis=1)
        return J @ self.way, J @ self.covariance @ J.T


def moved(errors: PoseErrors) -> Moved | None:
    """The likeliest step, where there is one beyond chance."""
    n = len(errors.gradient)
    L = errors.units(of_flange=False)
    own, pull = np.einsum("nab,na->nb", L, errors.gradient), errors.pull @ L
    squares = float(np.sum(own**2))
    taken = np.einsum("nsa,st,nta->", pull, errors.covariance, pull)
    freedom = float(np.trace(L @ errors.information @ L, axis1=1, axis2=2).sum() - taken)
    if n < 2 * FEWEST or freedom <= SIZE + 1 or squares <= 0:
        return None
    steps = [s for standing in (True, False) for s in _steps(errors, standing=standing)]
    if not steps:
        return None
    best = max(steps, key=lambda s: s.explained)
    left = max(squares - best.explained, np.finfo(float).eps * squares) / (freedom - SIZE)
    chance = share_tail(best.explained, squares, unknowns=SIZE, freedom=freedom) * len(steps)
    if chance > BY_CHANCE or left > (1 - LEAST_EXPLAINED) * squares / freedom:
        return None
    return Moved(best.first, best.standing, chance, best.inverse @ best.z, best.inverse * left)


@dataclass(frozen=True, eq=False)
class _Step:
    first: int
    standing: bool
    z: Array
    inverse: Array
    explained: float


def _steps(errors: PoseErrors, *, standing: bool) -> Iterator[_Step]:
    """z, M^-1 and Q of a step before every pose that has enough on both sides, where all of b is determined."""
    T = errors.T_base_gripper
    F = np.zeros((len(T), SIZE, SIZE))  # what a push is to a pose, in `se3.retract`'s chart
    if standing:
        F[:, :3, :3] = F[:, 3:, 3:] = np.eye(3)
        F[:, 3:, :3] = -so3.hat(T[:, :3, 3])
    else:
        F[:, :3, :3] = F[:, 3:, 3:] = T[:, :3, :3]
    Ft = np.swapaxes(F, 1, 2)
    each = (Ft @ errors.gradient[:, :, None])[..., 0], Ft @ errors.information @ F, errors.pull @ F
    z, H, U = (np.cumsum(a[::-1], axis=0)[::-1] for a in each)
    for first in range(FEWEST, len(T) - FEWEST + 1):
        M = H[first] - U[first].T @ errors.covariance @ U[first]
        d = np.diag(M)
        if not np.all(d > _SINGULAR * np.diag(H[first])):
            continue
        scale = 1 / np.sqrt(d)
        values, vectors = np.linalg.eigh(M * scale[:, None] * scale)
        if values[0] < _SINGULAR:
            continue
        root = scale[:, None] * vectors / np.sqrt(values)
        yield _Step(first, standing, z[first], root @ root.T, float(np.sum((root.T @ z[first]) ** 2)))
