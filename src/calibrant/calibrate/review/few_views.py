"""Is it one camera? Asked of three to five views, whose groups are too small to have a scatter of their own.

Let every view have a scale, a shift and a height of its image beside the common lens: that explains T of the squared
residuals with t unknowns, and a group that has one of them alone explains Q of it with q. Where the points of views
err alike, all of T is large, and Q is no more of it than its share:

    F = (Q / q) / max((T - Q) / (t - q), s^2),     s^2 what is left once every view has its own.

That takes scales, shifts and heights to scatter alike, in units of the noise, which is rough: it names, and refuses
nothing.
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.review.splits import CHOICES, Split, all_splits
from calibrant.calibrate.review.view_scores import (
    ASPECT,
    CENTRE,
    ZOOM,
    ViewScores,
    estimate,
    kept_columns,
    only_in,
)
from calibrant.optimize.chances import share_tail

_KNOWN = 1e-9
"""Eigenvalue of a scaled information below which a direction is not determined."""


def parted(scores: ViewScores) -> tuple[float, Split, tuple[str, ...]]:
    """The parting that is least likely, what its groups differ in, and its chance over all tried."""
    squares, unknowns = _explained_by_each(scores)
    left = float(scores.gram[:, -1, -1].sum()) - _common(scores) - squares
    noise = max(left, 0.0) / max(scores.freedom - unknowns, 1)
    splits = all_splits(len(scores))
    found: list[tuple[float, Split, tuple[str, ...]]] = [(1.0, splits[0], CHOICES[0])]
    for own in CHOICES:
        columns, mine = kept_columns(scores, *own)
        q = len(mine)
        for split in splits:
            fit = estimate(scores, columns, only_in(scores, columns, mine, split.second))
            if fit is None or unknowns <= q:
                continue
            explained = fit.chi_square(mine) * scores.sigma_px**2
            chance = share_tail(explained, squares, unknowns=q, freedom=unknowns, least=noise)
            found.append((chance * split.tried * len(CHOICES), split, own))
    return min(found, key=lambda item: item[0])


def _common(scores: ViewScores) -> float:
    """Squares that the common lens explains beside the fit: next to nothing at its optimum."""
    L = scores.lens
    return _quadratic(scores.together[L[:, None], L], scores.together[L, -1])[0]


def _explained_by_each(scores: ViewScores) -> tuple[float, int]:
    """T and t: squares explained, beyond the common lens, by a scale, a shift and a height of every view."""
    E, L = np.concatenate([scores.columns[n] for n in (ZOOM, CENTRE, ASPECT)]), scores.lens
    R, r = scores.together[L[:, None], L].copy(), scores.together[L, -1].copy()
    squares, unknowns = 0.0, 0
    for gram in scores.gram:
        own, across, y = gram[E[:, None], E], gram[E[:, None], L], gram[E, -1]
        root = _root_of_inverse(own)
        squares += float(np.sum((root.T @ y) ** 2))
        unknowns += root.shape[1]
        R -= across.T @ root @ root.T @ across
        r -= across.T @ root @ root.T @ y
    more, rank = _quadratic(R, r, np.diag(scores.together)[L])
    return squares + more - _common(scores), unknowns + rank - len(L)


def _quadratic(A: Array, y: Array, size: Array | None = None) -> tuple[float, int]:
    """y^T A^+ y and the rank of A."""
    root = _root_of_inverse(A, size)
    return float(np.sum((root.T @ y) ** 2)), root.shape[1]


def _root_of_inverse(A: Array, size: Array | None = None) -> Array:
    """B (m, r) with B B^T the inverse of A in the directions that are known. Args: size (m,), of the columns: A's own
    diagonal where it is not given."""
    d = np.diag(A) if size is None else size
    scale = np.where(d > 0, 1 / np.sqrt(np.where(d > 0, d, 1.0)), 0.0)
    values, vectors = np.linalg.eigh(A * scale[:, None] * scale)
    known = values > _KNOWN
    return np.asarray(scale[:, None] * vectors[:, known] / np.sqrt(values[known]))
