"""How certain a result is of any two of its frames, by the errors that its transforms have in common.

    T_a_c = T_1^(±1) T_2^(±1) … along the path from a to c,   C = J C_joint J^T,   J = d(delta_a_c) / d(delta_1, …)

with every delta along its parent's axes (`se3.retract`), J by central differences.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult
from calibrant.geometry import se3
from calibrant.geometry.frames import FrameGraph

_STEP = 1e-5
"""Radians and metres: the error of central differences is its square."""


def covariance_between(result: CalibrationResult, parent: str, child: str) -> Array | None:
    """The covariance (6, 6) of T_parent_child along the parent's axes; None where the result does not tell it."""
    for t in result.transforms:
        if (t.parent, t.child) == (parent, child):
            return t.covariance
        if (t.parent, t.child) == (child, parent) and t.covariance is not None:
            return _turned(t.matrix, t.covariance)
    joint = result.joint_covariance
    if joint is None:
        return None
    known = {(t.parent, t.child): t.matrix for t in result.transforms}
    graph = FrameGraph()
    for a, b in joint.frames:
        if (a, b) in known:
            graph = graph.add(a, b, known[a, b])
    if not any({parent, child} <= set(group) for group in graph.groups()):
        return None
    return _along([*graph.path(parent, child)], list(joint.frames), known, joint.matrix)


def _turned(T: Array, C: Array) -> Array:
    """Of the inverse."""
    return _propagated([(0, -1)], [T], C)


def _along(path: list[str], frames: list[tuple[str, str]], known: dict[tuple[str, str], Array], joint: Array) -> Array:
    steps: list[tuple[int, int]] = []
    for a, b in pairwise(path):
        forward = (a, b) in known and (a, b) in frames
        steps.append((frames.index((a, b)), 1) if forward else (frames.index((b, a)), -1))
    index = [6 * k + i for k, _ in steps for i in range(6)]
    return _propagated(
        [(n, sign) for n, (_, sign) in enumerate(steps)],
        [known[frames[k]] for k, _ in steps],
        joint[np.ix_(index, index)],
    )


def _propagated(steps: list[tuple[int, int]], T: list[Array], C: Array) -> Array:
    def whole(delta: Array) -> Array:
        out = np.eye(4)
        for k, sign in steps:
            moved = se3.retract(T[k], delta[6 * k : 6 * k + 6])
            out = out @ (moved if sign > 0 else se3.inverse(moved))
        return out

    size = 6 * len(steps)
    at = whole(np.zeros(size))
    columns = [(se3.local(at, whole(e)) - se3.local(at, whole(-e))) / (2 * _STEP) for e in _STEP * np.eye(size)]
    J = np.stack(columns, axis=1)
    return J @ C @ J.T
