"""Product of exponentials: every joint is a screw in the base frame.

    T_base_flange = exp(S_1 q_1) exp(S_2 q_2) ... exp(S_n q_n) M

(Brockett 1984; Lynch and Park, Modern Robotics, eq. 4.14.) M is the flange's pose at q = 0. It needs no frames on the
links and no rule for parallel axes; its parameters are few and complete: four a turning joint (two tilts of the axis,
two shifts of it), two a sliding one, six of M. That makes it the model of a robot nobody has described.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.robots.chain import Joint, KinematicChain
from calibrant.robots.geometry import Parameter, ParametricChain, across, sliding, turning

_HOME = (
    *(Parameter(f"home rotation {axis}", "rad") for axis in "xyz"),
    *(Parameter(f"home {axis}", "m") for axis in "xyz"),
)


@dataclass(frozen=True, eq=False)
class ProductOfExponentials(ParametricChain):
    """directions (n, 3), unit, and a point (n, 3) of every axis at q = 0, base frame, metres; home M (4, 4).

    Which point of an axis is given does not change the robot, but tilts turn about it: one close to the work is best.
    Raises: InputError for sizes that do not fit or a direction of length 0.
    """

    joints: tuple[Joint, ...]
    directions: Array
    points: Array
    home: Array

    def __post_init__(self) -> None:
        n = len(self.joints)
        directions, points = (np.asarray(a, dtype=np.float64) for a in (self.directions, self.points))
        if not n or directions.shape != (n, 3) or points.shape != (n, 3):
            raise InputError(
                f"{n} joints need a direction and a point each, shape ({n}, 3); got {directions.shape}, {points.shape}"
            )
        lengths = np.linalg.norm(directions, axis=1, keepdims=True)
        if not np.all(lengths > 1e-9):
            raise InputError(f"joint {self.joints[int(np.argmin(lengths))].name!r}: its axis has no direction")
        object.__setattr__(self, "directions", directions / lengths)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "home", se3.check(self.home, name="home"))

    @property
    def _turns(self) -> Array:
        return np.array([j.kind == "revolute" for j in self.joints])

    @property
    def screws(self) -> Array:
        """Unit screws (n, 6), (omega, v), in the base frame at q = 0."""
        return np.where(self._turns[:, None], turning(self.points, self.directions), sliding(self.directions))

    def _products(self, q: ArrayLike) -> Array:
        """exp(S_1 q_1) ... exp(S_k q_k) for k = 0 .. n: (..., n + 1, 4, 4)."""
        values = self.check(q)
        factors = se3.exp(values[..., None] * self.screws)
        out = np.empty((*values.shape[:-1], len(self.joints) + 1, 4, 4))
        out[..., 0, :, :] = np.eye(4)
        for k in range(len(self.joints)):
            out[..., k + 1, :, :] = out[..., k, :, :] @ factors[..., k, :, :]
        return out

    def forward(self, q: ArrayLike) -> Array:
        return self._products(q)[..., -1, :, :] @ self.home

    def link_frames(self, q: ArrayLike) -> Array:
        """Frames that coincide with the base at q = 0."""
        return self._products(q)

    def joint_axes(self, q: ArrayLike) -> tuple[Array, Array]:
        before = self._products(q)[..., :-1, :, :]
        return se3.apply(before, self.points), np.einsum("...kij,kj->...ki", before[..., :3, :3], self.directions)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        out: list[Parameter] = []
        for joint in self.joints:
            out += [Parameter(f"{joint.name} tilt {w}", "rad") for w in "uv"]
            if joint.kind == "revolute":
                out += [Parameter(f"{joint.name} shift {w}", "m") for w in "uv"]
        return (*out, *_HOME)

    @property
    def state(self) -> Array:
        return np.concatenate([self.directions.ravel(), self.points.ravel(), self.home.ravel()])

    def with_state(self, state: ArrayLike) -> Self:
        values, n = np.asarray(state, dtype=np.float64), len(self.joints)
        return replace(
            self,
            directions=values[: 3 * n].reshape(n, 3),
            points=values[3 * n : 6 * n].reshape(n, 3),
            home=values[6 * n :].reshape(4, 4),
        )

    def _generators(self) -> tuple[Array, list[int]]:
        """Twists of tilts and shifts at the axes (p - 6, 6), and the joint of each."""
        u, v = across(self.directions)
        rows: list[Array] = []
        owner: list[int] = []
        for k, joint in enumerate(self.joints):
            rows += [turning(self.points[k], u[k]), turning(self.points[k], v[k])]
            owner += [k, k]
            if joint.kind == "revolute":
                rows += [sliding(u[k]), sliding(v[k])]
                owner += [k, k]
        return np.array(rows), owner

    def moved(self, delta: ArrayLike) -> Self:
        d = np.asarray(delta, dtype=np.float64)
        u, v = across(self.directions)
        directions, points, row = np.array(self.directions), np.array(self.points), 0
        for k, joint in enumerate(self.joints):
            directions[k] = so3.exp(d[row] * u[k] + d[row + 1] * v[k]) @ directions[k]
            row += 2
            if joint.kind == "revolute":
                points[k] += d[row] * u[k] + d[row + 1] * v[k]
                row += 2
        return replace(self, directions=directions, points=points, home=se3.retract(self.home, d[row:]))

    def steps_to(self, other: Self) -> Array:
        u, v = across(self.directions)
        out: list[float] = []
        for k, joint in enumerate(self.joints):
            turn = np.cross(self.directions[k], other.directions[k])
            sine = float(np.linalg.norm(turn))
            turn = turn * (np.arctan2(sine, self.directions[k] @ other.directions[k]) / sine if sine > 0 else 1.0)
            out += [float(turn @ u[k]), float(turn @ v[k])]
            if joint.kind == "revolute":
                # Where the other axis passes this one's point: its point is free to slide along it.
                w = other.directions[k]
                along = (self.points[k] - other.points[k]) @ self.directions[k] / (w @ self.directions[k])
                shift = other.points[k] + along * w - self.points[k]
                out += [float(shift @ u[k]), float(shift @ v[k])]
        return np.concatenate([out, se3.local(self.home, other.home)])

    def geometry_twists(self, q: ArrayLike) -> Array:
        """A generator d at screw S turns exp(S q) into exp(d) exp(S q) exp(-d): V = Ad(P) d - Ad(P exp(S q)) d."""
        products = self._products(q)
        generators, owner = self._generators()
        Ad = se3.adjoint(products)
        before, after = Ad[..., owner, :, :], Ad[..., [k + 1 for k in owner], :, :]
        screws = np.einsum("...pij,pj->...pi", before - after, generators)
        origin = np.broadcast_to(self.home[:3, 3], (3, 3))
        at_home = np.concatenate([turning(origin, np.eye(3)), sliding(np.eye(3))])
        home = np.einsum("...ij,pj->...pi", Ad[..., -1, :, :], at_home)
        return np.concatenate([screws, home], axis=-2)

    def with_joint_offsets(self, offsets: ArrayLike) -> Self:
        """exp(S (q + o)) = exp(S q) exp(S o): the second factor moves all later screws and the home."""
        values = np.asarray(offsets, dtype=np.float64)
        before = self._products(values)
        return replace(
            self,
            directions=np.einsum("kij,kj->ki", before[:-1, :3, :3], self.directions),
            points=se3.apply(before[:-1], self.points),
            home=before[-1] @ self.home,
        )


def as_product_of_exponentials(chain: KinematicChain) -> ProductOfExponentials:
    """Any chain with one mover a joint as a product of exponentials: its axes and flange at q = 0."""
    zero = np.zeros(len(chain.joints))
    centre, axis = chain.joint_axes(zero)
    return ProductOfExponentials(chain.joints, axis, centre, chain.forward(zero))
