"""The fit of a rig whose cameras' clocks are unknown: with the target's motion of the last fit, until they stand still.

    fit as if taken at once -> the target's motion through its poses -> clocks beside all else -> motion again -> …

What a step of the clocks changes in the motion is of second order, so that two or three rounds suffice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.certainty.together import moment_errors
from calibrant.calibrate.cell.fitted import fitted_places
from calibrant.calibrate.cell.problem.clocks import (
    OFFSET,
    READOUT,
    SMOOTHNESSES,
    Clocks,
    Motion,
    Smoothness,
    Times,
    clock_variable,
    motion_of,
)
from calibrant.calibrate.cell.problem.layout import Frame, Layout, variable
from calibrant.calibrate.cell.problem.problem import Cell, cell_problem
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.calibrate.cell.refine import LEAST_SIGMA_START, NEARLY_UNDAMPED, in_sight, kept_places, refined
from calibrant.data.details import CameraClock, CameraClocks
from calibrant.errors import CalibrantError, InputError, RefusedError
from calibrant.optimize.noise import NoiseEstimate, estimate_noise
from calibrant.optimize.solution import Solution

ODDS = 100.0
"""Against a motion, by what it leaves of the residuals: log L = -r log sigma, of r residuals beyond the unknowns."""
STILL = 0.05
"""Clocks that move by less than this many sigmas stand still."""
SETTLED = 1e-3
"""A motion that lowers the noise by less than this share is the one that there is."""
MOST_ROUNDS = 8
NO_NEIGHBOUR = "no picture just before or after tells how the target moved, which its camera's clock needs"


@dataclass(frozen=True, eq=False)
class ClocksAsked:
    """times: of pictures; offsets, readout: whether the cameras' offsets and readout times are unknown."""

    times: Times
    offsets: bool = False
    readout: bool = False

    def terms(self, layout: Layout) -> dict[str, tuple[str, ...]]:
        """What is unknown of each camera's clock: offsets are to the root's."""
        words = {c: ((OFFSET,) if self.offsets and c != layout.root else ()) for c in layout.cameras}
        return {c: w + ((READOUT,) if self.readout else ()) for c, w in words.items() if w or self.readout}


def clocks_asked(cell: Cell, *, offsets: bool, readout: bool) -> ClocksAsked:
    """What is asked, checked. Raises: InputError for cells that are no rig, and moments without a time."""
    layout, told = cell.layout, cell.times.moments
    if not layout.rig:
        raise InputError(
            "time offsets of cameras are found in a rig, whose target is moved by hand; a robot's clock is found by "
            "calibrant time-offset"
        )
    moments = {v.moment for p in layout.pictures if p.seen is not None for v in p.seen.views}
    missing = sorted(moments - set(told))
    if missing:
        raise InputError(
            f"the time of moment {missing[0]!r} is not known, nor of {len(missing) - 1} more of {len(moments)}; time "
            "offsets and readout times need the time of every moment, in seconds: times={moment: seconds}, or videos"
        )
    return ClocksAsked(cell.times, offsets, readout)


def refined_with_clocks(
    cell: Cell, transforms: Mapping[Frame, Array], spread: tuple[float, float], asked: ClocksAsked
) -> tuple[NoiseEstimate, Cell]:
    """The fit with clocks, and what is left of the cell: with the least biased motion that the residuals do not speak
    against by `ODDS`, each of them fitted and cleaned up.

    Raises: RefusedError where no motion tells the clocks.
    """
    sigmas = cell.levels((max(spread[0], LEAST_SIGMA_START), max(spread[1], LEAST_SIGMA_START)))
    cell, transforms = in_sight(cell, transforms)
    at_once = estimate_noise(cell_problem(cell, transforms, sigmas), floors=cell.floors(), options=NEARLY_UNDAMPED)
    timed = [_with_clocks(cell, at_once.solution, asked, smoothness) for smoothness in SMOOTHNESSES]
    # Real boards on the move have corners far off, and these speak for whatever motion comes nearest to them.
    fits = [refined(left, fitted_places(left, noise.solution), spread) for noise, left in timed]
    redundancy = [noise.levels[left.pixel_group(cell.layout.root)].redundancy for noise, left in fits]
    against = [r * np.log(_level(left, noise)) for r, (noise, left) in zip(redundancy, fits)]
    return next(fit for fit, a in zip(fits, against) if a <= min(against) + np.log(ODDS))


def _level(cell: Cell, noise: NoiseEstimate) -> float:
    return noise.levels[cell.pixel_group(cell.layout.root)].sigma


def _with_clocks(
    cell: Cell, solution: Solution, asked: ClocksAsked, smoothness: Smoothness
) -> tuple[NoiseEstimate, Cell]:
    """The fit once the clocks stand still, and its cell with clocks that start from there; solution: as if taken at
    once."""
    terms = asked.terms(cell.layout)
    at: dict[str, Array] = {camera: np.zeros(len(words)) for camera, words in terms.items()}
    level = np.inf
    for _ in range(MOST_ROUNDS):
        motions = _motions(cell, solution, asked.times.moments, smoothness)
        clocks = Clocks(asked.times, terms, at, motions, _carried(cell, solution))
        timed, places = in_sight(*_told(replace(cell, clocks=clocks), fitted_places(cell, solution)))
        noise = estimate_noise(
            cell_problem(timed, places, dict(solution.sigmas)), floors=timed.floors(), options=NEARLY_UNDAMPED
        )
        cell, solution, before = timed, noise.solution, at
        at = {camera: solution.value(clock_variable(camera))[0] for camera in terms}
        settled = _still(solution, before, at) and _level(cell, noise) > (1 - SETTLED) * level
        level = _level(cell, noise)
        if settled:
            break
    return noise, replace(cell, clocks=Clocks(asked.times, terms, at, motions, _carried(cell, solution)))


