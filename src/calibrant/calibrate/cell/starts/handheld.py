"""The closed-form start of a rig: cameras fixed to each other that see one handheld target at the same moments.

Every camera is calibrated alone; pairs of cameras that saw a target at the same moments give their relative pose,
T_a_b = T_a_target T_b_target^-1; the pairs with the most shared moments form a spanning tree that leads from the
reference camera to every other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.problem.layout import Frame, Layout
from calibrant.calibrate.cell.problem.problem import moments_by_hand
from calibrant.calibrate.cell.problem.views import HandEyeViews
from calibrant.calibrate.cell.starts.medoid import robust_mean
from calibrant.errors import RefusedError
from calibrant.geometry import se3

Moment = tuple[str, str]
"""A target's frame, and the moment."""
Poses = Mapping[str, Mapping[Moment, Array]]
"""T_camera_target by camera and moment."""


@dataclass(frozen=True, eq=False)
class CameraPair:
    """Two cameras that saw a target at the same moments, and their relative pose from those."""

    a: str
    b: str
    shared: int
    T_a_b: Array


def handheld_start(layout: Layout, data: Sequence[HandEyeViews]) -> tuple[dict[Frame, Array], tuple[CameraPair, ...]]:
    """The cameras' places (4, 4) in the root, the handheld targets' (m, 4, 4) by moment, and the pairs that led there.

    Raises: RefusedError naming the cameras that share no moment with the rest.
    """
    poses = _poses_by_moment(layout, data)
    T_root: dict[str, Array] = {layout.root: np.eye(4)}
    tree: list[CameraPair] = []
    while len(T_root) < len(poses):
        pair = _best_pair(poses, T_root)
        if pair is None:
            apart = ", ".join(n for n in poses if n not in T_root)
            raise RefusedError(
                f"the rig falls apart: {apart} saw the target at no moment together with {', '.join(T_root)}; "
                "take pictures in which both see the board, or check that simultaneous views carry the same moment"
            )
        T_root[pair.b] = T_root[pair.a] @ pair.T_a_b
        tree.append(pair)
    places: dict[Moment, Array] = {}
    for camera, by_moment in poses.items():
        # One camera's word is start enough: they differ by less than a step of the refinement.
        places = dict(zip(by_moment, T_root[camera] @ np.stack(list(by_moment.values())))) | places
    transforms = {(root, camera): T_root[camera] for root, camera in layout.unknown}
    for root, target in layout.handheld:
        transforms[root, target] = np.stack([places[target, m] for m in moments_by_hand(layout, data, target)])
    return transforms, tuple(tree)


def _poses_by_moment(layout: Layout, data: Sequence[HandEyeViews]) -> Poses:
    poses: dict[str, dict[Moment, Array]] = {camera: {} for camera in layout.cameras}
    for p, d in zip(layout.pictures, data):
        frame = layout.target(p)
        poses[p.camera] |= {(frame, m): T for m, T, use in zip(d.ids, d.B, d.use) if use}
    return poses


def _best_pair(poses: Poses, placed: Mapping[str, Array]) -> CameraPair | None:
    """The camera not placed yet that shares the most moments with a placed one."""
    best: tuple[str, str, list[Moment]] | None = None
    for a in placed:
        for b in poses:
            if b in placed:
                continue
            shared = [m for m in poses[a] if m in poses[b]]
            if shared and (best is None or len(shared) > len(best[2])):
                best = (a, b, shared)
    if best is None:
        return None
    a, b, shared = best
    Ta, Tb = (np.stack([poses[n][m] for m in shared]) for n in (a, b))
    return CameraPair(a, b, len(shared), robust_mean(Ta @ se3.inverse(Tb)))
