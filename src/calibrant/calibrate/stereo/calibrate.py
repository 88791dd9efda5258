"""Stereo: a rig of two cameras, by the one pipeline, and what is asked of a pair alone.

The fit is that of `calibrate.cell.rig`, digit for digit. Added are the pair as OpenCV has it, epipolar errors point by
point, the board's edges triangulated, what a point in front is known to, and checks: sides, pairs, epipolar errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.calibrate import CellFit, reviewed_cell
from calibrant.calibrate.cell.certainty.checks import BY_OTHERS
from calibrant.calibrate.cell.fitted import fitted_cameras
from calibrant.calibrate.cell.lens_choice import MODEL, FixForEach, ForEach
from calibrant.calibrate.cell.rig import asked_of_rig, fit_rig
from calibrant.calibrate.intrinsics.stopping import stopped, stopping
from calibrant.calibrate.stereo import checks as questions
from calibrant.calibrate.stereo.depth import point_certainty
from calibrant.calibrate.stereo.edges import triangulated_edges
from calibrant.calibrate.stereo.pairs import Seen, epipolar_errors, fundamental, seen_by_both, triangulated
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, JointCovariance, Measured, Observations, TransformEstimate, verdict_of
from calibrant.data.details import EpipolarErrors, StereoGeometry, TriangulatedEdges
from calibrant.data.details_stereo import Matrix, Row
from calibrant.data.verdicts import refuse_if_failed
from calibrant.errors import InputError
from calibrant.expected import expect
from calibrant.geometry import se3
from calibrant.geometry.projective import essential_from_transform


def calibrate_stereo(
    observations: Observations,
    *,
    cameras: Mapping[str, Camera] | None = None,
    initial: Mapping[str, Camera] | None = None,
    model: ForEach = MODEL,
    fix: FixForEach = (),
    same_focal: bool = False,
    max_iterations: int = 100,
    epsilon_px: float = 0.0,
) -> CalibrationResult:
    """Calibrate two cameras that are fixed to each other; the first of the observations is the left one.

    Arguments, fit and digits are those of `calibrate_rig`: cameras known (held within their covariance), guessed
    (initial) or free, each by its name; views of one `moment` were taken at once. same_focal: fx and fy are one
    unknown each for both cameras. max_iterations, epsilon_px: each solve stops after so many steps, unconverged, and
    when the next one would lower the RMS error by less; 0: at the least error. Returns a result of kind "stereo":
    T_left_right (coordinates of the right camera into the left one), `StereoGeometry` with OpenCV's R, t, E and F,
    `EpipolarErrors`, `TriangulatedEdges`; figures "baseline" (mm), "epipolar RMS" (px), "edge RMS"
    (mm) and "depth" (mm, of a point amid the boards, with the sigma that the calibration leaves in it).
    Raises: InputError for unusable input; RefusedError when the cameras share no moments or cannot be determined.

    Example::

        left = cb.View("left-0", points, uv_left, ids, "left", moment="0")
        right = cb.View("right-0", points, uv_right, ids, "right", moment="0")  # and so on: ten moments or more
        result = cb.calibrate_stereo(cb.Observations((left, right), {"left": (1280, 1024), "right": (1280, 1024)}))
        result.figures["baseline"]
    """
    expect(observations, Observations, "observations", "Observations of two cameras")
    names = tuple(observations.image_sizes)
    if len(names) != 2:
        raise InputError(
            f"stereo takes two cameras, the observations have {len(names)}: {', '.join(names)}; calibrate_rig takes "
            "any number"
        )
    stop = stopping(max_iterations, epsilon_px)
    fit = fit_rig(
        observations, cameras=cameras, initial=initial, model=model, fix=fix, same_focal=same_focal, stop=stop
    )
    asked = asked_of_rig(model, fix, initial) | ({"same_focal": True} if same_focal else {})
    free = None
    if same_focal and _bent(fit):
        free = fit_rig(observations, cameras=cameras, initial=initial, model=model, fix=fix, stop=stop)
    result = stereo_result(fit, reviewed_cell(fit, asked), None if free is None or _bent(free) else free)
    result = stopped(result, stop)
    refuse_if_failed(result)
    return result


def _bent(fit: CellFit) -> bool:
    """Whether a lens is elsewhere than its photos have it."""
    return any(shift.bent for shift in fit.certainty.lenses.values())


def stereo_result(fit: CellFit, rig: CalibrationResult, free: CellFit | None = None) -> CalibrationResult:
    """The result of a rig of two, as one of kind "stereo". free: the fit without one focal length for both, where that
    alone bends the lenses: then it is what is said."""
    left, right = fit.cell.layout.cameras
    T = rig.transform(left, right)
    eyes = rig.cameras[left], rig.cameras[right]
    of_left, of_right = (fit.cell.pixel_level(fit.noise.levels, c).sigma for c in (left, right))
    sigma = of_left, of_right
    pairs = seen_by_both(fit.cell.used_views(0), fit.cell.used_views(1))
    errors = epipolar_errors(pairs, *eyes, T.matrix, sigma_px=sigma)
    edges = triangulated_edges(pairs, *eyes, T.matrix)
    records = [_geometry(left, right, *eyes, T.matrix), errors, edges]
    asked = (
        questions.sides_check(left, right, T),
        questions.pairs_check(rig.observations, left, right, pairs),
        *questions.epipolar_checks(errors),
        *questions.same_focal_checks(
            {name: fit.cell.roles[name].camera for name in fit.cell.same_focal},
            None if free is None else fitted_cameras(free.cell, free.noise.solution),
        ),
    )
    of_rig = [c for c in rig.checks if free is None or not c.name.startswith(BY_OTHERS)]
    checks = (*of_rig, *asked)
    return replace(
        rig,
        kind="stereo",
        checks=checks,
        verdict=verdict_of(checks),
        figures={
            **rig.figures,
            **_figures(T, errors, edges),
            **_depth(pairs, eyes, T.matrix, rig.joint_covariance, sigma),
        },
        details=(*rig.details, *(r for r in records if r is not None)),
    )


def _geometry(left: str, right: str, a: Camera, b: Camera, T_left_right: Array) -> StereoGeometry:
    T = se3.inverse(T_left_right)
    E, F = essential_from_transform(T), fundamental(a, b, T_left_right)
    return StereoGeometry(left, right, _matrix(T[:3, :3]), _row(T[:3, 3]), _matrix(E), _matrix(F))


def _row(v: Array) -> Row:
    x, y, z = v.tolist()
    return x, y, z


def _matrix(M: Array) -> Matrix:
    return _row(M[0]), _row(M[1]), _row(M[2])


def _figures(
    T: TransformEstimate, errors: EpipolarErrors | None, edges: TriangulatedEdges | None
) -> dict[str, Measured]:
    """The figures that answer: how far apart, and how well the pair fits itself."""
    t = T.matrix[:3, 3]
    length = float(np.linalg.norm(t))
    sigma = np.nan
    if T.covariance is not None and length > 0:
        sigma = float(np.sqrt(t @ T.covariance[3:, 3:] @ t)) / length
    out = {"baseline": Measured(1e3 * length, 1e3 * sigma, "mm")}
    if errors is not None:
        out["epipolar RMS"] = Measured(errors.rms_px, unit="px")
    if edges is not None:
        out["edge RMS"] = Measured(edges.rms_mm, unit="mm")
    return out


def _depth(
    pairs: list[Seen],
    eyes: tuple[Camera, Camera],
    T_left_right: Array,
    joint: JointCovariance | None,
    sigma_px: tuple[float, float],
) -> dict[str, Measured]:
    """Depth of a point amid what was seen, with the sigma that the calibration leaves in it, and that of one match."""
    if not pairs or joint is None:
        return {}
    p = np.nanmedian([np.nanmedian(triangulated(pair, *eyes, T_left_right), axis=0) for pair in pairs], axis=0)
    T = np.stack([np.eye(4), T_left_right])
    found = point_certainty(eyes, T, p, covariance=joint.whole, sigma_px=sigma_px)
    by_all, by_match = (1e3 * float(np.sqrt(C[0, 2, 2])) for C in (found.calibration, found.matching))
    return {"depth": Measured(1e3 * float(p[2]), by_all, "mm"), "depth noise of a match": Measured(by_match, unit="mm")}
