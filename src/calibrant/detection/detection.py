"""What a detector hands back for one image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Grey
from calibrant.targets.target import Target


@dataclass(frozen=True, eq=False)
class Detection:
    """The points of a target found in one image; none, and a reason in words, when it was not found.

    point_ids (n,) labels of the target's points; uv (n, 2) pixels; sigma_px (n,) standard deviation of each point per
    axis, or None where the method cannot say; notes: what a person should know, in whole sentences; looks_like: what
    kind of target the image shows in place of the one asked for, e.g. "9x6 inner corners"; another: whether that cannot
    be the target asked for, seen in part; covariance_px (n, 2, 2), px^2, where points are less certain along one
    direction: the picture moved while it was exposed; smeared: whether it moved further than that holds.
    """

    point_ids: NDArray[np.int64]
    uv: NDArray[np.float64]
    sigma_px: NDArray[np.float64] | None = None
    reason: str | None = None
    notes: tuple[str, ...] = ()
    looks_like: str | None = None
    another: bool = False
    covariance_px: NDArray[np.float64] | None = None
    smeared: bool = False

    @property
    def found(self) -> bool:
        """Whether any point was found."""
        return self.reason is None

    @classmethod
    def nothing(
        cls, reason: str, *, notes: tuple[str, ...] = (), looks_like: str | None = None, another: bool = False
    ) -> Detection:
        """No points, and why."""
        return cls(np.empty(0, np.int64), np.empty((0, 2)), None, reason, notes, looks_like, another)


def covariance_of(sigma_px: NDArray[np.float64], shape: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Covariances (n, 2, 2) px^2 of points of sigma_px (n,) and shape (n, 2, 2), their covariance over sigma_px^2; None
    where all are alike to all sides."""
    alike = np.array_equal(shape, np.broadcast_to(np.eye(2), shape.shape))
    return None if alike else sigma_px[:, None, None] ** 2 * shape


class Detector(Protocol):
    """Finds one kind of target. Registered in `detection/registry.py` under the target's kind."""

    def detect(self, grey: Grey, target: Target) -> Detection:
        """The target's points in a grey image (h, w)."""
        ...
