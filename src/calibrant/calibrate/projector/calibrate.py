"""A projector and its camera from boards that both know: the board's corners in the camera, and what lights them.

A projector is a camera that sees nothing: its model, its distortion and its pose are an inverse camera's, and camera
and projector are a rig (`cell.rig`) that sees one handheld board. Its own is how the points come about, and that
few views tell neither lens by itself. Points are carried from the camera's corners through the decoded picture, so that
the camera's error is in both (`reprojection.carried`). Both lenses are found in the whole alone, as in any cell with
projectors (`cell.lit`): `calibrate_cell` of one camera and one projector gives the same digits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

from calibrant.calibrate.cell.calibrate import fit_with_projectors, judged_cell
from calibrant.calibrate.cell.lens_choice import MODEL, lenses_asked
from calibrant.calibrate.cell.lit.checks import with_projector_checks
from calibrant.calibrate.cell.problem.layout import HANDHELD, Pictures
from calibrant.calibrate.cell.rig import fit_rig
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Observations
from calibrant.data.verdicts import refuse_if_failed
from calibrant.errors import InputError
from calibrant.expected import expect

CAMERA, PROJECTOR = "camera", "projector"


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
    lists = [Pictures(name, HANDHELD, seen) for name, seen in _both(observations).items()]
    known = None if camera is None else {CAMERA: camera}
    held = _by_name(fix)
    attempt = partial(fit_rig, observations, cameras=known, model=model, reference=CAMERA)
    sources = {PROJECTOR: CAMERA}
    fit, left_out = fit_with_projectors(
        attempt, lists, sources, cameras=known or {}, initial=None, model=model, fix=held
    )
    asked = {"model": dict(model) if isinstance(model, Mapping) else model} | lenses_asked(fix)
    judged = with_projector_checks(replace(judged_cell(fit, asked), kind="projector"), sources, left_out)
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


def _both(observations: Observations) -> dict[str, Observations]:
    """The camera's views and the projector's. Raises: InputError where one is not there."""
    expect(observations, Observations, "observations", "Observations of a camera and a projector")
    names = set(observations.image_sizes)
    if names != {CAMERA, PROJECTOR}:
        raise InputError(
            f"a projector is calibrated from views of {CAMERA!r} and {PROJECTOR!r}; the observations are of "
            f"{', '.join(sorted(names))}"
        )
    return {name: observations.of_camera(name) for name in (CAMERA, PROJECTOR)}
