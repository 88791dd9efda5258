"""A board that is longer one way, sized to the end: Gauss-Newton over lens, poses and stretch.

A stretch s multiplies the board's x by 1 + s. The scores at the fit are the first step, which finds 2 % to a twentieth
of it: more than its sigma, so that the cure offered were to be cured again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.calibrate.reprojection.factor import StackedViews
from calibrant.calibrate.review.view_scores import (
    POSE,
    STRETCH,
    Rows,
    ViewScores,
    estimate,
    kept_columns,
    rows_at,
    view_scores,
)
from calibrant.geometry import so3

MOST_STEPS, SETTLED = 12, 0.01
"""Steps, of which three are usual; a hundredth of its sigma is what none asks for."""


def settled_stretch(rows: Rows, scores: ViewScores, *, beside: Sequence[str] = ()) -> tuple[float, float] | None:
    """The stretch and its 1 sigma, from what the views scatter; None where it does not settle.

    Args: rows and scores, at the fit; beside, other faults that are real.
    """
    total = 0.0
    for _ in range(MOST_STEPS):
        columns, own = kept_columns(scores, *beside, STRETCH)
        found = estimate(scores, columns, leave_out=True)
        if found is None or found.moved is None:
            return None
        at, n = int(own[-1]), len(scores)
        step = float(found.value[at])
        scatter = (n - 1) / n * float(np.sum(found.moved[:, at] ** 2))
        sigma = float(np.sqrt(max(scatter, found.covariance[at, at])))  # no less than independent points make
        total = (1 + total) * (1 + step) - 1
        if abs(step) <= SETTLED * sigma:
            return total, sigma * (1 + total)
        rows = _stepped(rows, scores, columns, found.value, stretch=step)
        again = view_scores(rows)
        if again is None or abs(total) > 0.5:
            return None
        scores = again
    return None


def _stepped(rows: Rows, scores: ViewScores, columns: Indices, value: Array, *, stretch: float) -> Rows:
    """The rows after a step of the lens, of the stretch and of the poses that go with all columns' step."""
    X, k = scores.X, len(scores.lens)
    left = X[-1] + np.tensordot(value, X[POSE + columns], axes=1)
    T = rows.T_camera_target.copy()
    for i, (a, b) in enumerate(pairwise(rows.stacked.offsets.tolist())):
        x = -np.linalg.lstsq(X[:POSE, :, a:b].reshape(POSE, -1).T, left[:, a:b].ravel(), rcond=None)[0]
        T[i, :3, :3] = so3.exp(x[:3]) @ T[i, :3, :3]
        T[i, :3, 3] += x[3:]
    values = np.array(rows.camera.values)
    values[scores.parameter_indices] += value[:k]
    points = rows.stacked.points.copy()
    middle = points[:, 0].mean()
    points[:, 0] = middle + (1 + stretch) * (points[:, 0] - middle)
    stacked = StackedViews(points, rows.stacked.uv, rows.stacked.sigma, rows.stacked.offsets)
    camera = replace(rows.camera, values=values)
    return rows_at(camera, rows.views, stacked, T, max_error_px=rows.max_error_px)
