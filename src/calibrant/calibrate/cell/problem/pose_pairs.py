"""Target poses that were measured elsewhere: the links must reproduce T_camera_target.

rotation:     r = log(R_chain R_measured^T), radians, camera axes
translation:  r = t_chain - (1 + a) t_measured, metres, camera axes; 1 + a is the target's scale

The robot's own noise is a part of the problem: an error of the flange's rotation moves the target by its distance from
the flange, which no noise of the measured target pose looks like. Its poses are unknowns, held by what was measured.
Positions of robot and target differ by the same amount along all axes whichever is wrong, so that their noise is one
level; rotations tell each other apart by the lever arm alone, which is short when the target is in the gripper.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.reprojection import links as products
from calibrant.calibrate.reprojection.links import Link
from calibrant.geometry import so3
from calibrant.optimize.factors import Factor


class MeasuredRotation(Factor):
    """The links' rotation against a measured one."""

    def __init__(self, name: str, links: Sequence[Link], measured: Array, *, noise: str) -> None:
        self.links = tuple(links)
        self.measured = np.asarray(measured, dtype=np.float64)[:, :3, :3]
        super().__init__(
            name, variables=[c.variable for c in links], indices=[c.indices for c in links], dim=3, noise=noise
        )

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        T = products.product(self.links, values)
        r = so3.log(T[:, :3, :3] @ np.swapaxes(self.measured, -1, -2))
        J = so3.left_jacobian_inverse(r)
        maps = products.link_maps(self.links, values)
        return r, tuple(J @ np.broadcast_to(M, (len(r), 6, 6))[:, :3] for M in maps)


class MeasuredTranslation(Factor):
    """The links' translation against a measured one.

    scale: name of the variable a (1, 1), the target's scale less 1; None where the size is as given.
    """

    def __init__(
        self, name: str, links: Sequence[Link], measured: Array, *, noise: str, scale: str | None = None
    ) -> None:
        self.links, self.scale = tuple(links), scale
        self.measured = np.asarray(measured, dtype=np.float64)[:, :3, 3]
        variables, indices = [c.variable for c in links], [c.indices for c in links]
        if scale is not None:
            variables.append(scale)
            indices.append(np.zeros(len(self.measured), dtype=np.int64))
        super().__init__(name, variables=variables, indices=indices, dim=3, noise=noise)

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        transforms = values[: len(self.links)]
        size = 1.0 if self.scale is None else 1.0 + values[-1]
        T = products.product(self.links, transforms)
        r = T[:, :3, 3] - size * self.measured
        maps = products.link_maps(self.links, transforms)
        jacobians = tuple(np.broadcast_to(M, (len(r), 6, 6))[:, 3:] for M in maps)
        return r, jacobians if self.scale is None else (*jacobians, -self.measured[:, :, None])
