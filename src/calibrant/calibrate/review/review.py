"""What a finished calibration is asked of its own observations, whoever asked for it: no files are needed."""

from __future__ import annotations

from dataclasses import replace

from calibrant.calibrate.review.coverage import covered, with_coverage_checks
from calibrant.calibrate.review.of_views import with_view_checks
from calibrant.calibrate.review.residuals import Structure, fitted_poses, structure_of, view_residuals
from calibrant.data import CalibrationResult, verdict_of
from calibrant.data.details import SharedErrors

MOMENTS = "moments"
"""Name of the check of a rig, whose sigma holds what all pictures of a moment err alike by."""


def review(result: CalibrationResult) -> CalibrationResult:
    """The result with the checks that its observations answer; a warning turns the verdict "ok" to "warn".

    A result that was reviewed stays as it is.
    """
    if result.observations is None or not result.cameras:
        return result
    known = {c.name for c in result.checks}
    poses = fitted_poses(result)
    residuals = view_residuals(result, poses)
    held = result.detail(SharedErrors) is not None or MOMENTS in known
    structures: dict[str, Structure] = {}
    for name, camera in result.cameras.items():
        mine = tuple(v for v in residuals if v.camera == name)
        if mine:
            structures[name] = structure_of(mine, image_size=camera.image_size)
    alone = len(result.cameras) == 1
    words = {name: structure.check(held=held) for name, structure in structures.items()}
    asked = [c if alone else replace(c, name=f"{c.name}-{name}") for name, c in words.items()]
    checks = (*result.checks, *(c for c in asked if c.name not in known))
    reviewed = with_view_checks(replace(result, checks=checks, verdict=verdict_of(checks)), poses, structures)
    if not result.is_about_cameras:
        return reviewed
    return with_coverage_checks(reviewed, covered(reviewed, poses, residuals, words))
