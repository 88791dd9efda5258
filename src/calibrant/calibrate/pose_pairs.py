"""Factors for target poses that were measured elsewhere: the chain must reproduce T_camera_target.

rotation:     r = log(R_chain R_measured^T), radians, camera axes
translation:  r = t_chain - s t_measured, metres, camera axes; s is the target's scale
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate import chain as chains
from calibrant.calibrate.chain import Link
from calibrant.geometry import so3
from calibrant.optimize.factors import Factor

Array = NDArray[np.float64]


class ChainRotation(Factor):
    """The chain's rotation against a measured one."""

    def __init__(self, name: str, chain: Sequence[Link], measured: Array, *, noise: str) -> None:
        self.chain = tuple(chain)
        self.measured = np.asarray(measured, dtype=np.float64)[:, :3, :3]
        super().__init__(
            name, variables=[c.variable for c in chain], indices=[c.indices for c in chain], dim=3, noise=noise
        )

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        T = chains.product(self.chain, values)
        r = so3.log(T[:, :3, :3] @ np.swapaxes(self.measured, -1, -2))
        J = so3.left_jacobian_inverse(r)
        maps = chains.link_maps(self.chain, values)
        return r, tuple(J @ np.broadcast_to(M, (len(r), 6, 6))[:, :3] for M in maps)


class ChainTranslation(Factor):
    """The chain's translation against a measured one, times the target's scale (a variable of one component)."""

    def __init__(self, name: str, chain: Sequence[Link], measured: Array, *, scale: str, noise: str) -> None:
        self.chain = tuple(chain)
        self.measured = np.asarray(measured, dtype=np.float64)[:, :3, 3]
        zeros = np.zeros(len(self.measured), dtype=np.int64)
        super().__init__(
            name,
            variables=[*(c.variable for c in chain), scale],
            indices=[*(c.indices for c in chain), zeros],
            dim=3,
            noise=noise,
        )

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        *links, scale = values
        T = chains.product(self.chain, links)
        r = T[:, :3, 3] - scale * self.measured
        maps = chains.link_maps(self.chain, links)
        jacobians = [np.broadcast_to(M, (len(r), 6, 6))[:, 3:] for M in maps]
        return r, (*jacobians, -self.measured[:, :, None])
