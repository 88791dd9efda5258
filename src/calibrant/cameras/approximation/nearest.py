"""The camera of another model that sees most alike, and by how many pixels it differs over the image.

    minimise  sum_i |project(b, unproject(a, uv_i)) - uv_i|^2   over b, uv_i on a grid over the image

Where the other model has every term, b is a with its other terms neutral and nothing is lost. The covariance goes along
to first order: d b / d a = (J_b^T J_b)^-1 J_b^T J_a, J the derivatives of the pixels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Mask
from calibrant.cameras import Camera, CameraModel, camera_model
from calibrant.cameras.splined import FAMILY
from calibrant.errors import InputError

GRID = (40, 30)
"""Points across the image and down: a polynomial of degree 20 does not hide between them."""
SAME_PX = 1e-9
"""Rounding of a projection in doubles; a difference below is none."""
_KNOTS = (16, 12)
_MOST_SPLINED_DEG = 339
_STEPS = 100
_MANY = 50
"""Parameters from which products of columns are faster than the columns."""
_SETTLED = 1e-6
"""Relative change of the mean square that ends the fit: half of it is the change of the error itself."""
_DEGENERATE = 1e-7
"""Directions of the parameters that move pixels this much less than others are not told by rays: they carry nothing."""


Lacks = Mapping[str, tuple[str, ...]]
"""Terms that a model has here and not where it is to be said, by model: there they are neutral."""
NOTHING: Lacks = {}
NO_TERMS: Mapping[str, float] = {}


@dataclass(frozen=True, eq=False)
class Approximation:
    """camera: of the other model; rms_px, most_px: its difference from the original over the image, per point over both
    axes; outside: the share of the image whose rays the other model cannot see at all."""

    camera: Camera
    rms_px: float
    most_px: float
    outside: float

    @property
    def exact(self) -> bool:
        """Whether nothing is lost."""
        return self.most_px <= SAME_PX and self.outside == 0


def in_words_of(camera: Camera, models: Sequence[str], *, lacks: Lacks = NOTHING) -> Camera | None:
    """The same camera as one of `models` (the first that can say it), None where none of them can.

    lacks: terms that some of the models may not use.

    >>> import calibrant as cb
    >>> parameters = {"fx": 800.0, "fy": 800.0, "cx": 319.5, "cy": 239.5, "k1": -0.2}
    >>> camera = cb.Camera.create("rational", parameters, image_size=(640, 480))
    >>> in_words_of(camera, ("pinhole", "brown")).model.name
    'brown'
    """
    own = camera.model.name
    if (own in models or _family(own) in models) and not _used(camera, lacks.get(own, ())):
        return camera
    uv, rays = _rays(camera)
    for name in models:
        other = None if name in (own, FAMILY) else _shared_terms(camera, name, lacks.get(name, ()))
        if other is not None and _difference(other, uv, rays)[1] <= SAME_PX:
            return other
    return None


def nearest(camera: Camera, model: str, *, lacks: tuple[str, ...] = ()) -> Approximation:
    """The camera of `model` that sees most like `camera` over its image.

    Args: model: a name of `calibrant.cameras.MODELS`, or "splined" for one whose control points span the image; lacks:
    its terms that stay neutral.
    Raises: InputError where the models share no rays.
    """
    same = in_words_of(camera, (model,), lacks={model: lacks})
    if same is not None:
        return Approximation(same, 0.0, 0.0, 0.0)
    uv, rays = _rays(camera)
    start = _start(camera, _member(model, rays))
    kind = start.model
    seen = kind.valid(start.values, rays)
    if not seen.any():
        raise InputError(f"a {model} camera sees nothing of what this {camera.model.name} camera sees")
    free = np.array([name not in (*lacks, *kind.gauge) for name in kind.parameter_names])
    values = _fitted(start, uv, rays, free)
    other = Camera(kind, camera.image_size, values, _carried(camera, start.model.name, values, uv, rays, free))
    rms, most = _difference(other, uv, rays)
    inside = kind.valid(values, rays) & np.isfinite(kind.project(values, rays)).all(axis=-1)
    return Approximation(other, rms, most, float(1 - inside.sum() / (GRID[0] * GRID[1])))


def nearest_to_rays(
    uv: Array,
    rays: Array,
    *,
    model: str,
    image_size: tuple[int, int],
    focal_px: float,
    centre: Array,
    terms: Mapping[str, float] = NO_TERMS,
) -> Approximation:
    """The camera of `model` that sees pixels along given rays, of a lens that no model here has: a polynomial, a table.

    Args: uv (n, 2) px over the image, rays (n, 3) of any length; focal_px, centre (2,) px: scale at the axis and where
    it meets the image, from which the fit starts; terms: what is known better, by name, of those that the model has.
    Raises: InputError where the model sees none of the rays.
    """
    kind = camera_model(_member(model, rays))
    values = kind.starting_values(focal_px, centre)
    for name in set(terms) & set(kind.parameter_names):
        values[kind.index(name)] = terms[name]
    start = Camera(kind, image_size, values)
    if not kind.valid(start.values, rays).any():
        raise InputError(f"a {model} camera sees nothing of what these pixels see")
    values = _fitted(start, uv, rays, np.array([name not in kind.gauge for name in kind.parameter_names]))
    found = Camera(kind, image_size, values)
    rms, most = _difference(found, uv, rays)
    return Approximation(found, rms, most, float(1 - np.mean(kind.valid(values, rays))))


def nearest_of(camera: Camera, models: Sequence[str], *, lacks: Lacks = NOTHING) -> Approximation:
    """The nearest camera of several models: of those that show most of the image, the one with the lowest RMS.

    Raises: InputError where none shares rays with the camera.
    """
    found: list[Approximation] = []
    for name in models:
        with suppress(InputError):
            found.append(nearest(camera, name, lacks=lacks.get(name, ())))
    if not found:
        raise InputError(f"none of {', '.join(models)} sees what this {camera.model.name} camera sees")
    return min(found, key=lambda f: (f.outside, f.rms_px))


def _rays(camera: Camera) -> tuple[Array, Array]:
    """Pixels over the image (n, 2) and their rays (n, 3), those that have one."""
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, GRID[0]), np.linspace(0, height - 1, GRID[1]))
    uv = np.stack([u.ravel(), v.ravel()], axis=-1)
    rays = camera.unproject(uv)
    has = np.isfinite(rays).all(axis=-1)
    return uv[has], rays[has]


def _used(camera: Camera, names: Sequence[str]) -> list[str]:
    """Those of the camera's terms that are not neutral."""
    values, neutral = camera.parameters, camera.model.neutral
    return [n for n in names if values[n] != neutral.get(n, 0.0)]


