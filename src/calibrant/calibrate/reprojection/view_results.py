"""A view in a result: how well a fit explains it, or why it was left out; one form for every problem."""

from __future__ import annotations

from math import sqrt

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.reprojection.outliers import points_reason
from calibrant.data import View, ViewResult


def fitted_view(
    view: View,
    squares: Array,
    T_camera_target: Array,
    *,
    total: int,
    limit_px: float,
    remark: str | None = None,
) -> ViewResult:
    """A view that a fit used.

    Args: view, with the n points used; squares (n,), squared norms of their residuals, px^2; T_camera_target (4, 4) of
    the fit; total, how many points the view had; remark, what is to be known of it in any case; limit_px, the residual
    above which points were left out.
    """
    lost = total - len(squares)
    if remark is None and lost:
        remark = points_reason(lost, total, limit_px)
    # By the reductions themselves: the methods around them take longer than the numbers of a view.
    sizes = (np.add.reduce(squares) / len(squares), np.minimum.reduce(squares), np.maximum.reduce(squares))
    rms, least, most = (sqrt(size) for size in sizes)
    return ViewResult(view.id, True, len(squares), rms, remark, view.camera, lost, T_camera_target, least, most)


def unused_view(view: View, reason: str | None, T_camera_target: Array | None = None) -> ViewResult:
    """A view that was left out, and where its target would be, where that is known."""
    return ViewResult(view.id, False, len(view), None, reason, view.camera, 0, T_camera_target)
