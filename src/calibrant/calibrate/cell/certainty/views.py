"""What the points of a view, or a dot of the board in all views, err alike by, in the lens of a cell.

The clusters are those of `intrinsics.shared_errors`, by the influence that every residual has on the lens in the cell
(`optimize.clusters`). A robot's pose is one cluster with what was seen there, since it takes a part of it. The poses'
own share of errors that all points of a view have is in the noise level of the robot, which is found with the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.calibrate.cell.problem.groups import extra_variable, lens_variable, pictures_factor, robot_groups
from calibrant.calibrate.cell.problem.problem import Cell
from calibrant.calibrate.intrinsics.shared_errors import ROUNDING_PX
from calibrant.calibrate.review.residuals import places
from calibrant.data import View
from calibrant.optimize import cluster_kernels
from calibrant.optimize.clusters import (
    Clusters,
    alike_by_place,
    clustered_covariance,
    corrected,
    influence,
    numbered,
    square_root,
)
from calibrant.optimize.solution import Solution

Label = Callable[[Sequence[View]], Indices]
"""Views -> the number (N,) of the cluster of each of their points, laid end to end."""


Edge = tuple[str, View | None]
"""A moment with its view, or the pose alone."""
_Rows = tuple[Array, Array, list[Edge]]
"""Influence (N, d, p), residuals (N, d), and the edges they belong to."""


def lens_shares(cell: Cell, solution: Solution, camera: str, *, sigma_px: float) -> Array | None:
    """What is added to the covariance (p, p) of a lens, natural tangent, by errors that its residuals share.

    None for a lens that is held, and for exact data. sigma_px: the noise of the camera's points.
    """
    lens = lens_variable(camera)
    plain = solution.plain
    C = plain.covariance(lens)
    if sigma_px < ROUNDING_PX or not np.any(C):
        return None
    root, inverse = square_root(C)
    rows = list(_rows(cell, plain, camera, inverse))
    size = cell.roles[camera].camera.image_size
    labels: tuple[Label | None, ...] = (
        None,
        lambda views: np.concatenate([v.point_ids for v in views]),
        lambda views: places(np.concatenate([v.uv for v in views]), size),
    )
    return clustered_covariance(np.zeros_like(C), [_clusters(rows, label, root) for label in labels])


def _rows(cell: Cell, solution: Solution, camera: str, onto: Array) -> Iterator[_Rows]:
    lens = lens_variable(camera)
    edges: list[Edge]
    there = {f.name for f in solution.problem.factors}
    for i, p, _ in cell.lists:
        if p.camera == camera and p.seen is not None and cell.used_views(i):
            edges = [(f"{p.robot}/{m}", v) for m, v in zip(cell.used_ids(i), cell.used_views(i))]
            yield *influence(solution, pictures_factor(i), lens, onto=onto), edges
    if extra_variable(camera) in there:
        edges = [(f"/{v.id}", v) for v in cell.roles[camera].extra]
        yield *influence(solution, extra_variable(camera), lens, onto=onto), edges
    for robot in cell.layout.robots:
        for group in robot_groups(robot):
            if group in there and robot not in cell.free:
                edges = [(f"{robot}/{m}", None) for m in cell.moments(robot)]
                yield *influence(solution, group, lens, onto=onto), edges


def _clusters(rows: list[_Rows], label: Label | None, root: Array) -> Clusters:
    """The clusters of all rows, by moment where there is no label; a pose alone is one by its moment."""
    number: dict[str, int] = {}
    at = [np.array([number.setdefault(m, len(number)) for m, _ in edges], dtype=np.int64) for _, _, edges in rows]
    parts: list[Indices] = []
    for (_, _, edges), mine in zip(rows, at, strict=True):
        views = [v for _, v in edges if v is not None]  # of all edges, or of none
        if label is None:
            parts.append(np.repeat(mine, [len(v) for v in views]) if views else mine)
        else:
            parts.append(label(views) + len(number) if views else mine)
    labels = np.split(numbered(np.concatenate(parts)), np.cumsum([len(part) for part in parts])[:-1])
    count = 1 + max(int(mine.max()) for mine in labels)
    p = root.shape[1]
    sums, G = np.zeros((count, p)), np.zeros((count, p, p))
    alike = np.zeros((p, p))
    for (influences, residuals, edges), mine in zip(rows, labels):
        J = np.ascontiguousarray(influences)
        cluster_kernels.add_rows(J, np.ascontiguousarray(residuals), mine, sums, G)
        seen = [v.uv for _, v in edges if v is not None]
        if seen:
            alike += alike_by_place(J, mine, np.concatenate(seen), count)
    return corrected(sums, G, root=root, alike=alike)
