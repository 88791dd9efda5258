"""A target or a camera that moved in the middle of the session, and when.

From some view k on the target sits elsewhere (another Z), or the camera does (another X). Every k is tried; the loop
with two transforms must be narrower than six more unknowns make it, all k and both kinds counted (F test).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.cell.loop.fit import LoopFit, Model, fit_loop
from calibrant.calibrate.cell.starts.robust import log_misfit, relative_angles
from calibrant.diagnose.doctor.evidence.case import Case, loop_of
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.loop import Evidence, Loop
from calibrant.diagnose.doctor.evidence.significance import CONVINCING, confidence, nested_test
from calibrant.geometry import se3

What = Literal["target", "camera"]
KINDS: tuple[What, What] = ("target", "camera")

LEAST_PART = 3
"""Fewer views before or after are single wrong poses: they do not determine where the thing went."""
LOOKED_AT = 100
"""Places looked at in long sessions, and all around the best: the misfit falls from far towards the right place."""
PROMISING = 0.02
"""Places whose quick look narrows the loop by less, per view, are not fitted: BETTER is a third and more."""
MOST_COUNTED = 1_000_000
"""Numbers that are counted at a time when medians are looked for at many places: some megabytes."""
TRIED = 3
"""Places that are fitted after the quick look at all of them."""
BETTER = 1.5
"""The loop must become 1.5 times narrower: drift and bending of an arm favour two places over one by tens of per
cent."""
ARM_ERRS_MM, ARM_ERRS_DEG = 5.0, 0.5
"""What the geometry of an arm that nobody identified errs by from one posture to another: some millimetres at worst."""
APART = 2.0
"""A part of the views is of another posture where its poses are turned away from all others by twice what these are
turned from their nearest: the arm's error there is one draw, however many views share it."""
CLEAR = 1e3
"""How many times more likely target or camera must be for the doctor to say which."""


@dataclass(frozen=True, eq=False)
class _Split:
    what: What
    first: int
    fit: LoopFit
    misfit: float


