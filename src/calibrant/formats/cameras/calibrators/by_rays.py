"""Lenses whose model is not one of ours: read as the nearest that is, and said by how many pixels that differs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.cameras.approximation.nearest import GRID, Approximation, nearest_to_rays
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import Size
from calibrant.reading.notes import note

MODELS = ("kannala_brandt", "unified", "rational")
ASKS = {"model": f"which model of ours stands for the lens, where the file's is none of them ({', '.join(MODELS)}, …)"}
_NEAR_ENOUGH_PX = 0.01
"""Below what corners are found to; other models need not be tried."""
_WIDEST_DEG = 120.0
"""Angle from the axis up to which rays count: no lens is wider, and in dark corners a polynomial says nothing."""


def camera_by_rays(
    rays_of: Callable[[Array], Array],
    *,
    size: Size,
    focal_px: float,
    centre: Array,
    lens: str,
    source: str,
    model: str | None = None,
) -> Camera:
    """The camera that sees most like one whose pixels (n, 2) have the rays `rays_of` (n, 3), NaN where there is none.

    Args: focal_px, centre: scale at the axis and where it meets the image, px; lens: what the file calls the model;
    model: the one of ours to take instead of the nearest. Raises: InputError where there are no rays.
    """
    width, height = size
    u, v = np.meshgrid(np.linspace(0, width - 1, GRID[0]), np.linspace(0, height - 1, GRID[1]))
    uv = np.stack([u.ravel(), v.ravel()], axis=-1)
    with np.errstate(all="ignore"):
        rays = rays_of(uv)
        angle = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    seen = np.isfinite(rays).all(axis=-1) & (angle < np.deg2rad(_WIDEST_DEG))
    if seen.sum() < len(uv) // 10 or not np.isfinite(focal_px) or focal_px <= 0:
        raise InputError(f"{source}: the {lens} lens gives rays to {seen.mean():.0%} of the image; correct its terms")
    fits: list[Approximation] = []
    for name in (model,) if model else MODELS:
        if fits and fits[-1].outside == 0 and fits[-1].rms_px < _NEAR_ENOUGH_PX:
            break
        try:
            fits.append(
                nearest_to_rays(
                    uv[seen], rays[seen], model=name, image_size=size, focal_px=float(focal_px), centre=centre
                )
            )
        except (InputError, np.linalg.LinAlgError):
            if model:
                raise
    if not fits:
        raise InputError(f"{source}: no model of {', '.join(MODELS)} sees what the {lens} lens sees")
    best = min(fits, key=lambda fit: (round(fit.outside, 2), fit.rms_px))
    where = "the image" if seen.all() else f"what it sees of the image within {_WIDEST_DEG:g} deg of the axis"
    outside = (
        f"; {best.outside:.2g} of that lies outside of the {best.camera.model.name} camera" if best.outside else ""
    )
    note(
        f"{source}: a {lens} lens is read as the nearest {best.camera.model.name} camera: off by {best.rms_px:.3g} px "
        f"RMS and {best.most_px:.3g} px at most over {where}{outside}"
    )
    return best.camera
