"""How the corners of chessboards are measured: the method, its window, the zone around the corner that is left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError

if TYPE_CHECKING:
    from calibrant.detection.subpixel.refined import Refined

METHODS = ("saddle", "foerstner", "radon")
LEAST_WINDOW, MOST_WINDOW = 0.05, 0.5
"""Half width of a window over the distance to the next corner: beyond a half, the next corner's edges come in."""
RADON_PX = 10.0
"""Half length of Radon's lines where the squares leave room: longer ones feel the lens's bend."""


@dataclass(frozen=True)
class Refinement:
    """A method with its options.

    method: saddle, foerstner or radon; window: its half width over the smallest distance to the next corner, None for
    the method's own choice; zero_zone_px: half width of the square around the corner that is left out, 0 for none, or
    its half widths along x and y.
    """

    method: str = "saddle"
    window: float | None = None
    zero_zone_px: float | tuple[float, float] = 0.0

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"unknown refinement {self.method!r}; there are: {', '.join(METHODS)}")
        if self.window is not None and not LEAST_WINDOW <= self.window <= MOST_WINDOW:
            raise InputError(
                f"the window is {100 * LEAST_WINDOW:g}% to {100 * MOST_WINDOW:g}% of the distance to the next corner, "
                f"got {100 * self.window:g}%"
            )
        zone = np.atleast_1d(np.asarray(self.zero_zone_px, dtype=np.float64))
        if zone.size > 2 or not np.all((zone >= 0.0) & (zone < 20.0)):
            got = ", ".join(f"{half:g}" for half in zone)
            raise InputError(f"the zero zone is 0 px (none) to 20 px, for both axes or along x and y, got {got} px")
        if self.method == "radon" and np.any(zone > 0):
            raise InputError("the Radon refinement has no zero zone; leave the zone out, or take foerstner")


DEFAULT = Refinement()


def refine(
    grey: NDArray[np.uint8],
    uv: Array,
    steps: Array,
    dark: NDArray[np.bool_],
    *,
    how: Refinement = DEFAULT,
    most: float = MOST_WINDOW,
    radius_px: float = 6.0,
    blur_px: float = 1.0,
) -> Refined:
    """Corners near uv (n, 2), measured as asked for.

    Args: steps (n, 4) px: ux, uy to the next corner along the row and vx, vy along the column; dark (n,): colour of the
    square towards both; most: the largest window that holds nothing but the corner, over the steps; radius_px: half
    width of the window in pixels where none was asked for; blur_px: the blur to start from.
    """
    # Kernels are loaded when something is measured, and methods that are not asked for never.
    from calibrant.detection.subpixel import motion, saddle

    window = min(how.window if how.window is not None else saddle.WINDOW, most)
    if how.method == "saddle":
        scaled = steps * (window / saddle.WINDOW)
        longest = float(np.abs(steps).max(initial=1.0)) * window * np.sqrt(2.0)
        radius = radius_px if how.window is None else max(radius_px, longest)
        return motion.refine(grey, uv, scaled, dark, radius_px=radius, blur_px=blur_px, zero_zone_px=how.zero_zone_px)
    nearest = np.minimum(np.hypot(steps[:, 0], steps[:, 1]), np.hypot(steps[:, 2], steps[:, 3]))
    half = window * nearest
    if how.method == "foerstner":
        from calibrant.detection.subpixel import foerstner

        return foerstner.refine(grey, uv, half, zero_zone_px=how.zero_zone_px)
    from calibrant.detection.subpixel import radon

    return radon.refine(grey, uv, half if how.window is not None else np.minimum(half, max(RADON_PX, radius_px)))
