"""The failures of the classical methods, each with its name."""

from __future__ import annotations

from calibrant.errors import RefusedError

TOO_FEW = "too few points"
TOO_FEW_VIEWS = "too few views"
COLLINEAR = "collinear points"
COPLANAR = "coplanar points"
NOT_COPLANAR = "points with depth"
UNDETERMINED = "undetermined"
T_Y_ZERO = "t_y = 0"
T_X_ZERO = "t_x = 0"
FRONTO_PARALLEL = "fronto-parallel"
PARALLEL_PLANES = "parallel planes"
NO_FOCAL_LENGTH = "no positive focal length"
BEHIND = "points behind the camera"
MIRRORED = "mirrored points"
PARALLEL_RAYS = "parallel rays"
NO_AXES = "no points on the axes"


class Degenerate(RefusedError):  # noqa: N818 - the condition is its name, as errors here say it
    """Points that a classical method cannot calibrate from. `name` is one of this module's names."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(f"{name}: {message}")
        self.name = name
