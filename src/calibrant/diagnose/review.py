"""The questions that a finished calibration is asked before a person sees it: coverage, structure of the residuals."""

from __future__ import annotations

from dataclasses import replace

from calibrant.data import CalibrationResult, verdict_of


def review(result: CalibrationResult) -> CalibrationResult:
    """The result with the checks that its observations answer; a warning turns the verdict "ok" to "warn"."""
    if result.observations is None or not result.cameras:
        return result
    from calibrant.diagnose.coverage import with_coverage_checks
    from calibrant.diagnose.residuals import fitted_poses, structure_check, view_residuals

    known = {c.name for c in result.checks}
    checks = list(result.checks)
    residuals = view_residuals(result, fitted_poses(result))
    for name, camera in result.cameras.items():
        mine = tuple(v for v in residuals if v.camera == name)
        check = structure_check(mine, image_size=camera.image_size)
        if check.name not in known and mine:
            checks.append(check if len(result.cameras) == 1 else replace(check, name=f"{check.name}-{name}"))
    reviewed = replace(result, checks=tuple(checks), verdict=verdict_of(tuple(checks)))
    return with_coverage_checks(reviewed) if is_about_cameras(result) else reviewed


def is_about_cameras(result: CalibrationResult) -> bool:
    """Whether the images were taken to find a camera: then their coverage is judged. What places something is about
    that, and often with a camera that was given."""
    return bool(result.cameras) and not result.transforms
