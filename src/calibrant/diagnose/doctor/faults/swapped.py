"""Poses that belong to each other's images: the outlying views are matched anew among themselves."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.cell.starts.robust import log_misfit, noise_freedom
from calibrant.diagnose.doctor.evidence.case import Case, loop_of
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.loop import Evidence
from calibrant.diagnose.doctor.evidence.significance import confidence
from calibrant.geometry import se3
from calibrant.optimize.chances import f_tail

PLAUSIBLE = 1e-5
"""A pose in its new place must fit so well that one right view in a hundred thousand fits worse."""
MOST = 60
"""More outlying views than this are no exchanged poses, and matching all with all takes time."""


def examine(case: Case) -> list[Finding]:
    """Which outlying views fit with the pose of another outlying view?"""
    out = np.flatnonzero(case.robust.outlier)
    if not 2 <= len(out) <= MOST:
        return []
    from scipy.optimize import linear_sum_assignment  # heavy, and rarely needed

    fit, robust = case.robust.fit, case.robust
    loops = (case.A[out] @ robust.X)[:, None] @ case.B[out]
    deviation = se3.local(robust.Z, loops)
    statistic = np.sum((deviation / fit.sigmas[out]) ** 2, axis=-1) / 6
    fits = f_tail(6, noise_freedom(fit), statistic) > PLAUSIBLE
    poses, images = linear_sum_assignment(np.minimum(np.log(statistic + 1e-6), 1e3))
    place = {int(i): int(p) for p, i in zip(poses, images)}
    cycles = [c for c in _cycles(place) if len(c) > 1 and all(fits[place[i], i] for i in c)]
    return [_swapped_finding(case, out, place, cycle, deviation) for cycle in cycles]


def _cycles(place: dict[int, int]) -> list[list[int]]:
    """Closed rings of a permutation."""
    left, rings = set(place), []
    while left:
        here = min(left)
        ring = []
        while here in left:
            left.remove(here)
            ring.append(here)
            here = place[here]
        rings.append(ring)
    return rings


def _swapped_finding(
    case: Case, out: NDArray[np.intp], place: dict[int, int], cycle: list[int], deviation: Array
) -> Finding:
    rows = np.arange(len(case))
    rows[case.index[out[cycle]]] = case.index[out[[place[i] for i in cycle]]]
    after = case.robust.fit.deviation.copy()
    after[out[cycle]] = [deviation[place[i], i] for i in cycle]
    before = log_misfit(case.robust.fit.deviation[out[cycle]]).sum()
    gain = 3 * float(before - log_misfit(after[out[cycle]]).sum())
    names = tuple(case.ids[out[i]] for i in sorted(cycle))
    evidence = Evidence(case.loop, loop_of(after))
    pairs = len(case.index) * (len(case.index) - 1) / 2
    p = min(1.0, pairs * float(np.prod(case.robust.p_value[out[cycle]])))
    told = "have each other's poses" if len(names) == 2 else "have poses that belong to one another"
    return Finding(
        "poses-swapped",
        "warn",
        f"{' and '.join(names) if len(names) == 2 else ', '.join(names)} {told}; exchanged, {evidence.text}",
        confidence(p),
        evidence,
        names,
        proposal="exchange the poses",
        repair=partial(Case.with_order, order=rows),
        gain=gain,
    )
