"""Where the camera sits, on the arm or beside it, and what the flange's motion is to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult, TransformEstimate
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

Setup = Literal["eye-in-hand", "eye-to-hand"]
PARENTS: dict[str, Setup] = {"gripper": "eye-in-hand", "base": "eye-to-hand"}


@dataclass(frozen=True, eq=False)
class Mounting:
    """setup; transform (4, 4): T_gripper_camera of a camera on the arm that looks at what stands still, T_base_camera
    of one that stands and looks at what the arm carries; covariance (6, 6) as `TransformEstimate` has it.

        >>> import numpy as np
        >>> Mounting("eye-in-hand", np.eye(4)).camera_from_flange(np.eye(4)).tolist() == np.eye(6).tolist()
        True
    """

    setup: Setup
    transform: Array
    covariance: Array | None = None

    def __post_init__(self) -> None:
        if self.setup not in PARENTS.values():
            raise InputError(f"setup {self.setup!r}; expected {' or '.join(PARENTS.values())}")
        object.__setattr__(self, "transform", se3.check(self.transform, name="the camera's transform"))

    @classmethod
    def of(cls, result: CalibrationResult, camera: str) -> Mounting:
        """From a hand-eye result. Raises: InputError where it does not place the camera on the gripper or the base."""
        for t in result.transforms:
            if t.child == camera and t.parent in PARENTS:
                return cls(PARENTS[t.parent], t.matrix, t.covariance)
        known = ", ".join(f"{t.parent} -> {t.child}" for t in result.transforms) or "none"
        raise InputError(
            f"the calibration has no transform gripper -> {camera} or base -> {camera}; it has: {known}. Servoing "
            "needs a hand-eye result (calibrant hand-eye)"
        )

    @property
    def estimate(self) -> TransformEstimate:
        """As a result keeps it, of a camera called "camera"."""
        parent = "gripper" if self.setup == "eye-in-hand" else "base"
        return TransformEstimate(parent, "camera", self.transform, self.covariance)

    def T_base_camera(self, T_base_gripper: Array) -> Array:
        """The camera in the base (4, 4)."""
        return T_base_gripper @ self.transform if self.setup == "eye-in-hand" else self.transform

    def camera_from_flange(self, T_base_gripper: Array) -> Array:
        """(6, 6): from the flange's twist (base axes, at its origin) to that of the camera against what it looks at.

        With r from the flange to the camera: omega_c = s R^T omega, v_c = s R^T (v + omega x r); s is 1 on the arm and
        -1 beside it, where the arm moves the target instead.
        """
        T = self.T_base_camera(T_base_gripper)
        R, r = T[:3, :3].T, T[:3, 3] - T_base_gripper[:3, 3]
        out = np.zeros((6, 6))
        out[:3, :3] = out[3:, 3:] = R
        out[3:, :3] = -R @ so3.hat(r)
        return out if self.setup == "eye-in-hand" else -out
