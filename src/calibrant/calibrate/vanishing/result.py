"""The rotation against a scene as a result of kind "vanishing": transform, checks and verdict in words."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.vanishing.manhattan import AXES, Manhattan, vanishing_point
from calibrant.calibrate.vanishing.orthogonality import RightAngle
from calibrant.cameras import Camera
from calibrant.data import DEFAULT_CAMERA, CalibrationResult, Check, as_transform, verdict_of
from calibrant.data.verdicts import stamp
from calibrant.geometry import se3

WORDS = ("right", "down", "ahead")
NOT_RIGHT_SIGMAS = 4.0
"""Three angles at 4 sigma: chance shows one in 5000 pictures."""
FOCAL_WARN = 0.05
"""5 % of the focal length are 5 % of every distance and 2 degrees at the edge of an ordinary picture."""
EXCESS_WARN_PX = 0.5
"""An edge that is off its direction by more is no noise: the walls, or the camera model, are not what they are said."""


def vanishing_result(found: Manhattan) -> CalibrationResult:
    """A rotation as a result: camera -> scene, its position being the camera's own by definition.

    The covariance holds the rotation's; the position is exact. cameras: the camera, where the focal length was unknown
    with the one found and its sigma.
    """
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = found.covariance
    checks = (
        *_directions(found),
        *_angle_checks(found),
        _edges(found),
        _focal_check(found),
        _camera_check(found),
    )
    return stamp(
        CalibrationResult(
            kind="vanishing",
            verdict=verdict_of(checks),
            checks=checks,
            cameras={DEFAULT_CAMERA: found.camera},
            transforms=(
                as_transform(DEFAULT_CAMERA, "scene", se3.make(found.R_camera_scene, np.zeros(3)), covariance),
            ),
            sigma_px=found.sigma_px,
            options={"focal": "known" if found.sigma_focal is None else "unknown"},
        )
    )


def _directions(found: Manhattan) -> tuple[Check, ...]:
    out = []
    for k, axis in enumerate(AXES):
        count = int(np.sum(found.member == k))
        where = _vanishing(found.camera, found.R_camera_scene[:, k])
        text = f"{axis} ({WORDS[k]}): {count} edges, {where}"
        if not found.supported[k]:
            text += "; too few to say that the scene has this direction: it is at right angles to the other two"
        out.append(Check(f"direction-{axis}", "ok", text, float(count)))
    return tuple(out)


def _vanishing(camera: Camera, direction: Array) -> str:
    uv = vanishing_point(camera, direction)
    far = np.rad2deg(np.arcsin(min(abs(float(direction[2])), 1.0)))
    if uv is None or np.abs(uv).max() > 1e5:
        return f"which meet out of sight, {far:.2f} deg off the image plane"
    return f"which meet at ({uv[0]:.1f}, {uv[1]:.1f}) px"


def _angle_checks(found: Manhattan) -> tuple[Check, ...]:
    if not found.angles:
        return (Check("orthogonality", "ok", "too few edges to test whether the directions are at right angles"),)
    return tuple(_angle(a) for a in found.angles)


def _angle(a: RightAngle) -> Check:
    name, pair = f"orthogonality-{AXES[a.a]}{AXES[a.b]}", f"{AXES[a.a]} and {AXES[a.b]}"
    text = f"{pair} by themselves are at {90 + a.off_deg:.3f} ± {a.sigma_deg:.2g} deg"
    if abs(a.off_deg) > NOT_RIGHT_SIGMAS * a.sigma_deg:
        return Check(
            name, "warn",
            f"{text}, not at right angles: the scene's directions are not orthogonal, or the camera's focal length or "
            "distortion is wrong", a.off_deg,
        )  # fmt: skip
    return Check(name, "ok", text, a.off_deg)


def _edges(found: Manhattan) -> Check:
    used = int(np.sum(found.member >= 0))
    text = (
        f"{used} of {len(found.member)} straight edges follow the three directions; noise {found.sigma_px:.2g} px "
        f"across an edge, and {found.excess_px:.2g} px that all of an edge has in common"
    )
    if found.sigma_px > EXCESS_WARN_PX:
        text += ": more than a sharp edge's; the picture is blurred, or the camera's distortion is not as given"
        return Check("edges", "warn", text, float(used))
    if found.excess_px > EXCESS_WARN_PX:
        text += ": the walls are not straight or parallel, or the camera's distortion is not as given"
        return Check("edges", "warn", text, float(used))
    return Check("edges", "ok", text, float(used))


def _focal_check(found: Manhattan) -> Check:
    if found.sigma_focal is None:
        return Check("focal-length", "ok", "taken from the camera")
    f = found.camera.parameters["fx"]
    text = (
        f"{f:.1f} ± {found.sigma_focal * f:.2g} px from the vanishing points, with the principal point taken at "
        f"({found.camera.parameters['cx']:.1f}, {found.camera.parameters['cy']:.1f}) px and no distortion; an error of "
        "these is not in the sigma"
    )
    if found.sigma_focal > FOCAL_WARN:
        return Check("focal-length", "warn", f"{text}. It is known to {100 * found.sigma_focal:.0f} % only", f)
    return Check("focal-length", "ok", text, f)


def _camera_check(found: Manhattan) -> Check:
    if found.sigma_focal is not None:
        return Check("camera", "ok", "its uncertainty is that of the focal length")
    if found.of_camera is None:
        text = "the camera file states no uncertainty: sigmas are of the edges' noise alone"
        return Check("camera", "warn", text)
    share = float(np.trace(found.of_camera) / np.trace(found.covariance))
    return Check("camera", "ok", f"the camera's own uncertainty makes {100 * share:.0f} % of the variance", share)
