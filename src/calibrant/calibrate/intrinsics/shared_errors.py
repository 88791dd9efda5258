"""What points of a calibration share, a view, a board point, a place in the image, and what it does to sigma.

Blur, a bent or badly printed board, and what a lens model cannot express move neighbouring points alike. A covariance
that takes points as independent is then 2 to 6 times too small (`optimize.clusters` has the equations).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.reprojection.factor import StackedViews
from calibrant.calibrate.review.residuals import places
from calibrant.cameras import CameraModel
from calibrant.data import Check, View
from calibrant.data.details import SharedErrors
from calibrant.optimize.clusters import cluster_scores, clustered_covariance, influence, numbered, square_root
from calibrant.optimize.solution import Solution

ROUNDING_PX = 1e-7
"""Residuals below are the rounding of exact data, which is not noise: nothing can be learnt from how it is shared."""
SAID = 1.2
"""Sigma grows by chance to about this on data without shared errors; from here on it is said."""


def shared_errors(
    solution: Solution,
    kind: CameraModel,
    views: Sequence[View],
    stacked: StackedViews,
    *,
    image_size: tuple[int, int],
    sigma_px: float,
) -> tuple[Array, SharedErrors]:
    """The camera's covariance (k, k) with what points share, and how much that is.

    Args: views and stacked, those that the solution was fitted to; sigma_px, the noise per axis that it left.
    """
    independent = solution.covariance("camera") * sigma_px**2
    if sigma_px < ROUNDING_PX or not np.any(independent):
        return independent, SharedErrors(1.0, 1.0, 1.0, 1.0, _sigma_of(kind, independent))
    root, inverse = square_root(independent)
    rows, residuals = influence(solution, "reprojection", "camera", onto=inverse * sigma_px)
    clusterings = [
        cluster_scores(rows, residuals / sigma_px, labels, root=root, at=stacked.uv)
        for labels in (
            np.repeat(np.arange(len(views)), np.diff(stacked.offsets)),
            numbered(np.concatenate([v.point_ids for v in views])),
            numbered(places(stacked.uv, image_size)),
        )
    ]
    shares = [float(np.trace(c.shared)) / root.shape[1] for c in clusterings]
    by_view, by_point, by_place = (float(np.sqrt(1 + share)) for share in shares)
    return clustered_covariance(independent, clusterings), SharedErrors(
        float(np.sqrt(1 + sum(shares))), by_view, by_point, by_place, _sigma_of(kind, independent)
    )


def shared_errors_check(shared: SharedErrors) -> Check:
    """What a person is told of it; sigma holds it, so that nothing is to be done."""
    if shared.times < SAID:
        return Check("shared-errors", "ok", "points err independently of each other, as far as they show", shared.times)
    _, which = max(
        (shared.by_view, "the points of a view"),
        (shared.by_point, "all views of a point of the board"),
        (shared.by_place, "the points at one place of the image"),
    )
    message = (
        f"{which} err alike: every sigma holds it and is {shared.times:.1f} times what independent points would have"
    )
    return Check("shared-errors", "ok", message, shared.times)


def _sigma_of(kind: CameraModel, covariance: Array) -> dict[str, float]:
    return dict(zip(kind.parameter_names, np.sqrt(np.diag(covariance)).tolist()))
