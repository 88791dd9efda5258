"""A camera on one robot that sees a target carried by another: A_i X B_i = W C_i Z, three unknowns in closed form.

A_i = T_base_gripper of the robot with the camera, C_i that of the other, B_i = T_camera_target; X = T_gripper_camera,
W = T_base_base', Z = T_gripper'_target (Wang, Wu and Ren 2014, "Towards simultaneous coordinate calibrations for
cooperative multiple robots").

Rotations: for a given Z this is the robot-world problem A_i X (B_i Z^-1 C_i^-1) = W, which a singular value
decomposition solves (Shah 2013); for given X and W, Z is a mean. Both steps lower

    sum_i |R_Ai R_X R_Bi - R_W R_Ci R_Z|^2,

so they alternate until nothing changes, from each of the 24 rotations of a cube as a start. Translations are linear in
what is left.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3

LEAST_VIEWS = 5
"""Nine rotational and nine translational unknowns; five views leave some to tell a wrong minimum by."""
ROUNDS = 200
SETTLED = 1e-9
"""Change of a rotation's entries that ends the rounds: far below any noise."""
INDEPENDENT = 1e-4
"""Least singular value of the translations' equations, over the largest: below, the motions leave a direction open."""


NO_AGREEMENT = 0.1
"""Median rotation, radians, that no robot and no lens explain: robots repeat a hundred times better."""


@dataclass(frozen=True, eq=False)
class HandToHand:
    """X, W, Z and the loop's typical error, radians and metres."""

    X: Array
    W: Array
    Z: Array
    spread: tuple[float, float]


def hand_to_hand_start(A: Array, C: Array, B: Array) -> HandToHand:
    """Closed form from n views: A, C, B (n, 4, 4). Raises: RefusedError for too few, or too little motion."""
    if len(A) < LEAST_VIEWS:
        raise RefusedError(f"{len(A)} usable pictures, at least {LEAST_VIEWS} are needed where both robots move")
    RA, RC, RB = A[:, :3, :3], C[:, :3, :3], B[:, :3, :3]
    found = [_rotations(RA, RC, RB, start) for start in _cube()]
    X, W, Z = min(found, key=lambda r: _misfit(RA, RC, RB, *r))
    tX, tZ, tW = _translations(A, C, B, X, W)
    T = [se3.make(R, t) for R, t in ((X, tX), (W, tW), (Z, tZ))]
    d = se3.local(T[1] @ C @ T[2], A @ T[0] @ B)
    spread = (float(np.median(np.linalg.norm(d[:, :3], axis=1))), float(np.median(np.linalg.norm(d[:, 3:], axis=1))))
    if spread[0] > NO_AGREEMENT:
        raise RefusedError(
            f"robots and camera do not agree: the best fit leaves {np.rad2deg(spread[0]):.0f} deg in the median view; "
            "check how the poses of both robots are meant (inverted? degrees?), which photo belongs to which, and "
            "whether the board looks the same upside down (use one that does not)"
        )
    return HandToHand(T[0], T[1], T[2], spread)


def _rotations(RA: Array, RC: Array, RB: Array, Z: Array) -> tuple[Array, Array, Array]:
    for _ in range(ROUNDS):
        X, W = _robot_world(RA, RB @ np.swapaxes(RC @ Z, -1, -2))
        after = so3.nearest(np.mean(np.swapaxes(W @ RC, -1, -2) @ RA @ X @ RB, axis=0))
        change, Z = float(np.abs(after - Z).max()), after
        if change < SETTLED:
            break
    return X, W, Z


def _robot_world(RA: Array, RB: Array) -> tuple[Array, Array]:
    """X and W of A_i X B_i = W: the singular vectors of sum_i B_i^T (x) A_i, by columns (Shah 2013)."""
    K = np.einsum("nji,nkl->ikjl", RB, RA).reshape(9, 9)
    U, _, Vt = np.linalg.svd(K)
    W, X = U[:, 0].reshape(3, 3).T, Vt[0].reshape(3, 3).T
    # A singular pair is known up to one sign of both.
    sign = np.sign(np.linalg.det(X)) or 1.0
    return so3.nearest(sign * X), so3.nearest(sign * W)


def _misfit(RA: Array, RC: Array, RB: Array, X: Array, W: Array, Z: Array) -> float:
    return float(np.sum((RA @ X @ RB - W @ RC @ Z) ** 2))


def _translations(A: Array, C: Array, B: Array, X: Array, W: Array) -> tuple[Array, Array, Array]:
    """R_A t_X - R_W R_C t_Z - t_W = R_W t_C - t_A - R_A R_X t_B."""
    RA = A[:, :3, :3]
    left = np.concatenate([RA, -W @ C[:, :3, :3], np.tile(-np.eye(3), (len(A), 1, 1))], axis=2).reshape(-1, 9)
    right = (C[:, :3, 3] @ W.T - A[:, :3, 3] - np.einsum("nij,nj->ni", RA @ X, B[:, :3, 3])).ravel()
    size = np.linalg.svd(left, compute_uv=False)
    if size[-1] < INDEPENDENT * size[0]:
        raise RefusedError(
            "both robots turn about the same few axes, which leaves a position open; add poses in which each robot "
            "turns the camera or the target about two other axes"
        )
    t = np.linalg.lstsq(left, right, rcond=None)[0]
    return t[:3], t[3:6], t[6:]


def _cube() -> list[Array]:
    """The 24 rotations that map a cube onto itself: none is farther than 63 degrees from any rotation."""
    out = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            R = np.zeros((3, 3))
            R[range(3), order] = signs
            if np.linalg.det(R) > 0:
                out.append(R)
    return out
