"""Intrinsic calibration: a camera's parameters from views of a target, its model given or chosen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from calibrant.calibrate.intrinsics.checks import focal_length_with_faults
from calibrant.calibrate.intrinsics.fit import ORDINARY
from calibrant.calibrate.intrinsics.model_choice import AUTO, calibrate_auto
from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
from calibrant.calibrate.intrinsics.rolling_fit import GLOBAL, ROLLING, SHUTTERS
from calibrant.calibrate.intrinsics.stopping import stopped, stopping
from calibrant.calibrate.intrinsics.target_shape import FLAT
from calibrant.calibrate.review.review import review
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Observations, verdict_of
from calibrant.data.verdicts import refuse_if_failed
from calibrant.errors import InputError
from calibrant.expected import expect


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
    stop = stopping(max_iterations, epsilon_px)
    _check_shutter(shutter, model=model, target_shape=target_shape)
    if model == AUTO and stop != ORDINARY:
        raise InputError("max_iterations and epsilon are of one model: with auto, each is fitted to its least error")
    if model == AUTO:
        return _reviewed(calibrate_auto(observations, fix=fix, initial=initial, max_error_px=max_error_px))
    kept = calibrate_keeping(
        observations, model=model, fix=fix, initial=initial, max_error_px=max_error_px, target_shape=target_shape,
        shutter=shutter, stop=stop,
    )  # fmt: skip
    return _reviewed(stopped(kept.result, stop))


def _check_shutter(shutter: str, *, model: str, target_shape: str) -> None:
    """Raises: InputError for a shutter there is not, or with what is not estimated beside motions."""
    if shutter not in SHUTTERS:
        raise InputError(f"unknown shutter {shutter!r}; known: {', '.join(SHUTTERS)}")
    if shutter == ROLLING and model == AUTO:
        raise InputError("a rolling shutter is estimated with one model: choose with auto on photos taken at rest")
    if shutter == ROLLING and target_shape != FLAT:
        raise InputError("a view's motion hides a board's shape: estimate the one or the other, not both at once")


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
