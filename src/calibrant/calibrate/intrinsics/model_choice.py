"""Which camera model? A ladder of models, judged by views that they have not seen.

Every candidate is calibrated on all views but a fold, then only the poses of the fold's views are fitted: the error
left there is what the camera will have in use. More terms always fit the seen views better, and the unseen ones only
while they describe the lens. The simplest candidate that is as good as the best within its uncertainty is taken; the
Bayesian information criterion (Schwarz 1978), n ln(SSR / n) + k ln n, is the second opinion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.classical import planar as planar_start
from calibrant.calibrate.intrinsics.one_model import Kept, calibrate_keeping
from calibrant.calibrate.pose.target_poses import target_poses
from calibrant.calibrate.reprojection.factor import stack
from calibrant.calibrate.reprojection.held import ASPECT, GROUPS, RADIAL_GROUP, expand_fix
from calibrant.calibrate.starts import any_lens as camera_start
from calibrant.calibrate.starts.with_depth import is_flat
from calibrant.cameras import Camera, camera_model
from calibrant.data import CalibrationResult, Check, HeldOut, Observations, verdict_of
from calibrant.data.details import ModelCandidate, ModelChoice
from calibrant.data.results import Status
from calibrant.errors import CalibrantError, InputError, RefusedError, causes

AUTO = "auto"
NARROW_DEG, WIDE_DEG = 35.0, 65.0
"""Angle from the axis to which the views reach. Up to 35 degrees brown's polynomial serves every ordinary lens; from
65 on (130 degrees of view) perspective coordinates exceed twice the focal length and its polynomial cannot follow."""
LADDERS = {
    "narrow": ("pinhole", "brown", "rational"),
    "middle": ("pinhole", "extended_unified", "kannala_brandt", "brown", "rational"),
    "wide": ("extended_unified", "double_sphere", "division", "kannala_brandt", "unified"),
}
FOLDS = 5
FEWEST_VIEWS = 6
"""Below it a fold's calibration rests on four views or fewer, and says nothing of the calibration on all."""
NEGLIGIBLE = 0.01
"""A held-out error 1 % above the best is worth no further term: two detectors differ by more."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """One model's figures: free parameters, rms of the fit and held out (px, per point over both axes), BIC.

    squares (m,): mean squared held-out error of every view. reason: why the model is out, when it is.
    """

    model: str
    free: int = 0
    rms_px: float | None = None
    held_out_px: float | None = None
    bic: float | None = None
    squares: Array | None = None
    reason: str | None = None

    @property
    def record(self) -> ModelCandidate:
        """What the result keeps."""
        return ModelCandidate(self.model, self.free, self.rms_px, self.held_out_px, self.bic, self.reason)


@dataclass(frozen=True, eq=False)
class Choice:
    """The chosen model, all candidates in the ladder's order, and the reason in words with its status."""

    model: str
    candidates: tuple[Candidate, ...]
    check: Check


def calibrate_auto(
    observations: Observations,
    *,
    fix: Sequence[str] = (),
    initial: Camera | None = None,
    max_error_px: float | None = None,
) -> CalibrationResult:
    """`calibrate_intrinsics` with the model that `choose_model` takes, its held-out error, and why.

    Raises: as `choose_model` and `calibrate_intrinsics`.
    """
    choice = choose_model(observations, ladder(observations, fix), fix=fix, initial=initial, max_error_px=max_error_px)
    chosen = next(c for c in choice.candidates if c.model == choice.model)
    result = calibrate_keeping(
        observations, model=choice.model, fix=fix, initial=initial, max_error_px=max_error_px
    ).result
    checks = (*result.checks, choice.check)
    return replace(
        result,
        checks=checks,
        verdict=verdict_of(checks),
        held_out=HeldOut(px=chosen.held_out_px),
        options={**result.options, "model": "auto"},
        details=(ModelChoice(tuple(c.record for c in choice.candidates)),),
    )


def ladder(observations: Observations, fix: Sequence[str] = ()) -> tuple[str, ...]:
    """Models to try, simplest first, by how far from the axis the views reach; those that lack a fixed term are out.

    Raises: InputError when no model of the ladder has the fixed terms.
    """
    views = [v for v in observations.views if len(v) >= 4]
    rungs = LADDERS["narrow"]
    if views and is_flat(np.concatenate([v.points for v in views])):
        stacked = stack(views)
        image_size = next(iter(observations.image_sizes.values()))
        xy = planar_start.in_plane(stacked.points).xy
        try:
            start = camera_start.radial_start(xy, stacked.uv, stacked.offsets, image_size)
        except RefusedError:
            reach = 0.0
        else:
            reach = float(np.rad2deg(np.quantile(start.angles(stacked.uv), 0.999)))
        rungs = LADDERS["narrow" if reach < NARROW_DEG else "middle" if reach < WIDE_DEG else "wide"]
    groups = (ASPECT, RADIAL_GROUP, *GROUPS)
    known = [r for r in rungs if all(f in (*groups, *camera_model(r).parameter_names) for f in fix)]
    if not known:
        raise InputError(f"--model auto tries {', '.join(rungs)}, and none has all of: {', '.join(fix)}")
    return tuple(known)


