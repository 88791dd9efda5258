"""What a person is told of motions: pixels over a readout, view by view, with sigma, and what is not determined."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.intrinsics.rolling_factor import CAMERA, MOTION, POSES
from calibrant.calibrate.intrinsics.rolling_fit import ROLLING, Moving
from calibrant.cameras import CameraModel
from calibrant.data import CalibrationResult, Check, verdict_of
from calibrant.data.details import RollingShutter, ViewMotion
from calibrant.geometry import se3

CHECK = "rolling-shutter"
STILL = 5.991
"""95 % of chi-square with 2 degrees of freedom: a motion below it may as well be none."""
ONE_WAY = 18.42
"""Chance of 1 in 10,000 by chi-square with 2 degrees of freedom: views that move about rest do not agree so far."""
_NAMED = 3


def with_motions(result: CalibrationResult, moving: Moving, kind: CameraModel, *, height: int) -> CalibrationResult:
    """The result with its motions: what was asked for, the record, and the check. Args: height, rows of an image."""
    found = motions_of(moving, kind, height=height, sigma_px=result.sigma_px or 0.0)
    checks = (*result.checks, motions_check(found, moving))
    options = {**result.options, "shutter": ROLLING}
    return replace(result, options=options, checks=checks, verdict=verdict_of(checks)).with_detail(found)


def motions_of(moving: Moving, kind: CameraModel, *, height: int, sigma_px: float) -> RollingShutter:
    """The motions as a record. Args: height, rows; sigma_px, the corners' noise an axis, px."""
    T, x, C = _solved(moving, sigma_px)
    J = (
        kind.project_with_jacobians(moving.fit.solution.value(CAMERA)[0], se3.apply(T, moving.centres))[1]
        @ T[:, :3, :3]
    )
    px = np.einsum("mij,mj->mi", J, x[:, 3:])
    spread = np.sqrt(np.einsum("mij,mjk,mik->mi", J, C[:, 3:, 3:], J))
    views = {
        view.id: ViewMotion(_pair(p), _pair(s), _triple(m[:3]), _triple(m[3:]), _triple(c))
        for view, p, s, m, c in zip(moving.fit.views, px, spread, x, moving.centres)
    }
    # Along two axes, of which the level is one.
    size, deviation = np.sqrt(2) * moving.motion.sigma, np.sqrt(2) * moving.motion.deviation
    return RollingShutter(height, float(size), float(deviation), views)


def motions_check(found: RollingShutter, moving: Moving) -> Check:
    """How far views move, which stand still, which are not determined, and whether all move one way."""
    level = found.typical_px
    if moving.motion.at_floor or not moving.motion.determined:
        return Check(CHECK, "ok", "no view is seen to move while it is read", 0.0)
    px, sigma = (np.array([getattr(v, name) for v in found.views.values()]) for name in ("px", "sigma_px"))
    text = f"views move by {level:.2g} ± {found.typical_sigma_px:.1g} px over a readout (rms), which every sigma holds"
    still = int(np.sum(np.sum((px / sigma) ** 2, axis=1) < STILL))
    if still:
        text += f"; {still} of {len(px)} stand still within their sigma"
    unknown = [name for name, s in zip(found.views, sigma) if np.sum(s**2) > 0.5 * level**2]
    if unknown:
        more = f" and {len(unknown) - _NAMED} more" if len(unknown) > _NAMED else ""
        text += f"; not determined, and taken to be like the others': {', '.join(unknown[:_NAMED])}{more}"
    mean = px.mean(axis=0)
    if len(px) * np.sum(mean**2) / (0.5 * level**2) > ONE_WAY:
        text += (
            f". They move one way, by {mean[0]:.2g}, {mean[1]:.2g} px on average, which a lens that is stretched or "
            "askew does too, and no sigma holds: --fix aspect, or photos at rest"
        )
        return Check(CHECK, "warn", text, level)
    return Check(CHECK, "ok", text, level)


def _solved(moving: Moving, sigma_px: float) -> tuple[Array, Array, Array]:
    """Poses (m, 4, 4), motions (m, 6) and their covariances (m, 6, 6)."""
    solution = moving.fit.solution
    return solution.value(POSES), solution.value(MOTION), solution.covariances(MOTION) * sigma_px**2


def _pair(x: Array) -> tuple[float, float]:
    return float(x[0]), float(x[1])


def _triple(x: Array) -> tuple[float, float, float]:
    return float(x[0]), float(x[1]), float(x[2])