def _shared_terms(camera: Camera, model: str, lacks: tuple[str, ...]) -> Camera | None:
    """The terms that both have, where all others of the camera are neutral."""
    kind = camera_model(model)
    values = camera.parameters
    if _used(camera, [n for n in values if n not in kind.parameter_names or n in lacks]):
        return None
    kept = [n for n in values if n in kind.parameter_names]
    covariance = None
    if camera.covariance is not None:
        at = [camera.model.index(n) for n in kept]
        to = [kind.index(n) for n in kept]
        covariance = np.zeros((len(kind.parameter_names),) * 2)
        covariance[np.ix_(to, to)] = camera.covariance[np.ix_(at, at)]
    kept_values = {n: values[n] for n in kept}
    return Camera.create(model, kept_values, image_size=camera.image_size, covariance=covariance)


def _family(model: str) -> str:
    """The name without the numbers of one of its members."""
    return model.partition(":")[0]


def _member(model: str, rays: Array) -> str:
    """The name of a model; of the splined family that of the member that spans the rays."""
    if model != FAMILY:
        return model
    columns, rows = _KNOTS
    with np.errstate(all="ignore"):
        q = 2 * rays[:, :2] / (np.linalg.norm(rays, axis=-1) + rays[:, 2])[:, None]
    x, y = np.abs(q[np.isfinite(q).all(axis=-1)]).max(axis=0)
    reach = max(x, y * (columns - 3) / (rows - 3))
    return f"{FAMILY}:{columns}x{rows}:{min(_MOST_SPLINED_DEG, int(np.ceil(np.rad2deg(4 * np.arctan(reach / 2)))))}deg"


