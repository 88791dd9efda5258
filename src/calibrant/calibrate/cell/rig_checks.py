"""What the cameras of a cell are asked beside each other, and a rig as a whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibrant.calibrate.cell import checks as questions
from calibrant.calibrate.cell.clocks import clocks_found, suspected_clocks
from calibrant.calibrate.cell.noise_figures import pooled
from calibrant.calibrate.cell.problem.groups import pictures_factor
from calibrant.calibrate.cell.problem.problem import Cell
from calibrant.calibrate.cell.starts.cell import CellStart
from calibrant.data import Check
from calibrant.optimize.noise import NoiseEstimate


def _sigma_together(cell: Cell, noise: NoiseEstimate, camera: str) -> float:
    """Pixel noise that a camera shows in the fit of all: its level, or where cameras share one, what its own residuals
    are over what they should be."""
    level, solution = cell.pixel_level(noise.levels, camera), noise.solution
    group = cell.pixel_group(camera)
    if not (cell.layout.rig or cell.alike(camera)):
        return level.sigma
    squares, count = 0.0, 0
    for i, p, d in cell.lists:
        if p.camera == camera and d.use.any():
            k = solution.problem.factor_index(pictures_factor(i))
            weighted = solution.residuals(pictures_factor(i)) * solution.problem.factors[k].weight[:, None]
            squares, count = squares + float(np.sum(weighted**2)), count + weighted.size
    every = sum(c for g, c in zip(solution.noise_shares.groups, solution.noise_shares.counts) if g == group)
    return cell.pixel_ratios[camera] * float(np.sqrt(squares / count * every / level.redundancy)) if count else 0.0


def together(cell: Cell, noise: NoiseEstimate, camera: str) -> Check:
    """Does a camera fit as well with the others as by itself?"""
    return questions.together_check(camera, _sigma_together(cell, noise, camera), cell.own_sigma_px(camera))


def rig_checks(cell: Cell, start: CellStart, noise: NoiseEstimate) -> tuple[Check, ...]:
    """What cameras are asked that handheld targets tie: do they share moments enough, do they hold still to each other,
    what do their clocks say?"""
    tied = cell.roles if cell.layout.rig else [c for group in cell.layout.by_hand if len(group) > 1 for c in group]
    if not tied:
        return ()
    levels = [cell.pixel_level(noise.levels, c) for c in tied]
    own = pooled([replace(level, sigma=cell.own_sigma_px(c)) for c, level in zip(tied, levels)])
    joint = pooled(levels)
    shared = (questions.shared_moments_check(start.pairs),) if start.pairs else ()  # none in a rig of one camera
    if cell.clocks is None and questions.loose_rig(joint, own):
        return *shared, questions.rigidity_check(joint, own, suspected_clocks(cell, noise.solution))
    found = clocks_found(cell, noise.solution)
    rigidity = questions.rigidity_check(joint, own)
    return (*shared, rigidity) if found is None else (*shared, rigidity, questions.clocks_check(found))
