"""What a refinement of corners hands back, and the zone around a corner that it may leave out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array

WINDOWS_OF_BLUR = 3.0
"""Half width of the window over the blur: an edge reaches its full contrast within it. One that does not is told from a
weaker and sharper one by its curvature alone, and from there on sigma falls short."""


@dataclass(frozen=True, eq=False)
class Refined:
    """uv (n, 2) pixels; sigma_px (n,) per axis; contrast and noise (n,) grey levels; blur_px (n,) 1 sigma of edges'
    blur; converged (n,).

    Where blur is wider along one direction, covariance_px (n, 2, 2), px^2, and blur_px is that of the wider; smeared
    says that the picture moved further than the windows hold.
    """

    uv: Array
    sigma_px: Array
    contrast: Array
    noise: Array
    blur_px: Array
    converged: NDArray[np.bool_]
    covariance_px: Array | None = None
    smeared: bool = False

    @property
    def shape(self) -> Array:
        """Covariance over sigma_px^2 (n, 2, 2): I where it is alike to all sides, or there is none."""
        shape = np.tile(np.eye(2), (len(self.uv), 1, 1))
        if self.covariance_px is not None:
            there = self.converged
            shape[there] = self.covariance_px[there] / self.sigma_px[there, None, None] ** 2
        return shape


Zone = float | tuple[float, float]
"""Half widths, px, of what is left out around a corner: one for both axes, or along x and along y."""


def zone_of(zone: Zone) -> Array:
    """The half widths along x and y, (2,)."""
    return np.broadcast_to(np.asarray(zone, dtype=np.float64), 2).copy()
