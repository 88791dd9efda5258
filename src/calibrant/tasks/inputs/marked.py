"""Outliers in two steps: the first run marks points with a large error and uses them, the next leaves them out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Observations


def with_marks(result: CalibrationResult, limit_px: float) -> CalibrationResult:
    """The result of one camera with the points marked whose error is above the limit; nothing else changes."""
    import numpy as np

    from calibrant.data import Check
    from calibrant.data.details import MarkedPoints

    seen = {v.id: v for v in result.observations.views} if result.observations is not None else {}
    marked: dict[str, tuple[int, ...]] = {}
    total = 0
    views = []
    for row in result.views:
        view, T = seen.get(row.id), row.T_camera_target
        if view is None or T is None or not row.used:
            views.append(row)
            continue
        errors = np.linalg.norm(view.residuals(result.camera, T), axis=1)
        total += len(errors)
        ids = tuple(int(i) for i in view.point_ids[errors > limit_px])
        if ids:
            marked[row.id] = ids
            words = f"{len(ids)} of {len(errors)} points above {limit_px:g} px marked"
            row = replace(row, reason=f"{row.reason}; {words}" if row.reason else words)
        views.append(row)
    count = sum(map(len, marked.values()))
    text = f"{count} of {total} points, in {len(marked)} views, have an error above {limit_px:g} px: marked"
    check = Check("marked-points", "ok", f"{text}; without_marked of the next run leaves them out", float(count))
    options = {**result.options, "mark_outliers_px": limit_px}
    done = replace(result, views=tuple(views), checks=(*result.checks, check), options=options)
    return done.with_detail(MarkedPoints(limit_px, marked))


def without_marked(found: Observations, file: Path) -> Observations:
    """The observations without the points that a result file has marked. Raises: InputError for a file without marks,
    or with marks in views that are not there."""
    import numpy as np

    from calibrant.data.details import MarkedPoints
    from calibrant.data.result_file import read_result

    marks = read_result(file).detail(MarkedPoints)
    if marks is None:
        raise InputError(f"{file} has no marked points; a run with --mark-outliers PX and --out writes them")
    strange = sorted(set(marks.points) - {v.id for v in found.views})
    if strange:
        raise InputError(f"{file} has marked points in {strange[0]}, which is not among the photos")
    return replace(
        found,
        views=tuple(
            v.subset(~np.isin(v.point_ids, marks.points[v.id])) if v.id in marks.points else v for v in found.views
        ),
    )
