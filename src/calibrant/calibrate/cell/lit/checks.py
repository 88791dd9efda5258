"""What a finished projector is asked: which terms the boards told, whether its lens is shifted, is the board flat."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from calibrant.calibrate.cell.lit.board import flatness_check
from calibrant.calibrate.reprojection.weak_terms import corner_reach, term_sigma
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Check, verdict_of

UNTOLD = 0.5
"""Of the prior's sigma: a quarter or more of what is known of a term this uncertain comes from the prior."""
BESIDE = 2.0
"""Sigmas from 0 at which a term is told all the same."""


def with_projector_checks(
    result: CalibrationResult, projectors: Mapping[str, str], weak: Mapping[str, Sequence[str]]
) -> CalibrationResult:
    """The result with what projectors are asked beside all else. projectors: the camera that sees each; weak: terms
    that the boards hardly told, by lens."""
    if not projectors:
        return result
    alone = len(projectors) == 1
    boards = [flatness_check(result, camera=c, projector=p, alone=alone) for p, c in projectors.items()]
    terms = [_terms_check(name, result.cameras[name], terms) for name, terms in weak.items()]
    shifts = [_shift_check(name, result.cameras[name], alone=alone) for name in projectors]
    # The boards first, before what bent ones make of lenses.
    checks = (*(b for b in boards if b is not None), *result.checks, *terms, *shifts)
    return replace(result, checks=checks, verdict=verdict_of(checks))


def untold(camera: Camera) -> tuple[str, ...]:
    """The terms of distortion of which the views tell less than the prior does, and that they do not tell from 0."""
    reach = corner_reach(camera)
    return tuple(
        name
        for name, sigma in camera.sigma.items()
        if (prior := term_sigma(name, reach)) is not None
        and sigma > UNTOLD * prior
        and abs(camera.parameters[name]) < BESIDE * sigma
    )


def _terms_check(name: str, camera: Camera, terms: Sequence[str]) -> Check:
    if not terms:
        return Check(f"weak-terms-{name}", "ok", f"{name}: the boards tell every term of the distortion", 0.0)
    held = ", ".join(f"{t} {camera.parameters[t]:.2g} ± {camera.sigma[t]:.2g}" for t in terms)
    message = (
        f"{name}: the boards hardly tell {', '.join(terms)}; {'it is' if len(terms) == 1 else 'they are'} held near 0, "
        f"within what lenses do ({held}). More boards, out to the corners of the picture, would tell"
    )
    return Check(f"weak-terms-{name}", "ok", message, float(len(terms)))


def _shift_check(name: str, projector: Camera, *, alone: bool) -> Check:
    """Where the axis leaves the picture: projectors for tables and walls throw their picture to one side."""
    width, height = projector.image_size
    cx, cy = projector.parameters["cx"], projector.parameters["cy"]
    x, y = (cx - (width - 1) / 2) / width, (cy - (height - 1) / 2) / height
    outside = max(abs(x), abs(y)) > 0.5
    message = (
        f"the principal point is {x:+.0%} of the picture's width and {y:+.0%} of its height off the middle"
        f"{', outside the picture: the lens is shifted' if outside else ''}"
    )
    label, words = ("", "") if alone else (f"-{name}", f"{name}: ")
    return Check(f"lens-shift{label}", "ok", f"{words}{message}", float(max(abs(x), abs(y), key=abs)))
