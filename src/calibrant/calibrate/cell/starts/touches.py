"""Where tips, points and targets begin that touches tell of, from what the pictures have placed.

T_root_base (R_i p + t_i) = T_root_target q_i     linear in p for a target that is placed, and in (p, c) for points;
                                                  for a tip that is known, the rigid fit of the target's places.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.problem.layout import Layout
from calibrant.calibrate.cell.problem.touches import Touches
from calibrant.geometry import se3
from calibrant.geometry.frames import FrameGraph

WEAK = 1e-3
"""Least singular value over the square root of the touches, as `calibrate.tool.tip` has it."""
LEAST_ACROSS = 1e-3
"""Second singular value over the first below which touched places lie on a line."""


def touched_start(layout: Layout, graph: FrameGraph) -> FrameGraph:
    """The graph with tips, points and targets that touches place; those that they do not are not in it."""
    left = list(dict.fromkeys(layout.tip(t) for t in layout.touches))
    while True:
        before = graph
        for tip in left:
            mine = [t for t in layout.touches if layout.tip(t) == tip]
            graph = _tip(layout, graph, mine)
            graph = _targets(layout, graph, mine)
        if graph is before:
            return graph


def _tip(layout: Layout, graph: FrameGraph, mine: Sequence[Touches]) -> FrameGraph:
    """A tip and the points that it touches, by all of its touches whose target is placed."""
    tip = layout.tip(mine[0])
    useful = [t for t in mine if _reaches(layout, graph, t) and (not t.target or _there(graph, *layout.touched(t)))]
    points = list(dict.fromkeys(layout.touched(t) for t in useful if not t.target))
    if not useful or (_there(graph, *tip) and all(_there(graph, *p) for p in points)):
        return graph
    width = 3 + 3 * len(points)
    rows, right = [], []
    for t in useful:
        T, n = _grippers(layout, graph, t), len(t.ids)
        A = np.zeros((n, 3, width))
        A[:, :, :3] = T[:, :3, :3]
        if t.target:
            on = se3.apply(graph.T(*layout.touched(t)), t.places)
        else:
            k = 3 + 3 * points.index(layout.touched(t))
            A[:, :, k : k + 3] = -np.eye(3)
            on = np.zeros((n, 3))
        rows.append(A.reshape(-1, width))
        right.append((on - T[:, :3, 3]).ravel())
    A, b = np.concatenate(rows), np.concatenate(right)
    if len(A) < width or np.linalg.svd(A, compute_uv=False)[-1] < WEAK * np.sqrt(len(A) / 3):
        return graph
    x = np.linalg.lstsq(A, b, rcond=None)[0]
    for k, frame in enumerate([tip, *points]):
        if not _there(graph, *frame):
            graph = graph.add(*frame, se3.make(np.eye(3), x[3 * k : 3 * k + 3]))
    return graph


def _targets(layout: Layout, graph: FrameGraph, mine: Sequence[Touches]) -> FrameGraph:
    """Targets that a known tip touches at three places or more that are on no line."""
    tip = layout.tip(mine[0])
    for frame in dict.fromkeys(layout.touched(t) for t in mine if t.target):
        lists = [t for t in mine if layout.touched(t) == frame and _reaches(layout, graph, t)]
        if not lists or not _there(graph, *tip) or _there(graph, *frame):
            continue
        places = np.concatenate([t.places for t in lists])
        spread = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
        if len(places) >= 3 and spread[1] > LEAST_ACROSS * spread[0]:
            p = graph.T(*tip)[:3, 3]
            tips = np.concatenate([se3.apply(_grippers(layout, graph, t), p) for t in lists])
            graph = graph.add(*frame, se3.carrying(places, tips))
    return graph


def _grippers(layout: Layout, graph: FrameGraph, t: Touches) -> Array:
    """T_root_gripper (n, 4, 4) of touches."""
    base = layout.base(t.robot)
    T = layout.robots[t.robot].only(t.ids).T_base_gripper
    return T if base == layout.root else graph.T(layout.root, base) @ T


def _reaches(layout: Layout, graph: FrameGraph, t: Touches) -> bool:
    return layout.base(t.robot) == layout.root or _there(graph, layout.root, layout.base(t.robot))


def _there(graph: FrameGraph, parent: str, child: str) -> bool:
    return any(parent in group and child in group for group in graph.groups())
