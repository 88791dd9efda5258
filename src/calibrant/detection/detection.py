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
    be the target asked for, seen in part.
    """

    point_ids: NDArray[np.int64]
    uv: NDArray[np.float64]
    sigma_px: NDArray[np.float64] | None = None
    reason: str | None = None
    notes: tuple[str, ...] = ()
    looks_like: str | None = None
    another: bool = False

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


class Detector(Protocol):
    """Finds one kind of target. Registered in `detection/registry.py` under the target's kind."""

    def detect(self, grey: Grey, target: Target) -> Detection:
        """The target's points in a grey image (h, w)."""
        ...
