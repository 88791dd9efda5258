"""Which pictures of a running robot are samples: the board found, robot and board still, a pose not taken yet."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.data import View
from calibrant.geometry import se3
from calibrant.targets.target import Target

STILL_S = 0.5
"""Seconds that the robot must have stood before the picture."""
STILL_MM, STILL_DEG = 0.2, 0.02
"""What a standing robot's readings may do in that time."""
STILL_PART = 0.002
"""Of the picture's width: a board that moved less since the picture before stands, too."""
SHARP_PART = 0.5
"""Of the samples' median sharpness: less is lost focus."""
NEW_MM, NEW_DEG = 15.0, 5.0
"""A pose is new where it is so far, or turned so far, from every sample's."""
LEAST_POINTS = 6
_REMEMBERED = 50
"""Samples whose sharpness counts."""

Motion = tuple[float, float] | None
"""mm and deg over the last `STILL_S`; None where it is not known."""


@dataclass(frozen=True, eq=False)
class Sample:
    """A view of the board, the picture it was found in, and the robot's pose then."""

    view: View
    grey: NDArray[np.uint8]
    T_base_tool: Array


@dataclass(frozen=True, eq=False)
class Look:
    """What a picture showed: sample, or the reason why it is none; uv (n, 2): the points found, for showing them."""

    reason: str | None
    uv: Array
    sample: Sample | None = None


@dataclass(frozen=True, eq=False)
class Sampler:
    """The state after some pictures; `look` gives the next one.

    samples: those taken, and count of them; sharpness: of the last ones; last: points of the picture before, by label;
    repeats: for a camera that is tracked, poses that were taken before count again, and the last sample alone is kept.
    """

    target: Target
    camera: str = "camera"
    repeats: bool = False
    samples: tuple[Sample, ...] = ()
    count: int = 0
    sharpness: tuple[float, ...] = ()
    last: tuple[NDArray[np.int64], Array] | None = None

    def look(
        self, grey: NDArray[np.uint8], T_base_tool: Array, motion: Motion, *, detect: Callable | None = None
    ) -> tuple[Sampler, Look]:
        """The sampler after a picture (h, w) taken at a robot pose (4, 4), and what it showed.

        detect(grey, target): in place of the target's own detector. Raises: InputError as detectors do.
        """
        from calibrant.detection.live import sharpness
        from calibrant.detection.registry import detector_for

        found = (detect or detector_for(self.target.kind).detect)(grey, self.target)
        after = replace(self, last=(found.point_ids, found.uv) if found.found else None)
        if not found.found or len(found.uv) < LEAST_POINTS:
            return after, Look("no board", found.uv if found.found else np.empty((0, 2)))
        sharp = sharpness(grey, found.uv)
        reason = self._moving(motion, found.point_ids, found.uv, grey.shape[1]) or self._worse(sharp, T_base_tool)
        if reason is not None:
            return after, Look(reason, found.uv)
        row_of = {int(label): row for row, label in enumerate(self.target.point_ids)}
        rows = [row_of[int(label)] for label in found.point_ids]
        view = View(
            f"{self.count:04d}.png", self.target.points[rows], found.uv, found.point_ids, camera=self.camera,
            sigma_px=found.sigma_px, covariance_px=found.covariance_px,
        )  # fmt: skip
        sample = Sample(view, grey, T_base_tool)
        samples = (sample,) if self.repeats else (*self.samples, sample)
        sharpnesses = (*self.sharpness, sharp)[-_REMEMBERED:]
        kept = replace(after, samples=samples, count=self.count + 1, sharpness=sharpnesses)
        return kept, Look(None, found.uv, sample)

    def _moving(self, motion: Motion, ids: NDArray[np.int64], uv: Array, width: int) -> str | None:
        if motion is None:
            return "no pose of the robot for this long"
        if motion[0] > STILL_MM or motion[1] > STILL_DEG:
            return "the robot moves"
        if self.last is None:
            return "first sight"
        _, one, other = np.intersect1d(ids, self.last[0], return_indices=True)
        still = len(one) > 0 and float(np.abs(uv[one] - self.last[1][other]).max()) < STILL_PART * width
        return None if still else "the board moves"

    def _worse(self, sharp: float, T_base_tool: Array) -> str | None:
        if self.sharpness and sharp < SHARP_PART * float(np.median(self.sharpness)):
            return "not sharp"
        if self.repeats or not self.samples:
            return None
        mm, deg = se3.deviation(np.array([s.T_base_tool for s in self.samples]), T_base_tool)
        return "this pose is taken" if bool(np.any((mm < NEW_MM) & (deg < NEW_DEG))) else None
