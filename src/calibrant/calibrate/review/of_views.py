"""What the views say together of lens, board and shutter: the checks that rest on `view_scores`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.review.board_shape import ask_board
from calibrant.calibrate.review.one_camera import OneCamera, one_camera
from calibrant.calibrate.review.residuals import Structure, own_poses
from calibrant.calibrate.review.shutter import shutter_checks
from calibrant.calibrate.review.view_scores import ViewScores, as_photos_make_it, rows_of, view_scores
from calibrant.data import CalibrationResult, Check, verdict_of
from calibrant.data.details import BentTarget, FreeTarget


def with_view_checks(
    result: CalibrationResult, poses: Mapping[tuple[str, str], Array], structures: Mapping[str, Structure]
) -> CalibrationResult:
    """The result with the checks of its views' scores that it does not have yet, each camera's lens by itself.

    Args: poses, T_camera_target by (camera, view id), of the calibration. Where a robot or another camera had a say in
    them, each view's pose is fitted to its points alone. structures, of the residuals by camera.
    """
    known = {c.name for c in result.checks}
    alone = len(result.cameras) == 1
    cameras, new = dict(result.cameras), list[Check]()
    own = poses if _by_themselves(result) else None
    for name in result.cameras:
        if _carried(result, name):
            continue
        if own is None:
            own = own_poses(result, poses)
        checks, held = _asked(result, name, own, structures.get(name))
        asked = [c if alone else replace(c, name=f"{c.name}-{name}") for c in checks]
        asked = [c for c in asked if c.name not in known]
        new += asked
        if held is not None and asked:
            known_covariance = cameras[name].covariance
            more = held if known_covariance is None else known_covariance + held
            cameras[name] = replace(cameras[name], covariance=more)
    checks = (*result.checks, *new)
    return replace(result, checks=checks, cameras=cameras, verdict=verdict_of(checks))


def _carried(result: CalibrationResult, name: str) -> bool:
    """Whether the views of a camera are another's, carried: they hold its errors and say nothing by themselves."""
    views = result.observations.views if result.observations is not None else ()
    mine = [v for v in views if v.camera == name]
    return bool(mine) and all(v.carried is not None for v in mine)


def _asked(
    result: CalibrationResult, name: str, poses: Mapping[tuple[str, str], Array], structure: Structure | None
) -> tuple[tuple[Check, ...], Array | None]:
    """What the views of one camera answer, and what its covariance (k, k) must hold beside what it has: the difference
    of groups, and what each fault that is real and was not cured does to the lens. Nothing where its lens was given."""
    rows = rows_of(result, name, poses)
    scores = None if rows is None else view_scores(rows)
    if rows is None or scores is None:
        return (), None
    if not _by_themselves(result):
        scores = as_photos_make_it(scores)
    names = [v.file or v.id for v in rows.views]
    found = one_camera(scores, names)
    if structure is not None and structure.lens_too_simple:
        return (found.check,), found.between
    target = result.observations.target if result.observations is not None else None
    shaped = any(result.detail(kind) is not None for kind in (BentTarget, FreeTarget))
    door = "--target-shape" if result.is_about_cameras else "calibrant intrinsics --target-shape"
    asked = ask_board(rows, scores, target=target, shaped=shaped, door=door)
    checks = (found.check, *asked.checks)
    if asked.found is not None and found.check.status == "ok":
        checks += shutter_checks(scores, asked.found, names)
    return checks, _held(scores, found, asked.moved)


def _by_themselves(result: CalibrationResult) -> bool:
    """Whether nothing but its own points said where each view's target is: neither a robot nor another camera."""
    return result.is_about_cameras and len(result.cameras) == 1


def _held(scores: ViewScores, found: OneCamera, moved: Sequence[Array]) -> Array | None:
    """Covariance (k, k) of faults that stay in the lens, each with its shift as one sigma."""
    if found.between is None and not moved:
        return None
    size, at = len(scores.camera.values), scores.parameter_indices
    held = np.zeros((size, size)) if found.between is None else found.between.copy()
    for shift in moved:
        held[np.ix_(at, at)] += np.outer(shift, shift)
    return held
