"""Stale intrinsics: the camera that was given against the one that the same images give.

With the camera held and with it free, the residuals of the same views: F test on the squares. A wrong camera may hide
in the poses of the views, which take up most of a wrong focal length; the robot, which they must agree with, tells.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from calibrant.cameras import Camera
from calibrant.data import Measured, View
from calibrant.diagnose.doctor.evidence.case import Case
from calibrant.diagnose.doctor.evidence.finding import Finding
from calibrant.diagnose.doctor.evidence.loop import Evidence
from calibrant.diagnose.doctor.evidence.significance import CONVINCING, confidence, nested_test, ratio_test
from calibrant.diagnose.doctor.faults import size
from calibrant.errors import InputError, RefusedError

LEAST_VIEWS = 5
"""Fewer views hardly calibrate a camera: their word against the given one counts for nothing."""
MATTERS = 1.2
"""Residuals a fifth larger than they need be: less is what a board that is not flat or a simpler model cost, unless the
robot agrees better with the camera found."""

BETTER = 1.5
"""By how much the robot must agree better: any camera is off by some of its sigmas when it is used again."""


def examine(case: Case) -> list[Finding]:
    """Do the images fit the camera that was given?"""
    if not case.camera_given or case.camera is None or case.observations is None or len(case.index) < LEAST_VIEWS:
        return []
    from calibrant.calibrate.intrinsics.one_model import calibrate_keeping

    views = [v for v, use in zip(case.data.views or (), case.data.use) if use]
    model = "brown" if case.camera.model.name == "pinhole" else case.camera.model.name
    try:
        fresh = calibrate_keeping(replace(case.observations, views=tuple(views)), model=model).result.camera
        return _compared_cameras(case, views, case.camera, fresh)
    except (RefusedError, InputError):
        return []  # images that cannot calibrate a camera say nothing against the given one


def _compared_cameras(case: Case, views: list[View], given: Camera, fresh: Camera) -> list[Finding]:
    from calibrant.calibrate.pose.target_poses import target_poses

    repaired = _with_camera(case, fresh)
    points = np.array([len(v) for v in views])
    before, after = (float(np.sum(points * target_poses(c, views).rms_px ** 2)) for c in (given, fresh))
    unknowns = len(fresh.model.parameter_names)
    p = nested_test(before, after, unknowns, int(2 * points.sum()) - 6 * len(views) - unknowns)
    ratio = float(np.sqrt(before / max(after, 1e-30)))
    if p > CONVINCING or (ratio < MATTERS and not _robot_prefers(repaired, case)):
        return []
    total = points.sum()
    evidence = Evidence(case.loop, repaired.loop)
    message = (
        f"the camera given does not fit the images: it leaves {np.sqrt(before / total):.3g} px rms, a camera "
        f"calibrated from them {np.sqrt(after / total):.3g} px ({_differences(given, fresh)}); "
        f"with that {evidence.text}"
    )
    return [
        Finding(
            "stale-intrinsics",
            "warn",
            message,
            confidence(p),
            evidence,
            measured=Measured(ratio, 0.0),
            proposal="calibrate the camera again, or leave --camera out",
            repair=partial(_with_camera, camera=fresh),
            gain=float(total) * np.log(ratio),
        )
    ]


def _robot_prefers(repaired: Case, case: Case) -> bool:
    """True when with the camera found the loop is narrower, or the target has the size given and had not before."""
    before, after = case.typical, repaired.typical
    narrower = before > BETTER**2 * after and ratio_test(before, after, 3 * len(case.index) - 6) <= CONVINCING
    return narrower or (bool(size.examine(case)) and not size.examine(repaired))


def _with_camera(case: Case, camera: Camera) -> Case:
    """The views as another camera sees them; the camera is then refined from the same images."""
    return replace(case, data=case.data.seen_by(camera), camera=camera, camera_given=False)


def _differences(given: Camera, fresh: Camera) -> str:
    """The focal length and principal point in both."""
    names = [n for n in ("fx", "cx", "cy") if n in given.parameters and n in fresh.parameters]
    return ", ".join(
        f"{n} {given.parameters[n]:.1f} px given, {fresh.parameters[n]:.1f} ± {fresh.sigma.get(n, 0.0):.1g} px found"
        for n in names
    )