def clocks_found(cell: Cell, solution: Solution) -> CameraClocks | None:
    """The clocks as fitted; None where none was asked for."""
    if cell.clocks is None:
        return None
    there = {v.name for v in solution.problem.variables}
    found = []
    for camera, terms in cell.clocks.terms.items():
        if (name := clock_variable(camera)) in there:
            said = 1e3 * solution.value(name)[0], 1e3 * np.sqrt(np.diag(solution.covariance(name)))
            told = {t: (float(v), float(s)) for t, v, s in zip(terms, *said)}
            none = (None, None)
            found.append(CameraClock(camera, *told.get(OFFSET, none), *told.get(READOUT, none)))
    return CameraClocks(cell.layout.root, tuple(found)) if found else None


@dataclass(frozen=True, eq=False)
class SuspectedClocks:
    """Offsets that nobody asked for, with what all pictures of a moment err alike by in sigma; level: the noise that is
    left with them, px."""

    clocks: CameraClocks
    level: float


def suspected_clocks(cell: Cell, solution: Solution) -> SuspectedClocks | None:
    """Offsets from a fit without them; None where the times are not known or no motion tells.

    What a rig errs by beyond its cameras' own noise is looked for here before it is laid on cameras that moved.
    """
    moments = {name for d in cell.data for name, use in zip(d.ids, d.use) if use}
    if not moments <= set(cell.times.moments):
        return None
    asked = ClocksAsked(cell.times, offsets=True)
    ways = []
    for smoothness in SMOOTHNESSES[:2]:
        try:
            noise, timed = _with_clocks(cell, solution, asked, smoothness)
        except CalibrantError:
            continue  # pictures far apart in time: no motion between them is known; or no clocks explain them
        level = _level(timed, noise)
        alike = moment_errors(timed, noise.solution, sigma_px=level)
        told = noise.solution if alike is None else noise.solution.with_beside(alike.covariance)
        if (found := clocks_found(timed, told)) is not None:
            ways.append(SuspectedClocks(found, level))
    if not ways:
        return None
    best = min(ways, key=lambda way: way.level)
    return replace(best, clocks=_within(best.clocks, [way.clocks for way in ways]))


def _within(found: CameraClocks, ways: Sequence[CameraClocks]) -> CameraClocks:
    """The offsets with a sigma that holds what other motions make of them."""
    clocks = []
    for clock in found.clocks:
        own, sigma = clock.offset_ms, clock.offset_sigma_ms
        others = [c.offset_ms for way in ways for c in way.clocks if c.camera == clock.camera]
        if own is not None and sigma is not None:
            apart = max((abs(o - own) for o in others if o is not None), default=0.0)
            clock = replace(clock, offset_sigma_ms=float(np.hypot(sigma, apart)))
        clocks.append(clock)
    return replace(found, clocks=tuple(clocks))


def _still(solution: Solution, before: Mapping[str, Array], at: Mapping[str, Array]) -> bool:
    return all(
        np.all(np.abs(at[c] - before[c]) <= STILL * np.sqrt(np.diag(solution.covariance(clock_variable(c)))))
        for c in at
    )


def _motions(cell: Cell, solution: Solution, times: Mapping[str, float], smoothness: Smoothness) -> dict[str, Motion]:
    """By the frame of each handheld target."""
    layout = cell.layout
    return {
        frame[1]: motion_of(
            cell.moments_by_hand(frame[1]), solution.value(variable(frame)), times, smoothness=smoothness
        )
        for frame in layout.handheld
    }


def _carried(cell: Cell, solution: Solution) -> dict[str, Array]:
    """T_carrier_target of the targets that another carries, by frame."""
    rigid = [(group[0], name) for group in cell.layout.rigid for name in group[1:]]
    return {name: solution.value(variable((carrier, name)))[0] for carrier, name in rigid}


def _told(cell: Cell, places: Mapping[Frame, Array]) -> tuple[Cell, dict[Frame, Array]]:
    """The cell without the views whose target's motion is not told, and the places of the moments that are left."""
    clocks, layout = cell.clocks, cell.layout
    if clocks is None:
        return cell, dict(places)
    data: list[HandEyeViews] = []
    for _, p, d in cell.lists:
        motion = clocks.motions[layout.carrier(p)]
        known = dict(zip(motion.moments, motion.known.tolist()))
        odd = d.use & np.array([not known.get(m, False) for m in d.ids])
        data.append(d.without(odd, [NO_NEIGHBOUR] * len(d)) if clocks.displaces(p.camera) and odd.any() else d)
    left = replace(cell, data=tuple(data))
    for camera in filter(clocks.displaces, layout.cameras):
        if not any(d.use.any() for _, p, d in left.lists if p.camera == camera):
            raise RefusedError(
                f"{camera}: no two pictures follow each other closely enough to tell how the target moved; its clock "
                "needs a video, or pictures in quick succession, of a target that moves"
            )
    return left, kept_places(cell, left, places)
