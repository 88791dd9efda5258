"""Floor 0: rotations, rigid transforms, frames and projective geometry; NumPy and SciPy alone.

Its modules are `cb.geometry`, each loaded when it is named:

    so3, se3          rotations and rigid transforms as Lie groups: exp, log, mean, inverse, apply, adjoint
    rotations         matrices from and to Euler angles, quaternions, rotation vectors, axis and angle
    frames            `FrameGraph`: any frame relative to any other
    frame_tree        the way from one frame to another in a tree that robots tell
    motion            where a frame was at any time between the poses that were recorded
    projective        homographies, essential and fundamental matrices, epipolar lines and distances
    rectifying        the turns after which two cameras look the same way, side by side
    triangulation     points in space from the rays that see them
    grasp_equations   Z T6 E = B G and the camera loops, one function an equation

    >>> import calibrant as cb
    >>> R = cb.geometry.rotations.matrix_from_euler([90.0, 0.0, 0.0], order="ZYX", unit="deg")
    >>> T_base_gripper = cb.geometry.se3.make(R, [0.5, 0.0, 0.25])
    >>> cb.geometry.se3.apply(T_base_gripper, [0.1, 0.0, 0.0]).round(6).tolist()
    [0.5, 0.1, 0.25]
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrant.geometry import frame_tree as frame_tree
    from calibrant.geometry import frames as frames
    from calibrant.geometry import grasp_equations as grasp_equations
    from calibrant.geometry import motion as motion
    from calibrant.geometry import projective as projective
    from calibrant.geometry import rectifying as rectifying
    from calibrant.geometry import rotations as rotations
    from calibrant.geometry import se3 as se3
    from calibrant.geometry import so3 as so3
    from calibrant.geometry import triangulation as triangulation

__all__ = [
    *("frame_tree", "frames", "grasp_equations", "motion", "projective", "rectifying", "rotations", "se3", "so3"),
    "triangulation",
]


def __getattr__(name: str) -> ModuleType:
    if name not in __all__:
        raise AttributeError(f"module 'calibrant.geometry' has no attribute {name!r}; it has {', '.join(__all__)}")
    return import_module(f"calibrant.geometry.{name}")


def __dir__() -> list[str]:
    return sorted(__all__)
