"""What perception says of an object: its pose with covariance, the poses that look the same, and what is not known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3

if TYPE_CHECKING:
    from calibrant.data import CalibrationResult


@dataclass(frozen=True, eq=False)
class ObjectPose:
    """T_frame_object (4, 4), metres, covariance (6, 6) of `se3.retract`.

    symmetries (s, 4, 4), T_object_same: motions of the object that nobody sees; undetermined: directions, in words,
    that the data do not tell, with the sigma of a wide prior in the covariance; notes: what was left out, or assumed.
    """

    name: str
    matrix: Array
    covariance: Array
    symmetries: Array = field(default_factory=lambda: np.eye(4)[None])
    undetermined: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    figures: dict[str, float] = field(default_factory=dict)
    frame: str = "camera"

    @property
    def equivalents(self) -> Array:
        """All poses (s, 4, 4) that look the same, the given one first."""
        return np.asarray(self.matrix @ self.symmetries)

    @property
    def sigma_mm(self) -> Array:
        """1 sigma of the object's origin along the frame's axes, millimetres."""
        return 1e3 * np.sqrt(np.diag(self.covariance)[3:])

    @property
    def sigma_deg(self) -> Array:
        """1 sigma of the rotation about the frame's axes, degrees."""
        return np.rad2deg(np.sqrt(np.diag(self.covariance)[:3]))

    def error(self, T_frame_object: ArrayLike) -> Array:
        """The error (6,) against a true pose, rad and metres: of the equivalent pose that is nearest by turn."""
        truth = np.asarray(T_frame_object, dtype=np.float64)
        deltas = se3.local(np.broadcast_to(truth, self.equivalents.shape), self.equivalents)
        return np.asarray(min(deltas, key=lambda d: float(np.linalg.norm(d[:3]))))

    def nearest_to(self, T_frame_object: ArrayLike) -> ObjectPose:
        """The same by the equivalent pose that is turned least against another; a gripper's fingers, say."""
        truth = np.asarray(T_frame_object, dtype=np.float64)
        turns = [float(np.linalg.norm(se3.local(truth, T)[:3])) for T in self.equivalents]
        S = self.symmetries[int(np.argmin(turns))]
        T = self.matrix @ S
        # The origin may move with the symmetry: its covariance is that of the moved point.
        lever = (T - self.matrix)[:3, 3]
        J = np.eye(6)
        J[3:, :3] = -_hat(lever)
        return replace(self, matrix=T, covariance=J @ self.covariance @ J.T)

    def moved(self, T_new_frame: ArrayLike, frame: str, covariance: ArrayLike | None = None) -> ObjectPose:
        """The pose in another frame. Args: covariance (6, 6) of T_new_frame (`se3.retract`), independent of the
        pose."""
        T = np.asarray(T_new_frame, dtype=np.float64)
        turn = np.kron(np.eye(2), T[:3, :3])
        own = turn @ self.covariance @ turn.T
        if covariance is not None:
            J = np.eye(6)
            J[3:, :3] = -_hat(T[:3, :3] @ self.matrix[:3, 3])
            own = own + J @ np.asarray(covariance, dtype=np.float64) @ J.T
        return replace(self, matrix=T @ self.matrix, covariance=own, frame=frame)


def _hat(v: Array) -> Array:
    from calibrant.geometry import so3

    return so3.hat(v)


def of_result(result: CalibrationResult, *, names: Sequence[str] = ()) -> list[ObjectPose]:
    """The poses that a result of `pose` or `locate` holds, tags and bundles among them, as of objects.

    Args: names: of children, all by default. Raises: InputError where the result has none, or none with a covariance.
    """
    camera = next(iter(result.cameras), "camera")
    chosen = [t for t in result.transforms if t.parent == camera and (not names or t.child in names)]
    if not chosen:
        known = ", ".join(f"{t.parent} -> {t.child}" for t in result.transforms) or "none"
        raise InputError(f"the result of {result.kind} has no pose of an object before {camera}; it has: {known}")
    out = []
    for t in chosen:
        if t.covariance is None:
            raise InputError(f"the pose {t.parent} -> {t.child} has no covariance in its file")
        out.append(ObjectPose(t.child, t.matrix, t.covariance, frame=camera))
    return out