def _start(camera: Camera, model: str) -> Camera:
    """A plain lens of the other model with this one's scale at the axis."""
    kind = camera_model(model)
    _, J, _ = camera.model.project_with_jacobians(camera.values, [0.0, 0.0, 1.0])
    centre = np.array([camera.parameters["cx"], camera.parameters["cy"]])
    return Camera(kind, camera.image_size, kind.starting_values(float(np.sqrt(abs(np.linalg.det(J[:, :2])))), centre))


def _difference(camera: Camera, uv: Array, rays: Array) -> tuple[float, float]:
    """RMS and largest distance from the pixels, over the rays in the camera's valid field."""
    away = np.linalg.norm(camera.project(rays) - uv, axis=-1)
    away = away[np.isfinite(away) & camera.model.valid(camera.values, rays)]
    return (float(np.sqrt(np.mean(away**2))), float(away.max())) if len(away) else (np.inf, np.inf)


def _fitted(start: Camera, uv: Array, rays: Array, free: Mask) -> Array:
    """Levenberg-Marquardt on the free parameters (k,); what the model cannot see does not count."""
    kind, values, damping = start.model, start.values.copy(), 1e-3
    cost = _cost(kind, values, uv, rays)
    for _ in range(_STEPS):
        J, e = _rows(start, values, uv, rays)
        J = J[:, free]
        scale = np.linalg.norm(J, axis=0) + np.finfo(float).tiny
        step = np.zeros(len(values))
        step[free] = _step(J / scale, e, damping) / scale
        lower = _cost(kind, values + step, uv, rays)
        if lower < cost:
            done = cost - lower <= _SETTLED * cost
            values, cost, damping = values + step, lower, damping / 10
            if done:
                break
        elif (damping := damping * 10) > 1e12:
            break
    return values


def _step(J: Array, e: Array, damping: float) -> Array:
    """Minimises |J s + e|^2 + damping |s|^2; hundreds of columns, a spline's, through their products."""
    count = J.shape[1]
    if count > _MANY:
        return np.asarray(np.linalg.solve(J.T @ J + damping * np.eye(count), -J.T @ e), dtype=np.float64)
    A = np.vstack([J, np.sqrt(damping) * np.eye(count)])
    return np.linalg.lstsq(A, np.concatenate([-e, np.zeros(count)]), rcond=None)[0]


def _rows(start: Camera, values: Array, uv: Array, rays: Array) -> tuple[Array, Array]:
    found, _, J = start.model.project_with_jacobians(values, rays)
    e = found - uv
    good = np.isfinite(e).all(axis=-1) & start.model.valid(values, rays)
    return J[good].reshape(-1, len(values)), e[good].ravel()


def _cost(model: CameraModel, values: Array, uv: Array, rays: Array) -> float:
    """Mean square over what is seen; infinite where nothing is."""
    with np.errstate(all="ignore"):
        away = np.sum((model.project(values, rays) - uv) ** 2, axis=-1)
    good = np.isfinite(away) & model.valid(values, rays)
    return float(away[good].mean()) if good.any() else np.inf


def _carried(camera: Camera, model: str, values: Array, uv: Array, rays: Array, free: Mask) -> Array | None:
    """The covariance of the other camera's parameters."""
    if camera.covariance is None:
        return None
    kind = camera_model(model)
    good = kind.valid(values, rays)
    J_b = kind.project_with_jacobians(values, rays[good])[2].reshape(-1, len(values))
    J_a = camera.model.project_with_jacobians(camera.values, rays[good])[2].reshape(-1, len(camera.values))
    scale = np.linalg.norm(J_b, axis=0) + np.finfo(float).tiny
    D = np.zeros((len(values), len(camera.values)))
    D[free] = np.linalg.lstsq((J_b / scale)[:, free], J_a, rcond=_DEGENERATE)[0] / scale[free, None]
    return D @ camera.covariance @ D.T
