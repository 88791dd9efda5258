"""What a camera model is: a map from points in the camera frame to pixels, its inverse and its derivatives.

A model is stateless: its parameters are a plain vector, named by `parameter_names`. Camera frame: x right, y down,
z forward, metres. Pixel (0, 0) is the centre of the top-left pixel.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array, Mask
from calibrant.errors import InputError

COMPILED_PIXELS = 20_000
"""Pixels from which the compiled inverse pays: loading it costs more than NumPy needs for fewer."""
REQUIRED = ("fx", "fy", "cx", "cy")
Projection = Literal["perspective", "central", "parallel"]


class CameraModel(ABC):
    """One camera model. Subclass it in a file of its own and register it in `cameras/registry.py`."""

    name: str
    parameter_names: tuple[str, ...]
    parameter_units: tuple[str, ...]
    """Unit of each parameter, "px", "rad", "px/m" or "1", in the order of `parameter_names`."""
    neutral: ClassVar[dict[str, float]] = {}
    """Values of the terms that are left out, where that is not 0."""
    start_terms: ClassVar[dict[str, float]] = {}
    """Values that a fit starts from, where those left out differ: a shape that sees as much as the model can."""
    projection: Projection = "perspective"
    """How its rays lie: through one point and ahead, through one point and all around, or side by side."""
    gauge: tuple[str, ...] = ()
    """Parameters that no data can tell from the others and the poses: a calibration holds them at their start."""
    summary: str = ""
    """When to use it, in a few words."""

    @abstractmethod
    def project(self, parameters: ArrayLike, p_camera: ArrayLike) -> Array:
        """Pixels of points: (..., 3) metres -> (..., 2) px; NaN where the model cannot see the point (`sees`).

        Nothing behind a perspective camera is seen, and nothing at infinity: a direction is given as a point on it.
        """

    @abstractmethod
    def project_with_jacobians(self, parameters: ArrayLike, p_camera: ArrayLike) -> tuple[Array, Array, Array]:
        """Pixels and derivatives: uv (..., 2), d uv / d p_camera (..., 2, 3), d uv / d parameters (..., 2, k)."""

    @abstractmethod
    def rows(self) -> Any:
        """Compiled `project_with_jacobians` of one view, signature `kernels.ROWS`, for the fused normal equations."""

    def local_rows(self) -> tuple[Any, int] | None:
        """For a model with many parameters of which a point sees few: compiled `kernels.LOCAL_ROWS`, and how few."""
        return None

    @abstractmethod
    def _unproject(self, parameters: Array, uv: Array) -> Array:
        """`unproject` in NumPy: pixels (n, 2) -> directions (n, 3) of any length, NaN where there is none."""

    def unproject(self, parameters: ArrayLike, uv: ArrayLike) -> Array:
        """Unit rays of pixels: (..., 2) px -> (..., 3) in the camera frame; NaN where no ray reaches the pixel.

        Many pixels go through the compiled inverse where the model has one; what that does not settle with certainty
        (the rim of the valid field) comes back to the NumPy form.
        """
        a = np.asarray(parameters, dtype=np.float64)
        pixels = finite_points(uv)
        flat = np.ascontiguousarray(pixels.reshape(-1, 2))
        compiled = self.rays() if len(flat) >= COMPILED_PIXELS else None
        if compiled is None:
            return _unit(self._unproject(a, flat)).reshape(*pixels.shape[:-1], 3)
        rays = np.empty((len(flat), 3))
        if compiled(a, self.field_limit(a), flat, rays):
            open_ = np.isnan(rays[:, 0])
            rays[open_] = _unit(self._unproject(a, flat[open_]))
        return rays.reshape(*pixels.shape[:-1], 3)

    def rays(self) -> Any:
        """Compiled inverse, signature `kernels.RAYS_ARGUMENTS`, or None where NumPy's closed form is as good."""
        return None

    def ray_origins(self, parameters: ArrayLike, uv: ArrayLike) -> Array:
        """Where the pixels' rays start in the camera frame, (..., 3) metres: the origin, for a central camera."""
        return np.zeros((*np.asarray(uv).shape[:-1], 3))

    def sees(self, parameters: ArrayLike, p_camera: ArrayLike) -> Mask:
        """Which points (..., 3) have a pixel: for a perspective camera those in front of it."""
        return finite_points(p_camera)[..., 2] > 0

    def field_limit(self, parameters: Array) -> float:
        """Radius in the model's own image plane where the map folds over itself; infinite where it never does."""
        return np.inf

    def inside(self, parameters: Array, p: Array) -> Mask:
        """Which seen points (..., 3) lie within `field_limit`."""
        return np.ones(p.shape[:-1], dtype=np.bool_)

    def valid(self, parameters: ArrayLike, p_camera: ArrayLike) -> Mask:
        """Which points (..., 3) lie in the valid field: seen, before the fold, the image not mirrored there.

        Beyond it pixels are still computed, but belong to other rays as well: `unproject` never answers with such a
        ray. The image is not mirrored where (du/dp x dv/dp) . p > 0.
        """
        a = np.asarray(parameters, dtype=np.float64)
        p = finite_points(p_camera)
        seen = self.sees(a, p)
        safe = np.where(seen[..., None], p, [0.0, 0.0, 1.0])
        _, J, _ = self.project_with_jacobians(a, safe)
        with np.errstate(invalid="ignore"):
            upright = np.sum(np.cross(J[..., 0, :], J[..., 1, :]) * self._line_of_sight(safe), axis=-1) > 0
        return seen & self.inside(a, safe) & upright

    def _line_of_sight(self, p: Array) -> Array:
        return p

    def starting_values(self, focal: float, centre: Array) -> Array:
        """Parameters (k,) of a plain lens of this model: `focal` in pixels per radian at the axis, or per metre."""
        terms = {**self.neutral, **self.start_terms}
        values = np.array([terms.get(name, 0.0) for name in self.parameter_names])
        for name, value in (("fx", 1.0), ("fy", 1.0), ("cx", centre[0]), ("cy", centre[1])):
            values[self.index(name)] = value
        _, J_point, _ = self.project_with_jacobians(values, [0.0, 0.0, 1.0])
        values[[self.index("fx"), self.index("fy")]] = focal / J_point[0, 0]
        return values

    @property
    def listed(self) -> str:
        """Names of the parameters for a message."""
        names = self.parameter_names
        return ", ".join(names) if len(names) <= 24 else f"{', '.join(names[:8])} … {names[-1]}"

    def index(self, parameter: str) -> int:
        """Position of a parameter in the vector. Raises: InputError with the valid names."""
        if parameter not in self.parameter_names:
            raise InputError(f"the {self.name} model has no parameter {parameter!r}; it has {self.listed}")
        return self.parameter_names.index(parameter)


def finite_points(points: ArrayLike) -> Array:
    """Points or pixels (..., d), all NaN where a coordinate is infinite: infinity has no pixel, and no ray."""
    p = np.asarray(points, dtype=np.float64)
    finite = np.isfinite(p)
    if finite.all():  # a look at all numbers at once takes a tenth of one row by row
        return p
    return np.where(np.all(finite, axis=-1, keepdims=True), p, np.nan)


def _unit(rays: Array) -> Array:
    with np.errstate(invalid="ignore"):
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def matrix_of(rows: Sequence[Sequence[Array]]) -> Array:
    """Matrices (..., m, n) whose elements are given by rows, each (...)."""
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
