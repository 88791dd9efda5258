"""The closed-form start of a problem with several cameras and robots: each list of pictures alone, then joined.

Pictures with a robot between camera and target are a hand-eye problem A_i X B_i = Z of their own; the transforms that
these give are the edges of a graph, in which every unknown is a path. A camera whose own motions determine nothing
(few pictures, one place) is found through a target that another camera has found, X = A_i^-1 Z B_i^-1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.cell.problem.layout import HAND_TO_HAND, STANDING, Frame, Layout, Pictures
from calibrant.calibrate.cell.starts.hand_to_hand import hand_to_hand_start
from calibrant.calibrate.cell.starts.seed import best_seed
from calibrant.calibrate.cell.views import HandEyeViews
from calibrant.calibrate.solvers.motion import motion_report
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.geometry.frames import FrameGraph

Array = NDArray[np.float64]

LEVEL_START = (1e-3, 1e-3)
"""A milliradian and a millimetre: where no list of pictures tells by itself how well its loop closes."""


@dataclass(frozen=True, eq=False)
class SeveralStart:
    """Transforms by (parent, child); the data without gross outliers; spread: the loop's typical error, rad and m."""

    transforms: dict[Frame, Array]
    data: tuple[HandEyeViews, ...]
    spread: tuple[float, float]


def several_start(layout: Layout, data: Sequence[HandEyeViews]) -> SeveralStart:
    """Raises: RefusedError naming what no path leads to, and why the pictures that could tell do not."""
    graph = FrameGraph(tolerance_m=np.inf, tolerance_rad=np.inf)
    cleaned = list(data)
    refused: dict[int, str] = {}
    spreads = []
    # The longest list first: of two ways to a frame the first one stays.
    order = sorted(range(len(data)), key=lambda i: -int(data[i].use.sum()))
    for i in order:
        p = layout.pictures[i]
        if p.setup == STANDING:
            graph = graph.add(p.camera, layout.target(p), _middle(data[i].B[data[i].use]))
            continue
        try:
            if p.setup == HAND_TO_HAND:
                found = hand_to_hand_start(*_both_arms(layout, p, data[i]))
                spreads.append(found.spread)
                edges = _hand_to_hand_edges(layout, p)
                graph = _add(graph, edges, (found.X, found.W, found.Z))
                continue
            X, Z, cleaned[i], spread = _alone(p, data[i])
        except RefusedError as error:
            refused[i] = str(error)
            continue
        spreads.append(spread)
        graph = _add(graph, layout.constants(p), (X, Z))
    graph = _through_others(layout, cleaned, graph, refused)
    transforms = {}
    # Robots first: where nothing ties them, that is what a person has to know.
    for parent, child in reversed(layout.unknown):
        if not _connected(graph, parent, child):
            raise RefusedError(_missing(layout, parent, child, refused))
        transforms[parent, child] = graph.T(parent, child)
    median = np.median(np.array(spreads), axis=0) if spreads else np.array(LEVEL_START)
    transforms = {f: transforms[f] for f in layout.unknown}
    return SeveralStart(transforms, tuple(cleaned), (float(median[0]), float(median[1])))


def _add(graph: FrameGraph, edges: Sequence[Frame], transforms: Sequence[Array]) -> FrameGraph:
    for (parent, child), T in zip(edges, transforms):
        graph = graph.add(parent, child, T)
    return graph


def _both_arms(layout: Layout, p: Pictures, data: HandEyeViews) -> tuple[Array, Array, Array]:
    """A, C and B of the used views of a camera on one robot and a target on another."""
    other = layout.robots[p.other]
    index = {name: k for k, name in enumerate(other.ids)}
    C = other.T_base_gripper[[index[i] for i, use in zip(data.ids, data.use) if use]]
    return data.T_base_gripper[data.use], C, data.B[data.use]


def _hand_to_hand_edges(layout: Layout, p: Pictures) -> tuple[Frame, Frame, Frame]:
    """Camera in gripper, the other robot's base in this one's, target in the other's gripper."""
    return (
        (layout.gripper(p.robot), p.camera),
        (layout.base(p.robot), layout.base(p.other)),
        (layout.gripper(p.other), layout.target(p)),
    )


