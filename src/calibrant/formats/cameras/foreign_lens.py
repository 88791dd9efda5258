"""Lenses of other programs that none of our models says exactly: the nearest one of ours, and by how much it is off.

One rule for every reader: such a lens is refused with the error in pixels of the nearest, and read as that one, the
error noted, where the caller asks for it (`approximate=yes`, or `model=NAME`, which names the one to take).

minimise  sum_i |project(a, ray_i) - uv_i|^2   over a, pixels and rays over the whole image
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.cameras.approximation.nearest import GRID, Approximation, nearest_to_rays
from calibrant.errors import InputError
from calibrant.formats.exchange.exchange_format import Size, answer
from calibrant.reading.notes import note

MODELS = ("kannala_brandt", "unified", "rational")
ASKS = {
    "approximate": "yes: take the nearest camera of ours where the file's model is none of them",
    "model": f"likewise, and which model of ours it shall be ({', '.join(MODELS)}, …)",
}
_NEAR_ENOUGH_PX = 0.01
"""Below what corners are found to; other models need not be tried."""
_WIDEST_DEG = 120.0
"""Angle from the axis up to which rays count: no lens is wider, and in dark corners a polynomial says nothing."""
_RINGS, _SPOKES = 60, 48
_WIDEST = 0.95
"""Of the angle to the side, for lenses that map a plane."""
_FEWEST = 50
"""Rays over the image; fewer do not hold a lens."""


def nearest_by_projection(
    theirs: Callable[[Array], Array],
    models: Sequence[str],
    start: Mapping[str, float],
    size: Size,
    answers: Mapping[str, str],
    *,
    what: str,
    widest: float = _WIDEST * np.pi / 2,
) -> Camera:
    """The camera of one of `models` that sees most like `theirs`, where the caller takes that.

    Args: theirs: pixels (n, 2) of rays (n, 3); start: fx fy cx cy, and terms to start from; what: the lens in words;
    widest: angle from the axis, rad, beyond which it sees nothing. Raises: InputError where it was not asked for, with
    the error in pixels.
    """
    rays, uv = _seen(theirs, size, widest, np.array([start["cx"], start["cy"]]))
    if len(rays) < _FEWEST:
        raise InputError(f"{what} sees nothing of images of {size[0]}x{size[1]} px")
    return _nearest(uv, rays, models, start, size, answers, what=what, where="the image")


def nearest_by_rays(
    rays_of: Callable[[Array], Array],
    size: Size,
    answers: Mapping[str, str],
    *,
    focal_px: float,
    centre: Array,
    what: str,
) -> Camera:
    """The same for a lens whose pixels (n, 2) have the rays `rays_of` (n, 3), NaN where there is none.

    Args: focal_px, centre: scale at the axis and where it meets the image, px; what: the lens in words.
    Raises: InputError where there are no rays, or where it was not asked for.
    """
    width, height = size
    u, v = np.meshgrid(np.linspace(0, width - 1, GRID[0]), np.linspace(0, height - 1, GRID[1]))
    uv = np.stack([u.ravel(), v.ravel()], axis=-1)
    with np.errstate(all="ignore"):
        rays = rays_of(uv)
        angle = np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    seen = np.isfinite(rays).all(axis=-1) & (angle < np.deg2rad(_WIDEST_DEG))
    if seen.sum() < len(uv) // 10 or not np.isfinite(focal_px) or focal_px <= 0:
        raise InputError(f"{what} gives rays to {seen.mean():.0%} of the image; correct its terms")
    start = {"fx": float(focal_px), "fy": float(focal_px), "cx": float(centre[0]), "cy": float(centre[1])}
    where = "the image" if seen.all() else f"what it sees of the image within {_WIDEST_DEG:g} deg of the axis"
    return _nearest(uv[seen], rays[seen], MODELS, start, size, answers, what=what, where=where)


def _nearest(
    uv: Array,
    rays: Array,
    models: Sequence[str],
    start: Mapping[str, float],
    size: Size,
    answers: Mapping[str, str],
    *,
    what: str,
    where: str,
) -> Camera:
    """The nearest, where it was asked for. Raises: InputError with its error where it was not."""
    model, said = answer(answers, "model"), answer(answers, "approximate", ("yes", "no"))
    best = _best(uv, rays, (model,) if model else models, start, size, what)
    name = best.camera.model.name
    off = f"off by {best.rms_px:.3g} px RMS and {best.most_px:.3g} px at most over {where}"
    if best.outside:
        off += f"; {best.outside:.2g} of that lies outside of the {name} camera"
    if said == "no" or (said is None and model is None):
        raise InputError(
            f"{what} is a model that calibrant does not have; the nearest, {name}, is {off}: take it with "
            "--answer approximate=yes"
        )
    note(f"{what} is read as the nearest {name} camera: {off}")
    return best.camera


def _best(
    uv: Array, rays: Array, models: Sequence[str], start: Mapping[str, float], size: Size, what: str
) -> Approximation:
    """Of those that see most of it the one with the lowest RMS. Raises: InputError where none sees it."""
    focal, centre = float(np.sqrt(abs(start["fx"] * start["fy"]))), np.array([start["cx"], start["cy"]])
    fits: list[Approximation] = []
    for name in models:
        if fits and fits[-1].outside == 0 and fits[-1].rms_px < _NEAR_ENOUGH_PX:
            break
        try:
            fits.append(
                nearest_to_rays(uv, rays, model=name, image_size=size, focal_px=focal, centre=centre, terms=start)
            )
        except (InputError, np.linalg.LinAlgError):
            if len(models) == 1:
                raise
    if not fits:
        raise InputError(f"{what}: no model of {', '.join(models)} sees what it sees")
    return min(fits, key=lambda fit: (round(fit.outside, 2), fit.rms_px))


def _seen(theirs: Callable[[Array], Array], size: Size, widest: float, centre: Array) -> tuple[Array, Array]:
    """Rays over the image and their pixels, along each spoke as far as these move outwards."""
    theta, phi = np.meshgrid(
        np.linspace(0, widest, 20 * _RINGS + 1)[1:], np.linspace(0, 2 * np.pi, _SPOKES, endpoint=False), indexing="ij"
    )
    rays = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    with np.errstate(all="ignore"):
        uv = theirs(rays.reshape(-1, 3)).reshape(*theta.shape, 2)
        out = np.linalg.norm(uv - centre, axis=-1)
        grows = np.logical_and.accumulate(np.diff(out, axis=0, prepend=0) > 0, axis=0)
        inside = np.all((uv > -0.5) & (uv < np.array(size) - 0.5), axis=-1)
    kept = grows & inside
    rings = np.flatnonzero(kept.any(axis=1))
    step = max(1, len(rings) // _RINGS)
    chosen = np.zeros(len(kept), dtype=bool)
    chosen[rings[::step]] = True
    kept &= chosen[:, None]
    return rays[kept], uv[kept]
