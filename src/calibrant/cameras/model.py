"""What a camera model is: a map from points in the camera frame to pixels, its inverse and its derivatives.

A model is stateless: its parameters are a plain vector, named by `parameter_names`. Camera frame: x right, y down,
z forward, metres. Pixel (0, 0) is the centre of the top-left pixel.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.errors import InputError

Array = NDArray[np.float64]


class CameraModel(ABC):
    """One camera model. Subclass it in a file of its own and register it in `cameras/registry.py`."""

    name: ClassVar[str]
    parameter_names: ClassVar[tuple[str, ...]]
    parameter_units: ClassVar[tuple[str, ...]]
    """Unit of each parameter, "px" or "1", in the order of `parameter_names`."""

    @abstractmethod
    def project(self, parameters: ArrayLike, p_camera: ArrayLike) -> Array:
        """Pixels of points: (..., 3) metres -> (..., 2) px; NaN where the model cannot see the point (z <= 0)."""

    @abstractmethod
    def project_with_jacobians(self, parameters: ArrayLike, p_camera: ArrayLike) -> tuple[Array, Array, Array]:
        """Pixels and derivatives: uv (..., 2), d uv / d p_camera (..., 2, 3), d uv / d parameters (..., 2, k)."""

    @abstractmethod
    def unproject(self, parameters: ArrayLike, uv: ArrayLike) -> Array:
        """Unit rays of pixels: (..., 2) px -> (..., 3) in the camera frame; NaN where no ray reaches the pixel."""

    @abstractmethod
    def rows(self) -> Any:
        """Compiled `project_with_jacobians` of one view, signature `kernels.ROWS`, for the fused normal equations."""

    def index(self, parameter: str) -> int:
        """Position of a parameter in the vector. Raises: InputError with the valid names."""
        if parameter not in self.parameter_names:
            raise InputError(
                f"the {self.name} model has no parameter {parameter!r}; it has {', '.join(self.parameter_names)}"
            )
        return self.parameter_names.index(parameter)