def choose_model(
    observations: Observations,
    models: Sequence[str],
    *,
    fix: Sequence[str] = (),
    initial: Camera | None = None,
    max_error_px: float | None = None,
) -> Choice:
    """The simplest of the models, given simplest first, that is as good on unseen views as the best of them.

    Raises: InputError with fewer than six views; RefusedError when no model can be calibrated.
    """
    fits: dict[str, Kept | CalibrantError] = {}
    for model in models:
        try:
            fits[model] = calibrate_keeping(
                observations, model=model, fix=fix, initial=initial, max_error_px=max_error_px
            )
        except RefusedError as refusal:
            fits[model] = refusal
    kept = [f for f in fits.values() if isinstance(f, Kept)]
    if not kept:
        raise RefusedError("no model fits:\n" + causes(f"{m}: {f}" for m, f in fits.items()))
    # All models are judged on the same points: those that the closest fit keeps.
    best = min(kept, key=lambda f: f.result.rms_px or np.inf)
    if len(best.views) < FEWEST_VIEWS:
        raise InputError(
            f"--model auto holds views out to judge models, and needs {FEWEST_VIEWS} or more; there are "
            f"{len(best.views)}. Name a model: --model brown"
        )
    judged = replace(observations, views=best.views)
    candidates = tuple(_judge(judged, model, fits[model], fix, initial) for model in models)
    return _decide(candidates)


def _judge(
    observations: Observations, model: str, fit: Kept | CalibrantError, fix: Sequence[str], initial: Camera | None
) -> Candidate:
    """Held-out errors and BIC of one model on given views."""
    if not isinstance(fit, Kept):
        return Candidate(model, reason=str(fit))
    kind = fit.result.camera.model
    free = len(kind.parameter_names) - len(expand_fix(fix, kind)[0])
    folds = min(FOLDS, len(observations.views))
    squares = np.empty(len(observations.views))
    try:
        on_all = target_poses(fit.result.camera, observations.views).rms_px
        for fold in range(folds):
            out = np.arange(len(squares)) % folds == fold
            seen = replace(observations, views=tuple(v for v, o in zip(observations.views, out) if not o))
            camera = calibrate_keeping(seen, model=model, fix=fix, initial=initial).result.camera
            held = [v for v, o in zip(observations.views, out) if o]
            squares[out] = target_poses(camera, held).rms_px ** 2
    except CalibrantError as failure:
        return Candidate(model, free, rms_px=fit.result.rms_px, reason=f"fails on held-out views: {failure}")
    points = np.array([len(v) for v in observations.views])
    n = 2 * points.sum()
    ssr = float(np.sum(points * on_all**2))
    return Candidate(
        model,
        free,
        rms_px=float(np.sqrt(ssr / points.sum())),
        held_out_px=float(np.sqrt(np.average(squares, weights=points))),
        bic=float(n * np.log(ssr / n) + free * np.log(n)),
        squares=squares,
    )


def _decide(candidates: tuple[Candidate, ...]) -> Choice:
    """The simplest candidate as good as the best: within two standard errors of the paired difference, or 1 %."""
    able = [c for c in candidates if c.squares is not None]
    if not able:
        raise RefusedError("no model fits:\n" + causes(f"{c.model}: {c.reason}" for c in candidates))
    best = min(able, key=lambda c: c.held_out_px or np.inf)
    chosen = next(c for c in sorted(able, key=lambda c: c.free) if _as_good(c, best))
    by_bic = min(able, key=lambda c: c.bic if c.bic is not None else np.inf)
    parts = [f"{chosen.model} ({chosen.free} parameters) leaves {chosen.held_out_px:.3g} px on held-out views"]
    for c in able:
        if c is not chosen:
            word = "no better" if c.free > chosen.free and _as_good(chosen, c) else "not as good"
            word = "as good, with more parameters" if c.free > chosen.free and _as_good(c, chosen) else word
            parts.append(f"{c.model} ({c.free}) {c.held_out_px:.3g} px, {word}")
    parts += [f"{c.model} is out: {_first_words(c.reason)}" for c in candidates if c.squares is None]
    text = "; ".join(parts)
    if by_bic is chosen:
        return Choice(chosen.model, candidates, Check("model-choice", "ok", f"{text}; BIC agrees", chosen.held_out_px))
    text += f"; BIC prefers {by_bic.model}"
    # BIC counts every point as independent and so favours terms; it matters when it asks for fewer.
    status: Status = "warn" if by_bic.free < chosen.free else "ok"
    return Choice(chosen.model, candidates, Check("model-choice", status, text, chosen.held_out_px))


def _as_good(candidate: Candidate, other: Candidate) -> bool:
    """Whether a candidate's held-out error is no larger than another's, within what the views can tell."""
    if candidate.squares is None or other.squares is None:
        return False
    difference = candidate.squares - other.squares
    error = float(np.std(difference, ddof=1) / np.sqrt(len(difference)))
    slack = max(2 * error, 2 * NEGLIGIBLE * float(other.squares.mean()))
    return float(difference.mean()) <= slack


def _first_words(reason: str | None) -> str:
    return (reason or "").split(". ")[0]
