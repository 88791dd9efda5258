"""The one transform that a file of transforms holds, and the frames that ROS wants around a camera.

    T_parent_child along the shortest chain of the result's transforms

A camera's frame is optical: x right, y down, z ahead (REP 103, suffix _optical). With `body=NAME` the camera's body
frame (x ahead, y left, z up) stands between: T_parent_body = T_parent_optical T_body_optical^-1, and T_body_optical has
roll, pitch, yaw = -pi/2, 0, -pi/2.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult
from calibrant.data.results import TransformEstimate, as_transform
from calibrant.errors import InputError
from calibrant.formats.exchange.exchange_format import WriteOptions, read_cameras
from calibrant.formats.exchange.places import graph_of
from calibrant.geometry import rotations, se3

R_BODY_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Columns: right, down and ahead in a frame whose x is ahead, y left and z up."""
ASKS = {
    "parent": "the parent frame's name in the file",
    "child": "the child frame's name in the file",
    "body": "the name of the camera's body frame (x ahead, z up), which is put between parent and camera",
}
_RIGID = 1e-9


@dataclass(frozen=True, eq=False)
class Placed:
    """T_parent_child (4, 4), metres."""

    parent: str
    child: str
    T: Array

    @property
    def xyz(self) -> Array:
        """The child's origin in the parent, metres."""
        return self.T[:3, 3]

    @property
    def rpy(self) -> Array:
        """Roll, pitch, yaw about the parent's x, y, z, radians: R = Rz(yaw) Ry(pitch) Rx(roll)."""
        return rotations.euler_from_matrix(self.T[:3, :3], order="xyz", unit="rad")

    @property
    def xyzw(self) -> Array:
        """The unit quaternion x, y, z, w."""
        return rotations.quaternion_xyzw_from_matrix(self.T[:3, :3])


def the_transform(result: CalibrationResult, options: WriteOptions) -> Placed:
    """The transform that was asked for, or the only one there is; frames called as the result calls them.

    Raises: InputError where there is none or several, and where no chain of transforms leads there.
    """
    if options.transform is None:
        if len(result.transforms) != 1:
            listed = ", ".join(f"{t.parent}:{t.child}" for t in result.transforms) or "none"
            raise InputError(
                f"this format holds one transform, there are {len(result.transforms)} ({listed}); name one: "
                "--transform PARENT:CHILD"
            )
        only = result.transforms[0]
        return Placed(only.parent, only.child, only.matrix)
    parent, child = options.transform
    return Placed(parent, child, graph_of(result).T(parent, child))


def placed(result: CalibrationResult, options: WriteOptions) -> tuple[Placed, ...]:
    """The transform under the names asked for; two where a body frame was asked for (`body=camera_link`): parent to
    body, and body to the optical frame, camera_optical_frame unless the child has a name with "optical" in it.

    Raises: as `the_transform`.
    """
    found = the_transform(result, options)
    said = options.answers
    parent, child, body = said.get("parent", found.parent), said.get("child", found.child), said.get("body")
    if body is None:
        return (Placed(parent, child, found.T),)
    if "child" not in said and "optical" not in child:
        child = f"{body.removesuffix('_link')}_optical_frame"
    T_body_optical = se3.make(R_BODY_OPTICAL, np.zeros(3))
    return (
        Placed(parent, body, found.T @ se3.inverse(T_body_optical)),
        Placed(body, child, T_body_optical),
    )


def as_result(found: Iterable[Placed], source: str) -> CalibrationResult:
    """The result of transforms that were read. Raises: InputError where two of them contradict, or none is there."""
    transforms: list[TransformEstimate] = [as_transform(p.parent, p.child, p.T) for p in found]
    if not transforms:
        raise InputError(f"{source}: no transform in it that has numbers")
    twice = {(t.parent, t.child) for t in transforms}
    result = read_cameras({}, transforms=tuple({(t.parent, t.child): t for t in transforms}.values()))
    if len(twice) < len(transforms):
        for t in transforms:
            first = result.transform(t.parent, t.child).matrix
            if np.abs(first - t.matrix).max() > _RIGID:
                raise InputError(f"{source}: {t.parent} -> {t.child} stands there twice, and differs; keep one")
    graph_of(result)
    return result
