"""A projector and its camera from boards that both know: the board's corners in the camera, and what lights them.

A projector is a camera that sees nothing: its model, its distortion and its pose are an inverse camera's, and camera
and projector are a rig (`cell.rig`) that sees one handheld board. Its own is how the points come about, and that
few views tell neither lens by itself. Points are carried from the camera's corners through the decoded picture, so that
the camera's error is in both (`reprojection.carried`). Both lenses are found in the whole alone, terms of distortion
held within what lenses can do (`reprojection.weak_terms`); those that the views do not tell are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from calibrant.calibrate.cell.calibrate import CellFit, judged_cell
from calibrant.calibrate.cell.fitted import fitted_cameras
from calibrant.calibrate.cell.lens_choice import MODEL, lenses_asked
from calibrant.calibrate.cell.rig import fit_rig
from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
from calibrant.calibrate.projector.checks import least_told, projector_checks
from calibrant.calibrate.projector.start import projector_start
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Observations, verdict_of
from calibrant.data.verdicts import refuse_if_failed
from calibrant.errors import InputError, RefusedError
from calibrant.expected import expect, names_of

CAMERA, PROJECTOR = "camera", "projector"
FIRST_FIX = (("k3", "tangential"), ("k2", "k3", "tangential"))
"""What the camera's first calibration leaves out, and what it does without where that is too much for the views."""


def calibrate_projector(
    observations: Observations,
    *,
    camera: Camera | None = None,
    model: str | Mapping[str, str] = MODEL,
    fix: Sequence[str] | Mapping[str, Sequence[str]] = (),
) -> CalibrationResult:
    """Calibrate a projector, its camera and their pose from views of both, called "camera" and "projector".

    The projector's views are those of the same moments, their points the projector's pixels that light the camera's
    corners; `View.carried` says how an error of a corner is in them. Without it they count as measured apart.
    camera: known intrinsics, held within their covariance. model, fix: for both, or by name.
    Returns a result of kind "projector": both lenses, T_camera_projector (camera → projector) with covariance.
    Raises: InputError for unusable input, RefusedError where the boards do not determine the projector.

        >>> import numpy as np
        >>> from calibrant.simulate.projector.points import board_poses, carried_views, example_pair
        >>> from calibrant.simulate.scenes import grid
        >>> pair, points, rng = example_pair(), grid(9, 7, 0.03), np.random.default_rng(0)
        >>> poses = board_poses(pair, points, 10, rng, distance=(0.7, 1.1))
        >>> seen = carried_views(pair, points, poses, rng, corner_px=0.05, decoded_px=0.03)
        >>> result = calibrate_projector(seen)
        >>> abs(result.cameras["projector"].parameters["fx"] / 1500 - 1) < 1e-3
        True
    """
    seen, lit = _both(observations)
    held = {n: tuple(names_of(f, "fix", "a list of names")) for n, f in _by_name(fix).items()}
    start = camera if camera is not None else _first_camera(seen, model, held[CAMERA])
    shared = {v.moment for v in lit.views}
    views = tuple(v for v in seen.views if v.moment in shared)
    at = projector_start(start, views, lit.views, lit.image_sizes[PROJECTOR])
    initial = {PROJECTOR: at} if camera is not None else {CAMERA: start, PROJECTOR: at}
    left_out: dict[str, tuple[str, ...]] = dict.fromkeys(initial, ())
    while True:
        fit = fit_rig(
            observations,
            cameras=None if camera is None else {CAMERA: camera},
            initial={name: _without(lens, left_out[name]) for name, lens in initial.items()},
            model=model,
            fix={name: (*held[name], *left_out[name]) for name in initial},
            reference=CAMERA,
            together=tuple(initial),
        )
        lenses = fitted_cameras(fit.cell, fit.noise.solution)
        more = {name: term for name in initial if (term := least_told(lenses[name])) is not None}
        if not more:
            break
        # One at a time: without it the others may be told.
        left_out |= {name: (*left_out[name], term) for name, term in more.items()}
    return _judged(fit, model, fix, left_out)


def _judged(
    fit: CellFit,
    model: str | Mapping[str, str],
    fix: Sequence[str] | Mapping[str, Sequence[str]],
    left_out: Mapping[str, tuple[str, ...]],
) -> CalibrationResult:
    """The result with the projector's own checks. Raises: RefusedError, which holds it, where a check failed."""
    asked = {"model": dict(model) if isinstance(model, Mapping) else model} | lenses_asked(fix)
    result = replace(judged_cell(fit, asked), kind="projector")
    checks = (*result.checks, *projector_checks(result, left_out))
    judged = replace(result, checks=checks, verdict=verdict_of(checks))
    refuse_if_failed(judged)
    return judged


def _by_name(fix: Sequence[str] | Mapping[str, Sequence[str]]) -> dict[str, Sequence[str]]:
    """What is held of each. Raises: InputError for a lens there is not."""
    if not isinstance(fix, Mapping):
        return dict.fromkeys((CAMERA, PROJECTOR), fix)
    unknown = sorted(set(fix) - {CAMERA, PROJECTOR})
    if unknown:
        raise InputError(f"`fix` of {unknown[0]!r}: there are {CAMERA} and {PROJECTOR}")
    return {name: fix.get(name, ()) for name in (CAMERA, PROJECTOR)}


def _without(lens: Camera, terms: Sequence[str]) -> Camera:
    """The lens with these terms at 0."""
    return Camera.create(lens.model.name, lens.parameters | dict.fromkeys(terms, 0.0), image_size=lens.image_size)


def _both(observations: Observations) -> tuple[Observations, Observations]:
    """The camera's views and the projector's. Raises: InputError where one is not there."""
    expect(observations, Observations, "observations", "Observations of a camera and a projector")
    names = set(observations.image_sizes)
    if names != {CAMERA, PROJECTOR}:
        raise InputError(
            f"a projector is calibrated from views of {CAMERA!r} and {PROJECTOR!r}; the observations are of "
            f"{', '.join(sorted(names))}"
        )
    return observations.of_camera(CAMERA), observations.of_camera(PROJECTOR)


def _first_camera(seen: Observations, model: str | Mapping[str, str], held: Sequence[str]) -> Camera:
    """The camera by its own views, with as many terms as they allow: the whole goes on from there."""
    kind = model if isinstance(model, str) else model.get(CAMERA, MODEL)
    if kind != MODEL:
        return calibrate_keeping(seen, model=kind, fix=held).result.cameras[CAMERA]
    *tried, last = FIRST_FIX
    for fix in tried:
        try:
            return calibrate_keeping(seen, fix=(*fix, *held)).result.cameras[CAMERA]
        except RefusedError:
            continue
    return calibrate_keeping(seen, fix=(*last, *held)).result.cameras[CAMERA]
