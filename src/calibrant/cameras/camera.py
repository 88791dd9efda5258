"""A camera: a model, its parameters, the size of its images and how certain the parameters are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.cameras.model import REQUIRED, CameraModel
from calibrant.cameras.registry import camera_model
from calibrant.errors import InputError
from calibrant.expected import expect, unexpected

_SHOWN = 9
"""Parameters in a repr: all of the common models; a splined one has hundreds."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera. Build it with `Camera.create`.

    values (k,) in the order of `model.parameter_names`; covariance (k, k) of the same, None when it is not known;
    a fixed parameter has variance 0.

        >>> import calibrant as cb
        >>> parameters = {"fx": 800.0, "fy": 800.0, "cx": 319.5, "cy": 239.5}
        >>> camera = cb.Camera.create("pinhole", parameters, image_size=(640, 480))
        >>> camera.project([0.1, 0.0, 1.0]).tolist()
        [399.5, 239.5]
    """

    model: CameraModel
    image_size: tuple[int, int]
    values: Array
    covariance: Array | None = None

    def __post_init__(self) -> None:
        k = len(self.model.parameter_names)
        values = np.array(self.values, dtype=np.float64)
        if values.shape != (k,) or not np.all(np.isfinite(values)):
            raise InputError(
                f"a {self.model.name} camera needs {k} finite parameters ({', '.join(self.model.parameter_names)}), "
                f"got {values.tolist()}"
            )
        try:
            width, height = (int(n) for n in self.image_size)
        except (TypeError, ValueError, OverflowError):
            raise unexpected(self.image_size, "image_size", "(width, height) in pixels") from None
        if width < 1 or height < 1:
            raise InputError(f"image_size is (width, height) in pixels, both at least 1, got {self.image_size}")
        values.setflags(write=False)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "image_size", (width, height))
        if self.covariance is not None:
            covariance = np.array(self.covariance, dtype=np.float64)
            if covariance.shape != (k, k):
                raise InputError(f"the covariance of {k} camera parameters is ({k}, {k}), got {covariance.shape}")
            covariance.setflags(write=False)
            object.__setattr__(self, "covariance", covariance)

    @classmethod
    def create(
        cls,
        model: str,
        parameters: Mapping[str, float],
        *,
        image_size: tuple[int, int],
        covariance: ArrayLike | None = None,
    ) -> Camera:
        """Camera from a model's name and named parameters; terms that are left out are neutral: 0, mostly.

        Raises: InputError for unknown names, a missing focal length or principal point, a focal length that is not
        above 0, values that are not finite.
        """
        kind = camera_model(model)
        expect(parameters, Mapping, "parameters", "values by name: {'fx': 800.0, 'fy': 800.0, 'cx': 320.0, …}")
        for name, value in parameters.items():
            expect(value, (int, float, np.number), f"parameter {name!r}", "a number")
        for name in parameters:
            kind.index(name)
        missing = [n for n in REQUIRED if n not in parameters]
        if missing:
            raise InputError(f"a {model} camera needs {', '.join(REQUIRED)}; missing: {', '.join(missing)}")
        for name in ("fx", "fy"):
            if parameters[name] <= 0:
                unit = kind.parameter_units[kind.index(name)]
                raise InputError(
                    f"{name} is {parameters[name]:g} {unit}; a focal length is above 0. A camera that delivers mirror "
                    "images is used with its images flipped (mirror-x)"
                )
        values = np.array([float(parameters.get(n, kind.neutral.get(n, 0.0))) for n in kind.parameter_names])
        cov = None if covariance is None else np.asarray(covariance, dtype=np.float64)
        return cls(kind, image_size, values, cov)

    def __repr__(self) -> str:
        width, height = self.image_size
        shown = ", ".join(f"{n} {v:.6g}" for n, v in list(self.parameters.items())[:_SHOWN])
        more = len(self.values) - _SHOWN
        rest = f", {more} more" if more > 0 else ""
        known = "" if self.covariance is None else ", with covariance"
        return f"Camera({self.model.name}, {width} × {height} px: {shown}{rest}{known})"

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters by name."""
        return dict(zip(self.model.parameter_names, self.values.tolist()))

    @property
    def sigma(self) -> dict[str, float]:
        """1 sigma of each parameter by name, 0 for a fixed one; empty when the covariance is not known."""
        if self.covariance is None:
            return {}
        return dict(zip(self.model.parameter_names, np.sqrt(np.diag(self.covariance)).tolist()))

    @property
    def K(self) -> Array:
        """Camera matrix (3, 3), pixels: [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]."""
        p = self.parameters
        return np.array([[p["fx"], p.get("skew", 0.0), p["cx"]], [0, p["fy"], p["cy"]], [0, 0, 1]])

    def project(self, p_camera: ArrayLike) -> Array:
        """Pixels of points in the camera frame: (..., 3) metres -> (..., 2); NaN for points the camera cannot see.

        Raises: InputError for points that are not rows of x, y, z.
        """
        return self.model.project(self.values, _rows_of(p_camera, 3, "points are rows of x, y, z"))

    def unproject(self, uv: ArrayLike) -> Array:
        """Unit rays of pixels: (..., 2) -> (..., 3) in the camera frame; NaN outside the model's valid field.

        Raises: InputError for pixels that are not rows of u, v.
        """
        return self.model.unproject(self.values, _rows_of(uv, 2, "pixels are rows of u, v"))


def _rows_of(values: ArrayLike, size: int, words: str) -> Array:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != size:
        raise InputError(f"{words}: expected an array of shape (..., {size}), got {array.shape}")
    return array
