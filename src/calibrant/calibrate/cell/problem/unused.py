"""Views that no robot pose or moment belongs to: they still say something of the lens that took them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibrant.calibrate.cell.problem.camera_role import CameraRole
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.calibrate.reprojection.outliers import MINIMUM_POINTS


def with_unused(role: CameraRole, lists: Sequence[HandEyeViews]) -> CameraRole:
    """A camera that its own photos determine: those without a use for the robot still count for it."""
    extra = [
        (v, T)
        for data in lists
        for v, T, use in zip(data.views or (), data.B, data.use)
        if not use and len(v) >= MINIMUM_POINTS and not np.allclose(T, np.eye(4))
    ]
    poses = np.array([T for _, T in extra]).reshape(-1, 4, 4)
    return replace(role, extra=tuple(v for v, _ in extra), extra_poses=poses)
