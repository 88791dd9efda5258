"""Denavit-Hartenberg chains in both conventions; each row gives the pose of link i in link i-1.

    standard (Denavit and Hartenberg 1955; Siciliano):  T = Rz(theta + q) Tz(d) Tx(a) Rx(alpha)
    modified (Craig, Introduction to Robotics, ch. 3):  T = Rx(alpha) Tx(a) Rz(theta + q) Tz(d)

with alpha and a of the row itself: for the modified convention these are Craig's alpha_{i-1} and a_{i-1}. A prismatic
joint adds q to d in place of theta.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibrant.errors import InputError
from calibrant.robots.chain import Array, Joint, KinematicChain


@dataclass(frozen=True)
class DHRow:
    """One line of a table: a, d in metres, alpha, theta in radians; theta (or d) is the value at q = 0."""

    a: float
    alpha: float
    d: float
    theta: float = 0.0


@dataclass(frozen=True)
class _DHChain(KinematicChain):
    """A table of rows with a joint each."""

    rows: tuple[DHRow, ...]
    joints: tuple[Joint, ...]

    def __post_init__(self) -> None:
        if not self.rows or len(self.rows) != len(self.joints):
            raise InputError(
                f"a chain needs as many rows as joints, at least one; got {len(self.rows)}, {len(self.joints)}"
            )

    @abstractmethod
    def link_transforms(self, q: ArrayLike) -> Array:
        """Pose of every link in the one before it, (..., n, 4, 4)."""

    def link_frames(self, q: ArrayLike) -> Array:
        """Pose of every link in the base, (..., n + 1, 4, 4): the base itself first, the flange last."""
        T = self.link_transforms(q)
        frames = np.empty((*T.shape[:-3], len(self.rows) + 1, 4, 4))
        frames[..., 0, :, :] = np.eye(4)
        for i in range(len(self.rows)):
            frames[..., i + 1, :, :] = frames[..., i, :, :] @ T[..., i, :, :]
        return frames

    def forward(self, q: ArrayLike) -> Array:
        return self.link_frames(q)[..., -1, :, :]

    def _screw(self, q: ArrayLike) -> tuple[Array, Array]:
        """Rz(theta) Tz(d) and Tx(a) Rx(alpha) of every row, two (..., n, 4, 4)."""
        values = self.check(q)
        turns = np.array([j.kind == "revolute" for j in self.joints])
        theta = np.array([r.theta for r in self.rows]) + np.where(turns, values, 0.0)
        d = np.array([r.d for r in self.rows]) + np.where(turns, 0.0, values)
        alpha, a = np.array([r.alpha for r in self.rows]), np.array([r.a for r in self.rows])
        about_z = np.zeros((*values.shape, 4, 4))
        about_z[..., 0, 0] = about_z[..., 1, 1] = np.cos(theta)
        about_z[..., 1, 0], about_z[..., 0, 1] = np.sin(theta), -np.sin(theta)
        about_z[..., 2, 2] = about_z[..., 3, 3] = 1.0
        about_z[..., 2, 3] = d
        about_x = np.zeros((len(self.rows), 4, 4))
        about_x[:, 1, 1] = about_x[:, 2, 2] = np.cos(alpha)
        about_x[:, 2, 1], about_x[:, 1, 2] = np.sin(alpha), -np.sin(alpha)
        about_x[:, 0, 0] = about_x[:, 3, 3] = 1.0
        about_x[:, 0, 3] = a
        return about_z, np.broadcast_to(about_x, about_z.shape)


@dataclass(frozen=True)
class StandardDH(_DHChain):
    """Standard convention: joint i moves about z of link i-1."""

    def link_transforms(self, q: ArrayLike) -> Array:
        about_z, about_x = self._screw(q)
        return about_z @ about_x

    def joint_axes(self, q: ArrayLike) -> tuple[Array, Array]:
        frames = self.link_frames(q)[..., :-1, :, :]
        return frames[..., :3, 3], frames[..., :3, 2]


@dataclass(frozen=True)
class ModifiedDH(_DHChain):
    """Modified convention: joint i moves about z of link i."""

    def link_transforms(self, q: ArrayLike) -> Array:
        about_z, about_x = self._screw(q)
        return about_x @ about_z

    def joint_axes(self, q: ArrayLike) -> tuple[Array, Array]:
        frames = self.link_frames(q)[..., 1:, :, :]
        return frames[..., :3, 3], frames[..., :3, 2]
