"""Poses as a file gives them: plain numbers, and what the file says about their meaning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError

QUATERNION_NORM_TOLERANCE = 0.01
"""Largest |norm - 1| of a quaternion whose four numbers were rounded to two decimals."""


@dataclass(frozen=True)
class Stated:
    """What column names, keys and units of a file say. None: the file does not say.

    units of positions: m, mm, cm, in. rotation: the notation, of the numbers as they stand in the file.
    axes: the axis each of three rotation numbers is named after, such as "xyz" for rx, ry, rz.
    likely: a notation that is only a habit, not a statement. angle: deg, rad. direction: base-gripper, gripper-base.
    """

    units: str | None = None
    rotation: str | None = None
    axes: str | None = None
    likely: str | None = None
    angle: str | None = None
    direction: str | None = None


NOTHING_STATED = Stated()


@dataclass(frozen=True)
class PoseOptions:
    """How a user says that poses are to be read; "auto" leaves it to the file and the data."""

    units: str = "auto"
    rotation: str = "auto"
    angle: str = "auto"
    direction: str = "auto"


@dataclass(frozen=True, eq=False)
class RawPoses:
    """Poses as they stand in a file, before their convention is decided.

    translation (n, 3) and rotation (n, 3), (n, 4) or (n, 3, 3): the file's numbers in the file's order and units.
    names (n,): what the file calls each pose, or None. places (n,): where each stands, for messages.
    target: poses T_camera_target of the same moments, when the file holds pairs. notes: how numbers were read that
    could be read otherwise; unused: the columns that were passed over.
    times (n,): seconds, where a column says when each pose was taken. joints (n, k): the joint values that forward
    kinematics made the poses from, radians and metres. rotation_first: the same rows of six bare numbers with the
    rotation in front of the position, where the numbers leave both orders open.
    """

    translation: Array
    rotation: Array
    names: tuple[str, ...] | None
    places: tuple[str, ...]
    stated: Stated = NOTHING_STATED
    options: PoseOptions = PoseOptions()
    source: str = ""
    target: RawPoses | None = None
    notes: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()
    times: Array | None = None
    joints: Array | None = None
    rotation_first: RawPoses | None = None

    def __post_init__(self) -> None:
        _refuse_repeated(self.names, self.places)
        if not len(self.places) == len(self.translation) == len(self.rotation):
            raise ValueError(
                f"{len(self.places)} places, {len(self.translation)} poses, {len(self.rotation)} rotations"
            )
        for i in np.flatnonzero(~(_finite_rows(self.translation) & _finite_rows(self.rotation))):
            raise InputError(
                f"{self.places[i]}: NaN or infinity; a pose needs finite numbers: correct the line or remove it"
            )
        for array in (self.translation, self.rotation):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.translation)


def _finite_rows(rows: Array) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(rows.reshape(len(rows), -1)).all(axis=1))


def _refuse_repeated(names: tuple[str, ...] | None, places: tuple[str, ...]) -> None:
    first: dict[str, str] = {}
    for name, where in zip(names or (), places):
        if name in first:
            raise InputError(
                f"{where}: the name {name!r} occurs twice, first at {first[name]}; every pose needs its own name"
            )
        first[name] = where


def checked_quaternions(q: Array, places: tuple[str, ...]) -> Array:
    """Quaternions (n, 4) normalised. Raises: InputError naming the place of a norm that is 0 or not 1."""
    norms = np.linalg.norm(q, axis=1)
    for where, norm in zip(places, norms):
        if norm < 1e-9:
            raise InputError(f"{where}: a quaternion of norm 0 is no rotation; expected a norm of 1")
        if abs(norm - 1) > QUATERNION_NORM_TOLERANCE:
            raise InputError(
                f"{where}: the quaternion's norm is {norm:.4g}, expected 1; if these numbers are not a "
                "quaternion, say what they are (--pose-rotation)"
            )
    return q / norms[:, None]
