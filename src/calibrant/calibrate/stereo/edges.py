"""Lengths of the board as the pair measures them: what a person can hold a ruler to.

The distance between neighbouring points of the board, triangulated, less what it is. Views and board entered the
calibration, so this is no independent test; its mean shows a scale that is off, its rms what one measurement is worth.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.calibrate.stereo.pairs import Seen, triangulated
from calibrant.cameras import Camera
from calibrant.data.details import TriangulatedEdges

SAME_LENGTH = 1.001
"""A thousandth: the distances of a grid's neighbours differ by rounding alone."""


def neighbours(points: Array) -> Indices:
    """Pairs (m, 2) of points (n, 3) that are nearest to one of the two: a grid's edges."""
    if len(points) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    distance = np.linalg.norm(points[:, None] - points, axis=-1)
    np.fill_diagonal(distance, np.inf)
    near = distance <= SAME_LENGTH * distance.min(axis=1)[:, None]
    return np.argwhere(np.triu(near | near.T)).astype(np.int64)


def triangulated_edges(
    pairs: Sequence[Seen], left: Camera, right: Camera, T_left_right: Array
) -> TriangulatedEdges | None:
    """The edges of all pairs together; None where no pair has two points."""
    errors, lengths = [], []
    for pair in pairs:
        edges = neighbours(pair.points)
        if not len(edges):
            continue
        found = triangulated(pair, left, right, T_left_right)
        a, b = edges[np.isfinite(found[edges]).all(axis=(1, 2))].T
        true = np.linalg.norm(pair.points[a] - pair.points[b], axis=1)
        errors.append(np.linalg.norm(found[a] - found[b], axis=1) - true)
        lengths.append(true)
    if not sum(map(len, errors)):
        return None
    off, length = 1e3 * np.concatenate(errors), 1e3 * np.concatenate(lengths)
    return TriangulatedEdges(len(off), float(np.sqrt(np.mean(off**2))), float(off.mean()), float(np.median(length)))
