"""Cameras that moved against each other, pairs that were not taken at once, and which side is which."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from calibrant.calibrate.cell.moments.moved import move_between
from calibrant.calibrate.cell.moments.pairs import LEAST, NOISIER, agreed_place, apart
from calibrant.data import Measured, Observations
from calibrant.diagnose.doctor.evidence.significance import CONVINCING, ratio_test, student_test
from calibrant.diagnose.doctor.pairs.case import PairCase, loop_of
from calibrant.diagnose.doctor.pairs.finding import PairFinding, listed, sure
from calibrant.diagnose.doctor.pairs.lenses import exchange
from calibrant.geometry import se3

AGREEING = 0.25
"""Pairs of a part that may contradict the others of it: single ones that do not belong."""


def moved(case: PairCase) -> PairFinding | None:
    """Did the cameras move against each other, once?"""
    found, n = case.found, len(case)
    move = move_between(se3.local(np.broadcast_to(case.place, found.D.shape), found.D), *found.errors)
    if move is None or move.noisier(float(found.freedom.sum())) <= NOISIER:
        return None
    parts = [found.take(*(np.arange(*ends),) * 2) for ends in ((0, move.first), (move.first, n))]
    if any(apart(part, agreed_place(part)).sum() > AGREEING * len(part) for part in parts):
        return None
    mm, deg = (float(v) for v in se3.mm_and_deg(move.step))
    kept = int(np.argmax([len(part) for part in parts]))
    after = loop_of(parts[kept], agreed_place(parts[kept]))
    message = (
        f"{case.right} moved against {case.left} by {mm:.3g} mm and {deg:.2g} deg between "
        f"{case.names(move.first - 1)[0]} and {case.names(move.first)[0]}: before and after it the pairs agree, to "
        f"{after.text} instead of {case.loop.text}"
    )
    dropped = range(move.first, n) if kept == 0 else range(move.first)
    return PairFinding(
        "cameras-moved",
        "fail",
        message,
        sure(move.chance),
        case.loop,
        after,
        tuple(case.names(k)[0] for k in dropped),
        Measured(mm, unit="mm"),
        f"calibrate the {move.first} pairs before and the {n - move.first} after apart; --apply keeps the more",
        partial(alone, case=case, rows=tuple(dropped)),
    )


def not_at_once(case: PairCase) -> PairFinding | None:
    """Pairs that contradict the others, and no fault explains them."""
    rows = np.flatnonzero(case.wrong).tolist()
    if not rows:
        return None
    n = len(case)
    good = np.flatnonzero(~case.wrong)
    if len(good) < max(LEAST, n / 2):
        message = (
            f"{len(good)} of {n} pairs agree on where {case.right} stands to {case.left}, and no order, mirror or "
            "exchange makes them: the pictures are of other moments, or the cameras are not fixed to each other"
        )
        return PairFinding("pairs-disagree", "fail", message, sure(CONVINCING), case.loop)
    mm, deg = se3.deviation(np.broadcast_to(case.place, case.found.D.shape), case.found.D)
    after = loop_of(case.found.take(good, good), case.place)
    said = [f"{a} and {b} ({mm[k]:.3g} mm, {deg[k]:.2g} deg off)" for k in rows for a, b in [case.names(k)]]
    ss = [float(np.mean(np.square(mm[part]))) for part in (rows, good)]
    p = ratio_test(ss[0], ss[1], 3 * len(rows), hypotheses=n)
    names = [case.names(k)[0] for k in rows]
    return PairFinding(
        "pairs-not-at-once",
        "warn",
        f"{len(rows)} of {n} pairs do not show the board at one moment: {listed(said)}. Without them {after.text} "
        f"instead of {case.loop.text}. The board moved between the two shutters, or an image was lost",
        sure(p),
        case.loop,
        after,
        tuple(names),
        proposal=f"leave these pairs out: --exclude {','.join(names)}",
        repair=partial(alone, case=case, rows=tuple(rows)),
    )


def alone(observations: Observations, *, case: PairCase, rows: tuple[int, ...]) -> Observations:
    """The right views of these pairs count for their lens alone."""
    ids = {case.seen[1][k].id for k in rows}
    out = [
        replace(v, moment=f"{v.moment} {case.right} alone") if v.camera == case.right and v.id in ids else v
        for v in observations.views
    ]
    return replace(observations, views=tuple(out))


def sides(case: PairCase) -> PairFinding | None:
    """Does the right camera stand at the left?"""
    good = np.flatnonzero(~case.wrong)
    if len(good) < LEAST:
        return None
    t = 1e3 * case.found.D[good][:, :3, 3]
    x, y, z = 1e3 * case.place[:3, 3]
    sigma = float(np.std(t[:, 0], ddof=1) / np.sqrt(len(good)))
    p = student_test(float(x), sigma, len(good) - 1)
    if x >= 0 or abs(x) < max(abs(y), abs(z)) or p > CONVINCING:
        return None
    message = (
        f"{case.right} stands {-x:.4g} ± {sigma:.2g} mm at the left of {case.left}: the sides are swapped, if the "
        "cameras are not upside down and not both mirrored"
    )
    return PairFinding(
        "sides-swapped",
        "warn",
        message,
        sure(p),
        case.loop,
        case.loop,
        measured=Measured(float(x), sigma, "mm"),
        proposal="exchange --left and --right (or flip both: --mirror-left --mirror-right); --apply exchanges",
        repair=partial(exchange, case=case, moments=None),
    )
