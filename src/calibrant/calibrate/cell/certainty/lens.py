"""The lens of a cell beside what its photos alone say of it: does the robot bend it?

Photos of the board determine the lens, within C_p; in the cell the robot's poses help, which leaves C. With the weight
of the photos W = C C_p^-1, lens in the cell and lens by the photos differ by d, whose covariance is

    (I - W) C_p (I - W)^T + (1 + v) B,     B = C - C C_p^-1 C,

B what the robot's errors move the lens by, if they are as independent as the fit takes them (v = 0: C_p - C, Hausman
1978, "Specification tests in econometrics"). An arm that errs smoothly moves it further. Such errors
have one cause with those that neighbouring poses share: before d they are as likely as the poses' own errors leave them
(`neighbours`), at every level v alike, and v B is averaged over what d leaves possible.
Beyond chance d d^T is added: along it the lens may as well be where the photos have it.
An error of the lens moves all else along: with C_xl the fit's own covariances,

    beside = K (v B) K^T,     K = C_xl C_ll^-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.problem.camera_role import CameraRole
from calibrant.optimize.chances import chi2_tail
from calibrant.optimize.solution import Solution

BY_CHANCE = 1e-4
"""Chance of a disagreement that is said: one of ten thousand sets."""
LEVELS = (1.0, 4.0, 16.0, 64.0, 256.0)
"""Variance that smooth errors add, over that of independent ones: up to sixteen times the size, as 250 poses need that
err as one."""
LEAST_GAIN = 0.05
"""Share of a direction's variance that the robot must have taken off for the two to be compared: less is rounding, and
weights of a few points."""


@dataclass(frozen=True, eq=False)
class LensShift:
    """covariance (s, s): what is added to that of the shared unknowns; chance: of a disagreement between the robot and
    the photos as large; moved (k,): the lens in the cell less the lens by its photos, sigma (k,): of the latter."""

    covariance: Array
    chance: float
    moved: Array
    sigma: Array

    @property
    def bent(self) -> bool:
        """Whether robot and photos disagree beyond chance."""
        return self.chance < BY_CHANCE


def lens_shift(solution: Solution, lens: str, role: CameraRole, *, smooth: float) -> LensShift | None:
    """The lens of the fit beside `role.camera`, as its photos had it; None where the robot adds nothing to it.

    lens: name of its variable; smooth: the chance that the robot errs smoothly, by its poses. A lens that was given
    within a covariance is in the fit as such: the same holds.
    """
    problem = solution.problem
    i = problem.variable_index(lens)
    placement, by_photos = problem.structure.placements[i], role.camera.covariance
    if placement is None or by_photos is None:
        return None
    basis = problem.variables[i].manifold.basis(solution.values[i])
    free = np.eye(len(by_photos)) if basis is None else basis[0]
    to_free = np.linalg.pinv(free)
    C = to_free @ solution.covariance(lens) @ to_free.T
    root, more, d = _compared(
        C, to_free @ by_photos @ to_free.T, to_free @ (solution.value(lens)[0] - role.camera.values)
    )
    gained = more > 1 + LEAST_GAIN
    if not gained.any():
        return None
    root, more, d = root[:, gained], more[gained], d[gained]
    by_robot = 1 - 1 / more
    logs = [0.0]
    for level in LEVELS:
        grown = 1 + level * by_robot / (more - 1)
        logs.append(float(-0.5 * np.sum(np.log(grown)) + 0.5 * np.sum(d**2 / (more - 1) * (1 - 1 / grown))))
    before = [1 - smooth] + [smooth / len(LEVELS)] * len(LEVELS)
    odds = np.exp(np.array(logs) - max(logs)) * before
    level = float(odds[1:] @ LEVELS / odds.sum())
    chance = chi2_tail(len(d), float(np.sum(d**2 / (more - 1))))
    added = [root * np.sqrt(level * by_robot)]
    if chance < BY_CHANCE:
        added.append((root @ d)[:, None])
    half = free @ np.concatenate(added, axis=1)
    shift = solution.value(lens)[0] - role.camera.values
    return LensShift(along_with(solution, lens, half @ half.T), chance, shift, np.sqrt(np.diag(by_photos)))


def along_with(solution: Solution, lens: str, added: Array) -> Array:
    """What an error of the lens, of covariance (p, p), natural tangent, does to all shared unknowns, (s, s)."""
    i = solution.problem.variable_index(lens)
    placement = solution.problem.structure.placements[i]
    if placement is None:
        return np.zeros_like(solution.shared_covariance)
    basis = solution.problem.variables[i].manifold.basis(solution.values[i])
    if basis is not None:
        to_free = np.linalg.pinv(basis[0])
        added = to_free @ added @ to_free.T
    columns = placement.offset[0] + np.arange(placement.dim)
    across = solution.shared_covariance[:, columns]
    K = np.linalg.solve(across[columns], across.T).T
    return np.asarray(K @ added @ K.T)


def _compared(C: Array, by_photos: Array, d: Array) -> tuple[Array, Array, Array]:
    """R (k, k) with R R^T = C and R diag(more) R^T = C_p, more (k,), and d in these directions."""
    scale = np.sqrt(np.diag(C))
    values, axes = np.linalg.eigh(C / scale[:, None] / scale)
    root = scale[:, None] * axes * np.sqrt(np.maximum(values, values[-1] * 1e-12))
    back = np.linalg.inv(root)
    more, turned = np.linalg.eigh(back @ by_photos @ back.T)
    return root @ turned, more, turned.T @ back @ d
