"""Levels that the data hardly tell, held at what they may be: a variance near zero is known to its own deviation only.

Where other noise outweighs a group's, the most likely variance theta of it comes out at next to nothing in every second
set, whatever it is. Its deviation s = theta sqrt(2 (M^-1)_kk) (`level_spread`) stays finite as theta goes to zero: M_kk
goes as theta^2. With nothing known before but that it is positive, what the data leave of it is a normal
distribution about theta above zero, whose mean

    theta + s phi(theta / s) / Phi(theta / s)

is taken in its place: a twentieth of s more at two s, theta itself beyond, and 0.8 s where theta is zero.
"""

from __future__ import annotations

from dataclasses import replace
from math import erf, exp, pi, sqrt

import numpy as np

from calibrant.optimize.levenberg_marquardt import SolverOptions, solve_again
from calibrant.optimize.noise import NoiseEstimate, NoiseLevel, redundancies, with_spread

LEAST_CHANGE = 1.05
"""Levels that would rise by less are left: a twentieth is less than any is known to."""
LEAST_INFORMATION = 1e-8
"""Rounding of M, a difference of numbers of the size of a count: below it a level's deviation means nothing."""


def held_levels(found: NoiseEstimate, *, options: SolverOptions | None = None) -> NoiseEstimate:
    """The estimate with levels raised that the data hardly tell; as it is where they tell all."""
    groups = tuple(g for g, level in found.levels.items() if not level.at_floor)
    M = found.solution.noise_shares.information(groups)
    values, axes = np.linalg.eigh(M)
    if not groups or values[0] < LEAST_INFORMATION:
        return found
    relative = np.sqrt(2 * (axes**2 @ (1 / values)))
    sigmas = dict(found.solution.sigmas)
    raised = {g: sigmas[g] * f for g, s in zip(groups, relative.tolist()) if (f := sqrt(held_share(s))) > LEAST_CHANGE}
    if not raised:
        return found
    solution = solve_again(replace(found.solution, around=()), sigmas | raised, options=options)
    parts = redundancies(solution)
    levels = {
        g: NoiseLevel(raised[g], level.deviation, parts[g][1]) if g in raised else level
        for g, level in found.levels.items()
    }
    return with_spread(replace(found, solution=solution, levels=levels))


def held_share(s: float) -> float:
    """The mean over theta, for a variance that is known to s of itself."""
    t = 1 / s
    return 1 + s * exp(-0.5 * t * t) / sqrt(2 * pi) / (0.5 * (1 + erf(t / sqrt(2))))
