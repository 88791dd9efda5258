"""What a finished calibration is asked of its own observations, whoever asked for it: no files are needed."""

from __future__ import annotations

from dataclasses import replace

from calibrant.calibrate.review.coverage import with_coverage_checks
from calibrant.calibrate.review.residuals import fitted_poses, structure_check, view_residuals
from calibrant.data import CalibrationResult, verdict_of


def review(result: CalibrationResult) -> CalibrationResult:
    """The result with the checks that its observations answer; a warning turns the verdict "ok" to "warn".

    A result that was reviewed stays as it is.
    """
    if result.observations is None or not result.cameras:
        return result
    known = {c.name for c in result.checks}
    checks = list(result.checks)
    residuals = view_residuals(result, fitted_poses(result))
    for name, camera in result.cameras.items():
        mine = tuple(v for v in residuals if v.camera == name)
        check = structure_check(mine, image_size=camera.image_size)
        named = check if len(result.cameras) == 1 else replace(check, name=f"{check.name}-{name}")
        if named.name not in known and mine:
            checks.append(named)
    reviewed = replace(result, checks=tuple(checks), verdict=verdict_of(tuple(checks)))
    return with_coverage_checks(reviewed) if result.is_about_cameras else reviewed