def _alone(p: Pictures, data: HandEyeViews) -> tuple[Array, Array, HandEyeViews, tuple[float, float]]:
    """X and Z of one list of pictures. Raises: RefusedError for motions or views that determine nothing."""
    setup, used = get_setup(p.setup), data.use
    if used.sum() < 3:
        raise RefusedError(f"{int(used.sum())} usable pictures, at least 3 are needed")
    A, B = setup.normal_form(data.T_base_gripper[used]), data.B[used]
    motion_report(A, B, frame=setup.camera_parent).require_determined()
    seed = best_seed(A, B, certainty=data.certainty[used])
    if not seed.keep.all():
        dropped = np.zeros(len(data), dtype=bool)
        dropped[np.flatnonzero(used)[~seed.keep]] = True
        reason = "its robot pose and its image disagree with the others: a wrong pose, a wrong image or a misread board"
        data = data.without(dropped, [reason] * len(data))
    return seed.X, seed.Z, data, (np.deg2rad(seed.loop.median_deg), 1e-3 * seed.loop.median_mm)


def _through_others(
    layout: Layout, data: Sequence[HandEyeViews], graph: FrameGraph, refused: dict[int, str]
) -> FrameGraph:
    """Cameras and targets that only another camera's or target's place tells, until nothing more is found."""
    left = set(refused)
    while True:
        before = set(left)
        for i in sorted(left):
            p, used = layout.pictures[i], data[i].use
            if not used.any():
                continue
            if p.setup == HAND_TO_HAND:
                graph, done = _third(layout, p, data[i], graph)
                left -= {i} if done else set()
                continue
            (at, camera), (on, target) = layout.constants(p)
            A, B = get_setup(p.setup).normal_form(data[i].T_base_gripper[used]), data[i].B[used]
            if _connected(graph, on, target):
                X = se3.inverse(A) @ graph.T(on, target) @ se3.inverse(B)
                graph = graph.add(at, camera, _middle(X))
            elif _connected(graph, at, camera):
                graph = graph.add(on, target, _middle(A @ graph.T(at, camera) @ B))
            else:
                continue
            left.discard(i)
        if left == before:
            return graph


def _third(layout: Layout, p: Pictures, data: HandEyeViews, graph: FrameGraph) -> tuple[FrameGraph, bool]:
    """With two of X, W, Z of A_i X B_i = W C_i Z known by other pictures, the third; and whether that was so."""
    A, C, B = _both_arms(layout, p, data)
    edges = _hand_to_hand_edges(layout, p)
    known = [graph.T(*e) if _connected(graph, *e) else None for e in edges]
    X, W, Z = known
    if X is not None and W is not None and Z is None:
        return graph.add(*edges[2], _middle(se3.inverse(W @ C) @ A @ X @ B)), True
    if X is not None and Z is not None and W is None:
        return graph.add(*edges[1], _middle(A @ X @ B @ se3.inverse(C @ Z))), True
    if W is not None and Z is not None and X is None:
        return graph.add(*edges[0], _middle(se3.inverse(A) @ W @ C @ Z @ se3.inverse(B))), True
    return graph, all(T is not None for T in known)


def _middle(T: Array) -> Array:
    """The one of transforms (n, 4, 4) that is nearest to all: a wrong one does not move it.

    Distances add metres and radians: at a metre's distance one weighs as much as the other.
    """
    angle = so3.log(T[:, None, :3, :3] @ np.swapaxes(T[None, :, :3, :3], -1, -2))
    distance = np.linalg.norm(angle, axis=-1) + np.linalg.norm(T[:, None, :3, 3] - T[None, :, :3, 3], axis=-1)
    return np.asarray(T[int(np.argmin(distance.sum(axis=1)))])


def _connected(graph: FrameGraph, parent: str, child: str) -> bool:
    return any(parent in group and child in group for group in graph.groups())


def _missing(layout: Layout, parent: str, child: str, refused: dict[int, str]) -> str:
    reasons = "; ".join(f"{layout.pictures[i].words}: {text}" for i, text in refused.items())
    if reasons:
        return f"nothing tells where {child} is in {parent}: {reasons}"
    return (
        f"nothing ties {child} to {parent}: the robots share neither a camera that sees what both carry nor a target "
        "that both see; add pictures that do, or calibrate them apart"
    )
