"""What was found as a result: the answer in words, what may have changed, where points are that should be elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Check, Measured, Observations, ViewResult, verdict_of
from calibrant.data.details import Changes, PhotoShift, PossibleChange
from calibrant.data.verdicts import stamp
from calibrant.diagnose.movement import movement
from calibrant.geometry import se3
from calibrant.verification.unchanged.answer import ANY_CHANGE, Answer, Tolerance, answer_of_both, answer_of_picture
from calibrant.verification.unchanged.compare import Compared
from calibrant.verification.unchanged.consensus import Motion
from calibrant.verification.unchanged.decide import CAMERA_MOVED, Hypothesis

ARROWS = 80
"""Points of a photo that are kept and drawn: more hide the picture."""
NOISIER = 2.0
"""Times the calibration's noise from which that of the photos is worth a word: then corners are blurred, or bent."""


@dataclass(frozen=True, eq=False)
class PicturePair:
    """A photo beside the reference: its id and file, and what became of the picture."""

    id: str
    file: str
    moved: Motion
    image_size: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Evidence:
    """All that was looked at: photos of the target, pictures beside a reference, or both, and the photos as a whole.

    distance: of the workpiece from the camera, metres, None where the result does not tell it. standing: whether the
    camera stands still where nothing happens; then a picture tells a camera that moved from a target that did.
    """

    camera: Camera | None
    compared: Compared | None
    pictures: tuple[PicturePair, ...]
    observations: Observations | None
    files: dict[str, str]
    distance: float | None
    stated_px: float | None = None
    tolerance: Tolerance = ANY_CHANGE


def unchanged_result(evidence: Evidence) -> CalibrationResult:
    """The result of kind "unchanged": its check of that name fails where something changed."""
    compared, pictures = evidence.compared, evidence.pictures
    of_picture = answer_of_picture([p.moved for p in pictures], evidence.camera, evidence.distance, evidence.tolerance)
    found = answer_of_both(compared, of_picture, evidence.tolerance)
    checks = (
        Check("unchanged", "fail" if found.changed else "ok", found.words, found.chance),
        *_checks(evidence, found),
    )
    photos = _shifts_of_target(evidence) if compared is not None else ()
    photos = photos or tuple(_shift_of_picture(p) for p in pictures)
    possible = () if compared is None else tuple(_possible(h, found) for h in compared.decision.hypotheses)
    return stamp(
        CalibrationResult(
            "unchanged",
            verdict_of(checks),
            checks=checks,
            views=_views(evidence),
            figures={name: Measured(*value) for name, value in found.figures.items()},
            details=(Changes(found.words, found.advice, possible, photos),),
            observations=evidence.observations,
        )
    )


def _checks(evidence: Evidence, found: Answer) -> list[Check]:
    checks = []
    compared = evidence.compared
    if compared is not None and evidence.stated_px is not None:
        level = compared.decision.sigma_px
        text = f"a point of these photos is found to {level:.2g} px, at calibration {evidence.stated_px:.2g} px"
        if level > NOISIER * evidence.stated_px:
            text += ": look for blur, another light, a target that is bent or not the one of then"
            checks.append(Check("noise", "warn", text, level))
        else:
            checks.append(Check("noise", "ok", text, level))
    missed = evidence.observations.missed if evidence.observations is not None else ()
    if compared is not None and missed:
        text = "; ".join(f"{m.id}: {m.reason}" for m in missed[:3])
        checks.append(Check("photos", "warn", f"{len(missed)} photos show no target: {text}", float(len(missed))))
    for p in evidence.pictures:
        then, now = p.moved.otherwise
        if len(then):
            step = np.median(now - then, axis=0) - p.moved.shift
            at = np.median(now, axis=0)
            words = f"{p.id}: something in the scene moved by itself, {np.linalg.norm(step):.3g} px near ({at[0]:.0f}, "
            checks.append(Check("scene", "ok", f"{words}{at[1]:.0f}) px; it was left out", float(len(then))))
    checks += [Check("cannot-tell", "warn", text) for text in found.doubts]
    return checks


def _possible(h: Hypothesis, found: Answer) -> PossibleChange:
    words = found.possible.get(h.what, "")
    if CAMERA_MOVED not in h.fit.model.free:
        return PossibleChange(h.what, h.explains, h.chance, h.fits, words)
    moved = movement(h.fit.place[CAMERA_MOVED], h.fit.of(CAMERA_MOVED))
    triples = [_triple(v) for v in (moved.mm, moved.mm_sigma, moved.deg, moved.deg_sigma)]
    return PossibleChange(h.what, h.explains, h.chance, h.fits, words, *triples)


def _triple(values: Array) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in values)
    return x, y, z


def _shifts_of_target(evidence: Evidence) -> tuple[PhotoShift, ...]:
    compared = evidence.compared
    if compared is None:
        return ()
    out = []
    for view, T in zip(compared.seen.views, compared.expected):
        uv = compared.camera.project(se3.apply(T, view.points))
        file = view.file or evidence.files.get(view.id, "")
        out.append(_photo_shift(view.id, file, compared.camera.image_size, uv, view.uv))
    return tuple(out)


def _shift_of_picture(p: PicturePair) -> PhotoShift:
    return _photo_shift(p.id, p.file, p.image_size, p.moved.then, p.moved.now)


def _photo_shift(name: str, file: str, size: tuple[int, int], expected: Array, found: Array) -> PhotoShift:
    good = np.isfinite(expected).all(axis=1)
    expected, found = expected[good], found[good]
    rows = np.linspace(0, max(len(expected) - 1, 0), min(ARROWS, len(expected))).astype(np.int64)
    return PhotoShift(name, size, _pairs(expected[rows]), _pairs(found[rows]), file)


def _pairs(uv: Array) -> tuple[tuple[float, float], ...]:
    return tuple((round(float(u), 2), round(float(v), 2)) for u, v in uv)


def _views(evidence: Evidence) -> tuple[ViewResult, ...]:
    """The photos: those whose target was compared, with what their points scatter by where all is free."""
    if evidence.compared is None:
        return tuple(ViewResult(p.id, True, len(p.moved.then)) for p in evidence.pictures)
    free = evidence.compared.decision.free
    own = [r for r, photo in zip(free.residuals, free.model.photos) if photo.now]
    seen: Sequence[ViewResult] = [
        ViewResult(v.id, True, len(v), float(np.sqrt(np.mean(np.sum(r * r, axis=1)))), camera=v.camera)
        for v, r in zip(evidence.compared.seen.views, own)
    ]
    missed = evidence.observations.missed if evidence.observations is not None else ()
    return (*seen, *(ViewResult(m.id, False, 0, reason=m.reason, camera=m.camera) for m in missed))
