"""What a kinematic chain is: joint values in, the flange's pose and its derivatives out.

A description of robots (Denavit-Hartenberg, product of exponentials, URDF) is a subclass in a file of its own: it says
where the flange is and where the joints' axes lie; limits and Jacobians follow here.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError


@dataclass(frozen=True)
class Joint:
    """One moving joint: values in radians (revolute) or metres (prismatic), from `lower` to `upper`."""

    name: str
    lower: float = -np.pi
    upper: float = np.pi
    kind: Literal["revolute", "prismatic"] = "revolute"

    def __post_init__(self) -> None:
        if self.kind not in ("revolute", "prismatic"):
            raise InputError(f"joint {self.name!r}: unknown kind {self.kind!r}; expected revolute or prismatic")
        if not self.lower < self.upper:
            raise InputError(f"joint {self.name!r}: limits {self.lower:g} to {self.upper:g}; the lower comes first")


class KinematicChain(ABC):
    """A serial arm from `base` to `flange`. Arrays of joint values are (..., n): leading axes are a batch."""

    joints: tuple[Joint, ...]

    @abstractmethod
    def forward(self, q: ArrayLike) -> Array:
        """T_base_flange (..., 4, 4) at joint values q (..., n)."""

    @abstractmethod
    def joint_axes(self, q: ArrayLike) -> tuple[Array, Array]:
        """A point of each joint's axis and its unit direction, base frame: two (..., n, 3)."""

    @property
    def lower(self) -> Array:
        """Lower joint limits (n,)."""
        return np.array([j.lower for j in self.joints])

    @property
    def upper(self) -> Array:
        """Upper joint limits (n,)."""
        return np.array([j.upper for j in self.joints])

    def within_limits(self, q: ArrayLike) -> NDArray[np.bool_]:
        """True where all joints are within their limits: (...,)."""
        values = self.check(q)
        return np.all((values >= self.lower) & (values <= self.upper), axis=-1)

    def jacobian(self, q: ArrayLike) -> Array:
        """Derivative of the flange's pose in the chart of `se3.retract`: (..., 6, n), rotation rows first.

        A revolute joint with axis (c, z) turns the flange at p by omega = z and moves it by v = z x (p - c); a
        prismatic one gives omega = 0, v = z (Siciliano et al., Robotics, eq. 3.30).
        """
        centre, axis = self.joint_axes(q)
        flange = self.forward(q)[..., None, :3, 3]
        turns = np.array([j.kind == "revolute" for j in self.joints])[:, None]
        omega = np.where(turns, axis, 0.0)
        v = np.where(turns, np.cross(axis, flange - centre), axis)
        return np.swapaxes(np.concatenate([omega, v], axis=-1), -1, -2)

    def check(self, q: ArrayLike) -> Array:
        """Joint values as a float array (..., n). Raises: InputError for a wrong number of joints, NaN or infinity."""
        values = np.asarray(q, dtype=np.float64)
        n = len(self.joints)
        if values.ndim == 0 or values.shape[-1] != n:
            raise InputError(
                f"this arm has {n} joints ({', '.join(j.name for j in self.joints)}); got shape {values.shape}"
            )
        if not np.all(np.isfinite(values)):
            raise InputError("joint values hold NaN or infinite numbers")
        return values
