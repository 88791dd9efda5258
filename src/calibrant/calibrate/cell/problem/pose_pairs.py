"""Target poses that were measured elsewhere: the chain must reproduce T_camera_target.

rotation:     r = log(R_chain R_measured^T), radians, camera axes
translation:  r = t_chain - s t_measured, metres, camera axes; s is the target's scale

The robot's own noise is a part of the problem: an error of the flange's rotation moves the target by its distance from
the flange, which no noise of the measured target pose looks like. Its poses are unknowns, held by what was measured.
Positions of robot and target differ by the same amount along all axes whichever is wrong, so that their noise is one
level; rotations tell each other apart by the lever arm alone, which is short when the target is in the gripper.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.reprojection import links as products
from calibrant.calibrate.reprojection.links import Link
from calibrant.calibrate.solvers.setup import Setup
from calibrant.geometry import so3
from calibrant.optimize.factors import Factor, RotationPrior, TranslationPrior
from calibrant.optimize.manifolds import SE3, Positive, Variable
from calibrant.optimize.problem import Problem

Array = NDArray[np.float64]

TARGET_ROTATION, TARGET_TRANSLATION, FLANGE_ROTATION = "target rotation", "target translation", "flange rotation"
"""Noise of the measured target's rotation (rad), of positions of target and flange alike (m), of the flange's turns."""
SCALE = "target scale"


def pose_pair_problem(
    setup: Setup,
    T_base_gripper: Array,
    B: Array,
    *,
    X: Array,
    Z: Array,
    sigmas: Mapping[str, float],
    free_scale: bool = False,
) -> Problem:
    """The problem over pose pairs T_base_gripper and B = T_camera_target (n, 4, 4); X, Z: where it starts.

    sigmas: levels to start from; without one, the flange's rotations are taken for half as noisy as the target's.
    free_scale: the scale of the target's positions is an unknown too.
    """
    chain = setup.links(np.arange(len(B)))
    levels = {FLANGE_ROTATION: 0.5 * sigmas[TARGET_ROTATION], **sigmas}
    variables = (
        Variable(setup.camera_transform, SE3(), X[None]),
        Variable(setup.target_transform, SE3(), Z[None]),
        Variable("T_base_gripper", SE3(), T_base_gripper),
        Variable(SCALE, Positive(("scale",)), np.ones((1, 1)), constant=not free_scale),
    )
    factors = (
        ChainRotation("loop rotation", chain, B, noise=TARGET_ROTATION),
        ChainTranslation("loop translation", chain, B, scale=SCALE, noise=TARGET_TRANSLATION),
        RotationPrior("flange rotation", "T_base_gripper", T_base_gripper, noise=FLANGE_ROTATION),
        TranslationPrior("flange position", "T_base_gripper", T_base_gripper, noise=TARGET_TRANSLATION),
    )
    return Problem(variables, factors, levels)


class ChainRotation(Factor):
    """The chain's rotation against a measured one."""

    def __init__(self, name: str, chain: Sequence[Link], measured: Array, *, noise: str) -> None:
        self.chain = tuple(chain)
        self.measured = np.asarray(measured, dtype=np.float64)[:, :3, :3]
        super().__init__(
            name, variables=[c.variable for c in chain], indices=[c.indices for c in chain], dim=3, noise=noise
        )

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        T = products.product(self.chain, values)
        r = so3.log(T[:, :3, :3] @ np.swapaxes(self.measured, -1, -2))
        J = so3.left_jacobian_inverse(r)
        maps = products.link_maps(self.chain, values)
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
        T = products.product(self.chain, links)
        r = T[:, :3, 3] - scale * self.measured
        maps = products.link_maps(self.chain, links)
        jacobians = [np.broadcast_to(M, (len(r), 6, 6))[:, 3:] for M in maps]
        return r, (*jacobians, -self.measured[:, :, None])
