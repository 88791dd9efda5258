"""What a stereo pair is asked: which side is which, what both saw, and whether points lie on their partners' lines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from calibrant.calibrate.stereo.pairs import Seen
from calibrant.cameras import Camera
from calibrant.data import Check, Observations, TransformEstimate
from calibrant.data.details import EpipolarErrors
from calibrant.optimize.chances import chi2_tail

EPIPOLAR_WARN = 1.5
"""Epipolar errors over what the pixels' noise makes of them: a common geometry for all pairs leaves them nearly so."""
DIFFERENT = 1e-4
"""Chance of focal lengths as different of two that are the same: one of ten thousand pairs is warned of."""
FOCAL = ("fx", "fy")
_LEAVE_OUT = "Leave --same-focal out, or their places take up the difference"
FEW_POINTS = 4
"""Points of a pair that both saw, below which their relative pose is not seen in it."""
_LISTED = 4


def sides_check(left: str, right: str, T: TransformEstimate) -> Check:
    """Does the right camera stand at the right of the left one, by the sign of the baseline?"""
    x, y, z = 1e3 * T.matrix[:3, 3]
    text = f"{right} is at ({x:.4g}, {y:.4g}, {z:.4g}) mm in the frame of {left}"
    if abs(z) > max(abs(x), abs(y)):
        return Check("sides", "ok", f"{text}: before or behind it more than beside it", float(x))
    if abs(y) > abs(x):
        below = "below" if y > 0 else "above"
        message = f"{text}: {below} it, so that rows are columns here"
        return Check("sides", "ok", message, float(y))
    if x > 0:
        return Check("sides", "ok", f"{text}: at its right", float(x))
    message = (
        f"{text}: at its left, so that the sides are swapped, if the cameras are not upside down. The calibration "
        f"holds as it is named; for depth with the usual sign, exchange the images of {left} and {right}"
    )
    return Check("sides", "warn", message, float(x))


def pairs_check(found: Observations | None, left: str, right: str, pairs: Sequence[Seen]) -> Check:
    """How many moments both saw, which only one did, and which share too few points to say much."""
    views = () if found is None else found.views
    seen = {side: {v.moment for v in views if v.camera == side} for side in (left, right)}
    both = seen[left] & seen[right]
    text = f"{len(pairs)} pairs used, {sum(len(p.point_ids) for p in pairs)} points seen by both"
    unused = len(both) - len(pairs)
    if unused > 0:
        text += f"; {unused} of {len(both)} pairs not used, for the reasons beside their views"
    for side, other in ((left, right), (right, left)):
        alone = [v for v in views if v.camera == side and v.moment not in seen[other]]
        if alone:
            text += f"; {side} alone saw the board in {_listed([v.id for v in alone])}, which count for its lens"
    few = [p.left for p in pairs if len(p.point_ids) < FEW_POINTS]
    if few:
        text += f"; fewer than {FEW_POINTS} points in common: {_listed(few)}"
    return Check("pairs", "ok", text, float(len(pairs)))


def epipolar_checks(errors: EpipolarErrors | None) -> tuple[Check, ...]:
    """Do points lie on the lines of their partners, as the pixels' noise has it?"""
    if errors is None:
        message = "no point was seen by both cameras at one moment: the pair rests on the board's shape alone"
        return (Check("epipolar", "warn", message),)
    text = (
        f"points lie {errors.rms_px:.3g} px rms from the lines of their partners ({errors.min_px:.2g} to "
        f"{errors.max_px:.3g} px); the noise of both images makes {errors.expected_px:.3g} px"
    )
    ratio = errors.rms_px / errors.expected_px if errors.expected_px > 0 else 1.0
    if ratio <= EPIPOLAR_WARN:
        return (Check("epipolar", "ok", text, errors.rms_px),)
    rms = {pair.left: pair.rms_px for pair in errors.pairs.values()}
    worst = max(rms, key=lambda name: rms[name])
    typical = float(np.median(list(rms.values())))
    message = f"{text}. Most at {worst}, {rms[worst]:.3g} px (typical: {typical:.3g} px)"
    return (Check("epipolar", "warn", message, errors.rms_px),)


def same_focal_checks(cameras: Mapping[str, Camera], free: Mapping[str, Camera] | None = None) -> tuple[Check, ...]:
    """Do two cameras that are taken to have one focal length have it by their own images? cameras: as those have
    them; free: as both were found without the option, where it alone bends their lenses."""
    if not cameras:
        return ()
    if free is not None:
        message = (
            f"the images contradict one focal length for both: without it {_both_focals(free)}, and the lenses are as "
            f"their photos alone have them; with it they are bent. {_LEAVE_OUT}"
        )
        return (Check("same-focal", "warn", message),)
    a, b = cameras.values()
    names = [n for n in FOCAL if a.sigma.get(n) and b.sigma.get(n)]
    at_a, at_b = ([c.model.index(n) for n in names] for c in (a, b))
    if not names or a.covariance is None or b.covariance is None:
        return ()
    d = b.values[at_b] - a.values[at_a]
    C = a.covariance[np.ix_(at_a, at_a)] + b.covariance[np.ix_(at_b, at_b)]
    chance = chi2_tail(len(d), float(d @ np.linalg.pinv(C, hermitian=True) @ d))
    if chance < DIFFERENT:
        message = (
            f"the images contradict one focal length for both: by the images of each {_both_focals(cameras)}; they are "
            f"not the same. {_LEAVE_OUT}"
        )
        return (Check("same-focal", "warn", message, chance),)
    said = ", ".join(f"{n} by {x:.2g} ± {s:.2g} px" for n, x, s in zip(names, d, np.sqrt(np.diag(C))))
    text = f"by their own images the focal lengths differ: {said}, which is chance: one unknown serves both"
    return (Check("same-focal", "ok", text, chance),)


def _both_focals(cameras: Mapping[str, Camera]) -> str:
    """fx and fy of both cameras, where they were found."""
    found = [n for n in FOCAL if all(c.sigma.get(n) for c in cameras.values())]
    each = [[f"{c.parameters[n]:.5g} ± {c.sigma[n]:.2g} px in {who}" for who, c in cameras.items()] for n in found]
    return ", ".join(f"{n} is {' and '.join(both)}" for n, both in zip(found, each))


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:_LISTED]) + (f" … ({len(names)})" if len(names) > _LISTED else "")