def examine(case: Case) -> list[Finding]:
    """Did the target or the camera move between two views?"""
    n = len(case.index)
    if n < 2 * LEAST_PART + 1:
        return []
    splits = [s for what in KINDS for s in _splits(case, what)]
    if not splits:
        return []
    best = min(splits, key=lambda s: s.misfit)
    used = best.fit.used
    single = fit_loop(case.A, case.B, case.robust.X, used=used, certainty=case.certainty)
    levels = best.fit.sigma_rotation, best.fit.sigma_translation
    before, after = single.squares(*levels), best.fit.squares(*levels)
    # Rotations and translations have a noise level each, and each level rests on half of the numbers.
    p = nested_test(before, after, 6, best.fit.freedom // 2, hypotheses=2 * (n - 2 * LEAST_PART + 1))
    gain = case.misfit - best.misfit
    if p > CONVINCING or before < BETTER**2 * after or gain <= 0:
        return []
    return [_moved_finding(case, best, splits, single, p, gain)]


def _splits(case: Case, what: What) -> list[_Split]:
    """The most promising places of a move, fitted."""
    n, robust = len(case.index), case.robust
    if what == "target":
        d = robust.fit.deviation
    else:
        # A X_i B = Z with Z as the others say: where each view puts the camera.
        d = se3.local(robust.X, se3.inverse(case.A) @ robust.Z @ se3.inverse(case.B))
    stride = max(1, n // LOOKED_AT)
    values = _split_misfits(d, range(LEAST_PART, n - LEAST_PART + 1, stride))
    if stride > 1:
        best = min(values, key=lambda k: values[k])
        near = range(max(LEAST_PART, best - stride), min(n - LEAST_PART, best + stride) + 1)
        values |= _split_misfits(d, near)
    least = float(log_misfit(d - np.median(d, axis=0)).sum()) - PROMISING * n
    likely = sorted((k for k in values if values[k] < least), key=lambda k: values[k])[:TRIED]
    return [s for k in likely if (s := _fitted_split(case, what, k)) is not None]


def _split_misfits(d: Array, places: range) -> dict[int, float]:
    """Misfit of deviations (n, 6) about a median of their own before and from each place on."""
    out = {}
    for k, before, after in zip(places, *_medians(d, np.array(places))):
        moved = d.copy()
        moved[:k] -= before
        moved[k:] -= after
        out[k] = float(log_misfit(moved).sum())
    return out


def _medians(d: Array, places: NDArray[np.intp]) -> tuple[Array, Array]:
    """Medians (k, 6) of the rows of d (n, 6) before each place, and of those from it on.

    A column is sorted once: its rows before a place stand in the sorted column in their order, and the middle one of m
    is where m / 2 of them have been counted.
    """
    n = len(d)
    halves = np.empty((2, len(places), d.shape[1]))
    chunk = max(1, MOST_COUNTED // n)
    for column, values in enumerate(d.T):
        order = np.argsort(values, kind="stable")
        ordered = values[order]
        for first in range(0, len(places), chunk):
            some = places[first : first + chunk, None]
            counted = np.cumsum(order < some, axis=1, dtype=np.int32)
            sizes = (some, n - some)
            for half, count, m in zip(halves, (counted, np.arange(1, n + 1, dtype=np.int32) - counted), sizes):
                middle = [np.argmax(count > rank, axis=1) for rank in ((m - 1) // 2, m // 2)]
                half[first : first + chunk, column] = 0.5 * (ordered[middle[0]] + ordered[middle[1]])
    return halves[0], halves[1]


def _fitted_split(case: Case, what: What, first: int) -> _Split | None:
    """Two places fitted, without the views that fit neither."""
    n, robust = len(case.index), case.robust
    part = (np.arange(n) >= first).astype(np.intp)
    one = np.zeros(n, dtype=np.intp)
    model = Model(one, part) if what == "target" else Model(part, one)
    used = np.ones(n, dtype=bool)
    X = np.tile(robust.X, (model.cameras, 1, 1))
    if what == "camera":
        where = se3.inverse(case.A) @ robust.Z @ se3.inverse(case.B)
        X = np.stack([_middle(where[part == k]) for k in (0, 1)])
    for _ in range(3):
        fit = fit_loop(case.A, case.B, X, model=model, used=used, certainty=case.certainty)
        size = np.sum((fit.deviation / fit.sigmas) ** 2, axis=1)
        typical = max(float(np.median(size)) / 5.348, 1e-9)  # median of chi-square with 6 degrees of freedom
        kept = size / typical < 27.86 * 2  # P = 1e-4, twice: some of the freedom went into the fit
        if any((kept & (part == k)).sum() < LEAST_PART for k in (0, 1)):
            return None
        X = fit.X
        if np.array_equal(kept, used):
            break
        used = kept
    return _Split(what, first, fit, 3 * float(log_misfit(fit.deviation).sum()))


def _middle(T: Array) -> Array:
    """The transform with the least sum of distances to the others."""
    some = T[:: max(1, len(T) // LOOKED_AT)]
    gaps = np.linalg.norm((some[:, None] - some).reshape(len(some), len(some), 16), axis=-1)
    return some[int(np.argmin(gaps.sum(axis=1)))]


def _apart(case: Case, part: NDArray[np.bool_]) -> bool:
    """True where no view (n,) of the part is turned nearly as any of the others are."""
    angles = relative_angles(case.data.T_base_gripper[case.index])
    np.fill_diagonal(angles, np.inf)
    among = np.median(angles[np.ix_(~part, ~part)].min(axis=1))
    return bool(angles[np.ix_(part, ~part)].min() > APART * among)


def _moved_finding(case: Case, best: _Split, splits: list[_Split], single: LoopFit, p: float, gain: float) -> Finding:
    n, k = len(case.index), best.first
    rival = min((s.misfit for s in splits if s.what != best.what), default=np.inf)
    places = best.fit.Z if best.what == "target" else best.fit.X
    mm, deg = se3.deviation(places[0], places[1])
    text = f"{mm:.3g} mm and {deg:.2g} deg"
    parent = case.setup.target_parent if best.what == "target" else case.setup.camera_parent
    before = loop_of(single.deviation)
    evidence = Evidence(Loop(before.mm, before.deg), loop_of(best.fit.deviation))
    if rival - best.misfit > np.log(CLEAR):
        thing = f"the {best.what} moved by {text} in the {parent} frame"
    else:
        thing = f"the target or the camera moved (the {best.what} by {text}; the data do not tell which of the two)"
    shorter = range(k) if k < n - k else range(k, n)
    if mm <= ARM_ERRS_MM and deg <= ARM_ERRS_DEG and _apart(case, np.isin(np.arange(n), list(shorter))):
        which = f"the {len(shorter)} views {'up to ' + case.ids[k - 1] if k < n - k else 'from ' + case.ids[k] + ' on'}"
        message = (
            f"{which} put the {best.what} {text} from where the others put it. Either it moved, or the arm errs by as "
            "much there: no other view has the gripper turned nearly so, and the data do not tell; take "
            "some more in between"
        )
        return Finding(f"{best.what}-moved", "warn", message, confidence(p), evidence, (case.ids[k - 1], case.ids[k]))
    rows = [int(case.index[i]) for i in shorter]
    kept = f"the {n - len(rows)} views {'from ' + case.ids[k] + ' on' if k < n - k else 'up to ' + case.ids[k - 1]}"
    reason = f"left out: {thing} between {case.ids[k - 1]} and {case.ids[k]}"
    return Finding(
        f"{best.what}-moved",
        "fail",
        f"{thing} between {case.ids[k - 1]} and {case.ids[k]}: with two places {evidence.text}",
        confidence(p),
        evidence,
        (case.ids[k - 1], case.ids[k]),
        proposal=f"keep {kept}, or calibrate both parts apart",
        repair=partial(Case.without, rows=rows, reason=reason),
        gain=gain,
    )
