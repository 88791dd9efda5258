"""A fit with the target's shape in it, resting on the points that fit that shape, not on those that fit a plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibrant.calibrate.intrinsics.fit import Fit, Start, fit_and_clean
from calibrant.calibrate.intrinsics.target_shape import Flat, shape_of
from calibrant.calibrate.reprojection.factor import stack
from calibrant.calibrate.reprojection.outliers import Marked
from calibrant.calibrate.review.target_points import points_on
from calibrant.cameras import CameraModel
from calibrant.data import View
from calibrant.data.details import BentTarget, FreeTarget


def shaped_fit(
    views: Sequence[View],
    start: Start,
    flat: Fit,
    marked: Marked,
    kind: CameraModel,
    fix: Sequence[str],
    max_error_px: float | None,
    *,
    shape: str,
) -> tuple[Fit, Marked, BentTarget | FreeTarget]:
    """The flat fit with the target's shape free: points that a plane left out are judged again on the shape found.

    Args: views, all there are, and where their poses start; flat and marked, the fit of a plane and what it left out.
    """
    shaped = shape_of(shape)(Flat(flat.solution, flat.views, flat.stacked, kind))
    if not marked.keep.all():
        moved = tuple(replace(v, points=p) for v, p in zip(views, points_on(shaped.shape, views), strict=True))
        begin = Start(shaped.solution.value("camera")[0], start.T_camera_target)
        again, marked = fit_and_clean(moved, stack(moved), begin, kind, fix, max_error_px)
        nominal = {v.id: v for v in views}
        kept = tuple(_on_nominal(v, nominal[v.id]) for v in again.views)
        stacked = replace(again.stacked, points=np.concatenate([v.points for v in kept]))
        flat = replace(again, views=kept, stacked=stacked, checks=flat.checks)
        shaped = shape_of(shape)(Flat(flat.solution, kept, stacked, kind))
    fit = replace(
        flat,
        solution=shaped.solution,
        T_camera_target=shaped.T_camera_target,
        gauge_equations=shaped.gauge_equations,
    )
    return fit, marked, shaped.shape


def _on_nominal(kept: View, nominal: View) -> View:
    """A view's kept points, with their places on the target as it was given."""
    place = {int(point): row for row, point in enumerate(nominal.point_ids)}
    return replace(kept, points=nominal.points[[place[int(point)] for point in kept.point_ids]])
