"""Outliers in two steps: the first run marks points with a large error and uses them, the next leaves them out."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult, Observations, ViewResult


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
    keys = [mark_key(v.id, v.camera, found.image_sizes) for v in found.views]
    strange = sorted(set(marks.points) - set(keys))
    if strange:
        raise InputError(f"{file} has marked points in {strange[0]}, which is not among the photos")
    return replace(
        found,
        views=tuple(
            v.subset(~np.isin(v.point_ids, marks.points[key])) if key in marks.points else v
            for v, key in zip(found.views, keys)
        ),
    )


def mark_key(view: str, camera: str, cameras: Collection[str]) -> str:
    """What marks call a view: its id, with its camera's name in front where there are several."""
    return view if len(cameras) == 1 else f"{camera}/{view}"


def with_pair_marks(
    result: CalibrationResult, limits_px: Mapping[str, float], *, epipolar_px: float | None = None
) -> CalibrationResult:
    """The result of a stereo pair with points marked: of a camera above its own limit, and in both images those further
    than `epipolar_px` from the line of their partner in either; nothing else changes."""
    import numpy as np

    from calibrant.data import Check
    from calibrant.data.details import EpipolarErrors, MarkedPoints

    seen = {} if result.observations is None else {(v.camera, v.id): v for v in result.observations.views}
    marked: dict[tuple[str, str], set[int]] = {}
    for row in result.views:
        camera = result.camera_of(row)
        view, T, limit = seen.get((camera, row.id)), row.T_camera_target, limits_px.get(camera)
        if view is None or T is None or not row.used or limit is None:
            continue
        errors = np.linalg.norm(view.residuals(result.cameras[camera], T), axis=1)
        marked.setdefault((camera, row.id), set()).update(view.point_ids[errors > limit].tolist())
    errors_of_pairs, (left, right) = result.detail(EpipolarErrors), tuple(result.cameras)
    if epipolar_px is not None and errors_of_pairs is not None:
        for pair in errors_of_pairs.pairs.values():
            worst = np.maximum(pair.left_px, pair.right_px)
            ids = np.array(pair.point_ids)[worst > epipolar_px].tolist()
            for key in ((left, pair.left), (right, pair.right)):
                marked.setdefault(key, set()).update(ids)
    marked = {key: ids for key, ids in marked.items() if ids}
    views = tuple(_remarked(v, len(marked.get((result.camera_of(v), v.id), ()))) for v in result.views)
    limits = {**limits_px, **({} if epipolar_px is None else {"epipolar": epipolar_px})}
    above = ", ".join(f"{name} {limit:g} px" for name, limit in limits.items())
    count = sum(map(len, marked.values()))
    text = f"{count} points, in {len(marked)} views, have an error above the limits ({above}): marked"
    check = Check("marked-points", "ok", f"{text}; without_marked of the next run leaves them out", float(count))
    points = {mark_key(i, c, result.cameras): tuple(sorted(ids)) for (c, i), ids in marked.items()}
    options = {**result.options, "mark_outliers_px": limits}
    done = replace(result, views=views, checks=(*result.checks, check), options=options)
    return done.with_detail(MarkedPoints(min(limits.values()), points, limits))


def _remarked(row: ViewResult, count: int) -> ViewResult:
    if not count:
        return row
    words = f"{count} of {row.points} points above a limit marked"
    return replace(row, reason=f"{row.reason}; {words}" if row.reason else words)
