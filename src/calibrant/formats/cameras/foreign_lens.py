"""Lenses of other programs that none of our models says exactly: the nearest one of ours, and by how much it is off.

minimise  sum_i |project(a, ray_i) - theirs(ray_i)|^2   over a, rays over the whole image
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.formats.exchange.exchange_format import ReadOptions, Size, answer
from calibrant.reading.notes import note

ASKS = {"approximate": "yes: take the nearest camera of ours where the file's model is none of them"}
_RINGS, _SPOKES = 60, 48
_WIDEST = 0.95
"""Of the angle to the side, for lenses that map a plane."""
_STEPS = 60
_SETTLED = 1e-9


def nearest_lens(
    theirs: Callable[[Array], Array],
    models: Sequence[str],
    start: Mapping[str, float],
    size: Size,
    options: ReadOptions,
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
    if len(rays) < 50:
        raise InputError(f"{what} sees nothing of images of {size[0]}x{size[1]} px")
    fitted = [_fitted(model, start, size, rays, uv) for model in models]
    camera, rms, most = min(fitted, key=lambda f: f[1])
    off = f"the nearest, {camera.model.name}, is off by {rms:.2g} px RMS and {most:.2g} px at most over the image"
    if answer(options.answers, "approximate", ("yes", "no")) != "yes":
        raise InputError(
            f"{what} is a model that calibrant does not have; {off}: take it with --answer approximate=yes"
        )
    note(f"{what} is a model that calibrant does not have: {off}")
    return camera


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


def _fitted(model: str, start: Mapping[str, float], size: Size, rays: Array, uv: Array) -> tuple[Camera, float, float]:
    """Levenberg and Marquardt's method on all parameters of the model; its error, RMS and largest, pixels."""
    from calibrant.cameras import camera_model

    kind = camera_model(model)
    own = {name: value for name, value in start.items() if name in kind.parameter_names}
    camera = Camera.create(model, own, image_size=size)
    values, damping = camera.values.copy(), 1e-4
    cost = np.inf
    for _ in range(_STEPS):
        with np.errstate(all="ignore"):
            found, _, J = kind.project_with_jacobians(values, rays)
        e = np.where(np.isfinite(found), found - uv, 0.0).ravel()
        A = np.where(np.isfinite(J), J, 0.0).reshape(-1, len(values))
        cost = float(e @ e)
        scale = np.linalg.norm(A, axis=0) + np.finfo(float).tiny
        better = False
        while not better and damping < 1e8:
            B = np.vstack([A / scale, np.sqrt(damping) * np.eye(len(values))])
            step = np.linalg.lstsq(B, np.concatenate([-e, np.zeros(len(values))]), rcond=None)[0] / scale
            with np.errstate(all="ignore"):
                tried = kind.project(values + step, rays) - uv
            lower = float(np.sum(tried**2))
            better = bool(np.isfinite(lower) and lower < cost)
            damping = damping / 10 if better else damping * 10
        if not better:
            break
        values = values + step
        if cost - lower <= _SETTLED * cost:
            break
    best = Camera(kind, size, values)
    away = np.linalg.norm(best.project(rays) - uv, axis=-1)
    if not np.all(np.isfinite(away)):
        return best, np.inf, np.inf
    return best, float(np.sqrt(np.mean(away**2))), float(away.max())
