"""Intrinsic calibration: a camera's parameters from views of a target, its model given or chosen."""

from __future__ import annotations

from collections.abc import Sequence

from calibrant.calibrate.intrinsics.model_choice import AUTO, calibrate_auto
from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
from calibrant.calibrate.intrinsics.target_shape import FLAT
from calibrant.calibrate.review.review import review
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Observations
from calibrant.data.verdicts import refuse_if_failed
from calibrant.errors import InputError


def calibrate_intrinsics(
    observations: Observations,
    *,
    model: str = "brown",
    fix: Sequence[str] = (),
    initial: Camera | None = None,
    max_error_px: float | None = None,
    target_shape: str = FLAT,
) -> CalibrationResult:
    """Calibrate one camera from views of a planar target.

    model: one of `cameras.MODELS`, "splined" with a grid laid over the points, or "auto" to choose by held-out views.
    fix: parameters (or aspect, radial, tangential, focal, principal) held at `initial`, or at their neutral values.
    initial: start values; its model may differ, terms it lacks start at 0. max_error_px: points above it are left out
    and the rest is calibrated again. target_shape: "flat", or estimated with the camera: "paraboloid" or "free" (see
    `target_shape`); the result then holds its shape among `details`.
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
    if model == AUTO:
        return _reviewed(calibrate_auto(observations, fix=fix, initial=initial, max_error_px=max_error_px))
    kept = calibrate_keeping(
        observations, model=model, fix=fix, initial=initial, max_error_px=max_error_px, target_shape=target_shape
    )
    return _reviewed(kept.result)


def _reviewed(result: CalibrationResult) -> CalibrationResult:
    """The result, reviewed. Raises: RefusedError, which holds it, where its own observations speak against it."""
    reviewed = review(result)
    refuse_if_failed(reviewed)
    return reviewed
