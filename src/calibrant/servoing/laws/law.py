"""What a control law is: an error that is to vanish, and how the camera's motion changes it.

    e = s - s*,  de/dt = J xi,   xi = -gain J+ e

xi is the camera's twist (omega, v) against the target, along the camera's axes (Chaumette and Hutchinson 2006, eq. 4).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from calibrant.arrays import Array
from calibrant.servoing.sight.features import Features


@dataclass(frozen=True, eq=False)
class Pull:
    """error (k,) in sigmas or in units of one size; jacobian (k, 6); subspace (6, m): the twists that may be used."""

    error: Array
    jacobian: Array
    subspace: Array

    @property
    def twist(self) -> Array:
        """xi (6,) for a gain of 1: -S (J S)+ e."""
        return -self.subspace @ (np.linalg.pinv(self.jacobian @ self.subspace, rcond=1e-9) @ self.error)

    @property
    def free(self) -> Array:
        """(6, 6): projects a twist on those that the error does not feel, S (I - (J S)+ J S) S^T."""
        J = self.jacobian @ self.subspace
        return self.subspace @ (np.eye(J.shape[1]) - np.linalg.pinv(J, rcond=1e-6) @ J) @ self.subspace.T


class Law(Protocol):
    """A control law. least: features that it needs; model: whether they must have a pose."""

    @property
    def name(self) -> str:
        """As `--control` says it."""
        ...

    @property
    def least(self) -> int:
        """Features."""
        ...

    @property
    def model(self) -> bool:
        """Whether the features must have a pose."""
        ...

    def subspace(self, R_camera_gripper: Array) -> Array:
        """(6, m) orthonormal: the camera's twists that it uses, with the gripper turned so (3, 3)."""
        ...

    def pull(self, seen: Features, wanted: Features, R_camera_gripper: Array) -> Pull:
        """The error between the same features seen and wanted, and its Jacobian."""
        ...


ALL = np.eye(6)
