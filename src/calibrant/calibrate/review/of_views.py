"""What the views say together of lens, board and shutter: the checks that rest on `view_scores`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from calibrant.arrays import Array
from calibrant.calibrate.review.one_camera import NAME, one_camera, with_spread
from calibrant.calibrate.review.residuals import seen_poses
from calibrant.calibrate.review.view_scores import rows_of, view_scores
from calibrant.data import CalibrationResult, Check, verdict_of


def with_view_checks(result: CalibrationResult, poses: Mapping[tuple[str, str], Array]) -> CalibrationResult:
    """The result with the checks of its views' scores that it does not have yet, each camera's lens by itself.

    Args: poses, T_camera_target by (camera, view id), of the calibration. Where a robot had a say in them, each view's
    pose is fitted to its points alone.
    """
    known = {c.name for c in result.checks}
    alone = len(result.cameras) == 1
    cameras, new = dict(result.cameras), list[Check]()
    own = poses if result.is_about_cameras else None
    for name in result.cameras:
        label = NAME if alone else f"{NAME}-{name}"
        if label in known:
            continue
        own = seen_poses(result) if own is None else own
        rows = rows_of(result, name, own)
        scores = None if rows is None else view_scores(rows)
        if rows is None or scores is None:
            continue
        found = one_camera(scores, [v.file or v.id for v in rows.views])
        new.append(replace(found.check, name=label))
        if found.between is not None:
            cameras[name] = with_spread(cameras[name], found.between)
    checks = (*result.checks, *new)
    return replace(result, checks=checks, cameras=cameras, verdict=verdict_of(checks))
