"""A camera whose pictures are mirrored, or that sees a flat board from behind: what its views then say of the board.

A detector numbers a board as if it were seen from its front, unmirrored. Where the picture is mirrored (S reflects x of
the camera) the numbers run over the board's reflection M in the middle of its points, and the pose T' that they give is

    T' = S T M,        so that        T = S T' M;

from behind the camera is as it is, and M is half a turn of the board: T = T' M.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.geometry import so3

MIRRORED, BEHIND = "mirrored", "behind"


@dataclass(frozen=True, eq=False)
class Reflected:
    """how: MIRRORED or BEHIND; T (n, 4, 4), C (n, 6, 6), L (n, 6, p): the poses and what they are off by."""

    how: str
    T: Array
    C: Array
    L: Array


def reflections(T: Array, C: Array, L: Array, middle: Array) -> Iterator[Reflected]:
    """The poses T (n, 4, 4) of a camera's views as they are if its pictures are mirrored, and if it looks from behind.

    C, L: as `PairPoses` has them; middle (3,): of the board's points. A board numbered from its other end is reflected
    along its other side: both are tried.
    """
    for how, camera_x, board_z in ((MIRRORED, -1.0, 1.0), (BEHIND, 1.0, -1.0)):
        S = np.diag([camera_x, 1.0, 1.0])
        for axis in (0, 1):
            M = np.eye(4)
            M[axis, axis], M[2, 2] = -1.0, board_z
            M[:3, 3] = middle - M[:3, :3] @ middle
            m = T[:, :3, :3] @ M[:3, 3]
            new = np.tile(np.eye(4), (len(T), 1, 1))
            new[:, :3, :3] = S @ T[:, :3, :3] @ M[:3, :3]
            new[:, :3, 3] = (m + T[:, :3, 3]) @ S
            # In `se3.retract`'s chart: R' <- exp(w) R', t' <- t' + v.
            G = np.zeros((len(T), 6, 6))
            G[:, :3, :3] = np.linalg.det(S) * S
            G[:, 3:, :3] = -S @ so3.hat(m)
            G[:, 3:, 3:] = S
            yield Reflected(how, new, G @ C @ np.swapaxes(G, 1, 2), G @ L)
