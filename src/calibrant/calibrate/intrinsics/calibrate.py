"""Intrinsic calibration: a camera's parameters from views of a target, its model given or chosen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibrant.calibrate.intrinsics.checks import focal_length_with_faults
from calibrant.calibrate.intrinsics.fit import ORDINARY, Stopping
from calibrant.calibrate.intrinsics.model_choice import AUTO, calibrate_auto
from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
from calibrant.calibrate.intrinsics.rolling_fit import GLOBAL, ROLLING, SHUTTERS
from calibrant.calibrate.intrinsics.target_shape import FLAT
from calibrant.calibrate.review.review import review
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Check, Observations, verdict_of
from calibrant.data.verdicts import refuse_if_failed
from calibrant.errors import InputError
from calibrant.expected import expect

NEGLIGIBLE = 0.1
"""Of a sigma: what adds half a per cent to it."""


def calibrate_intrinsics(
    observations: Observations,
    *,
    model: str = "brown",
    fix: Sequence[str] = (),
    initial: Camera | None = None,
    max_error_px: float | None = None,
    target_shape: str = FLAT,
    shutter: str = GLOBAL,
    max_iterations: int = 100,
    epsilon_px: float = 0.0,
) -> CalibrationResult:
    """Calibrate one camera from views of a planar target.

    model: one of `cameras.MODELS`, "splined" with a grid laid over the points, or "auto" to choose by held-out views.
    fix: parameters (or aspect, radial, tangential, focal, principal) held at `initial`, or at their neutral values.
    initial: start values; its model may differ, terms it lacks start at 0. max_error_px: points above it are left out
    and the rest is calibrated again. target_shape: "flat", or estimated with the camera: "paraboloid" or "free" (see
    `target_shape`); the result then holds its shape among `details`. shutter: "global", or "rolling": rows are read one
    after the other, top first, and each view's motion over the readout is estimated too (see `rolling_factor`);
    the result then holds a `RollingShutter` among its details. max_iterations, epsilon_px: the solver stops after
    so many steps, unconverged, and when the next one would lower the RMS error by less; 0: at the least error.
    Returns a CalibrationResult of kind "intrinsics", reviewed: its checks and verdict are the command line's.
    Raises: InputError for unusable input; RefusedError when the views cannot determine the camera, naming what is
    missing.

        >>> import calibrant as cb
        >>> from calibrant.simulate.scenes import intrinsics_scene
        >>> result = cb.calibrate_intrinsics(intrinsics_scene(6).observations, model="brown")
        >>> sorted(result.camera.parameters)[:4]
        ['cx', 'cy', 'fx', 'fy']
    """
    if not isinstance(observations, Observations):
        found = type(observations).__name__
        raise InputError(
            f"calibrate_intrinsics takes Observations, as calibrant.detect gives them, not {found}; "
            "calibrant.intrinsics takes photos"
        )
    expect(model, str, "model", "a camera model's name, such as 'brown'")
    expect(initial, (Camera, type(None)), "initial", "a Camera")
    stop = _stopping(max_iterations, epsilon_px)
    _check_shutter(shutter, model=model, target_shape=target_shape)
    if model == AUTO and stop != ORDINARY:
        raise InputError("max_iterations and epsilon are of one model: with auto, each is fitted to its least error")
    if model == AUTO:
        return _reviewed(calibrate_auto(observations, fix=fix, initial=initial, max_error_px=max_error_px))
    kept = calibrate_keeping(
        observations, model=model, fix=fix, initial=initial, max_error_px=max_error_px, target_shape=target_shape,
        shutter=shutter, stop=stop,
    )  # fmt: skip
    return _reviewed(_stopped(kept.result, stop))


def _check_shutter(shutter: str, *, model: str, target_shape: str) -> None:
    """Raises: InputError for a shutter there is not, or with what is not estimated beside motions."""
    if shutter not in SHUTTERS:
        raise InputError(f"unknown shutter {shutter!r}; known: {', '.join(SHUTTERS)}")
    if shutter == ROLLING and model == AUTO:
        raise InputError("a rolling shutter is estimated with one model: choose with auto on photos taken at rest")
    if shutter == ROLLING and target_shape != FLAT:
        raise InputError("a view's motion hides a board's shape: estimate the one or the other, not both at once")


def _stopping(max_iterations: int, epsilon_px: float) -> Stopping:
    """Raises: InputError for values that no solver can do with."""
    if max_iterations < 1 or not 0 <= epsilon_px < float("inf"):
        raise InputError(
            f"max_iterations is 1 or more and epsilon 0 px or more, got {max_iterations} and {epsilon_px} px"
        )
    return Stopping(max_iterations, epsilon_px)


def _stopped(result: CalibrationResult, stop: Stopping) -> CalibrationResult:
    """The result with what was asked of the solver and, of an epsilon, how far from the least error it may be.

    A step that would lower the RMS error e of n points by eps has lowered their cost by no more than n e eps; in sigmas
    of the noise, e / sqrt(2) per axis, it is no longer than sqrt(4 n eps / e).
    """
    if stop == ORDINARY:
        return result
    options = {**result.options, "max_iterations": stop.max_iterations, "epsilon_px": stop.epsilon_px}
    done = replace(result, options=options)
    points = sum(v.points for v in result.views if v.used)
    if not stop.epsilon_px or not result.rms_px:
        return done
    sigmas = float(np.sqrt(4 * points * stop.epsilon_px / result.rms_px))
    text = f"stopped at epsilon {stop.epsilon_px:g} px, up to {sigmas:.2g} sigma from the least error"
    coarse = sigmas > NEGLIGIBLE
    check = Check(
        "termination", "warn" if coarse else "ok", text + (", which no sigma holds" if coarse else ""), sigmas
    )
    checks = (*result.checks, check)
    return replace(done, checks=checks, verdict=verdict_of(checks))


def _reviewed(result: CalibrationResult) -> CalibrationResult:
    """The result, reviewed. Raises: RefusedError, which holds it, where its own observations speak against it."""
    reviewed = _one_sigma(review(result), result)
    refuse_if_failed(reviewed)
    return reviewed


def _one_sigma(reviewed: CalibrationResult, fitted: CalibrationResult) -> CalibrationResult:
    """The result whose check of the focal length states the sigma that the review left it with, after its causes."""
    check = focal_length_with_faults(reviewed.camera, fitted.camera)
    if check is None:
        return reviewed
    checks = (*(c for c in reviewed.checks if c.name != check.name), check)
    return replace(reviewed, checks=checks, verdict=verdict_of(checks))
