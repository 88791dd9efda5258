"""What a renderer is asked for: a rectangle of pixels of an ideal pinhole camera at a place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array

NEAR_M = 0.02
FAR_M = 12.0


@dataclass(frozen=True, eq=False)
class PinholeView:
    """K (3, 3) pixels and size (width, height) of an ideal camera at T_base_camera (4, 4)."""

    K: Array
    size: tuple[int, int]
    T_base_camera: Array


class Renderer(Protocol):
    """Draws the world as it stands: by OpenGL, or by casting rays where there is none."""

    @property
    def name(self) -> str:
        """How it draws: "EGL", "OSMesa", "rays"."""
        ...

    def colour_and_depth(self, view: PinholeView) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """BGR (h, w, 3) and depth along the axis (h, w), metres."""
        ...

    def depth(self, view: PinholeView) -> NDArray[np.float32]:
        """Depth alone."""
        ...

    def close(self) -> None:
        """Let go of the context."""
        ...
