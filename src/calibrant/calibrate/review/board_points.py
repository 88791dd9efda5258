"""Points of the board that are off their places, alike in every view: errors of the print, of tiles, of cut sheets.

u_v (2 p,) holds a view's residuals as displacements on the board's plane, each point over the precision that all views
have of it. Errors that repeat make u_v . u_w positive for pairs of views. On a perfect board the sign of a view is
free, so that S = sum over pairs of u_v . u_w has the mean 0 and the variance sum of (u_v . u_w)^2, whatever the points
of a view have in common. The chance is that of a chi-square whose freedom nu = (tr K)^2 / tr K^2 counts the patterns.

Displacements themselves are found with the lens, each drawn towards 0 by its own spread (a Gaussian prior of the level
that the pattern has beyond noise), so that what they do to the lens is known too.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.calibrate.review.view_scores import (
    POSE,
    Rows,
    ViewScores,
    estimate,
    kept_columns,
    lens_shift,
)
from calibrant.optimize.chances import chi2_tail, f_tail
from calibrant.optimize.clusters import numbered

CHANCE = 1e-3
"""One false word in a thousand boards; the chance is bounded from above, so that there are fewer."""
_MOST_POINTS = 500
"""Of a board: its points are unknowns together, and a thousand unknowns take a second."""
_FEWEST_VIEWS = 5


@dataclass(frozen=True, eq=False)
class BoardPoints:
    """chance of a pattern as strong on a perfect board; rms_mm of the displacements beyond noise, the worst point's id
    and size, sigma_mm of one; left_out: ids of points that the fit left out in most of their views; shift: squared
    shift of the lens over its sigma, per parameter, once the points are free, and the shift itself, (k,)."""

    chance: float
    limit: float
    left_out: tuple[int, ...]
    rms_mm: float
    worst: int
    worst_mm: float
    sigma_mm: float
    shift: float
    moved: Array | None = None


def board_points(rows: Rows, scores: ViewScores, real: tuple[str, ...]) -> BoardPoints | None:
    """The question, answered beside the faults that are real; None where there are too few views or too many points."""
    n = len(scores)
    ids = np.concatenate([v.point_ids for v in rows.views])
    index = numbered(ids)
    labels = np.zeros(int(index.max()) + 1, dtype=np.int64)
    labels[index] = ids
    if n < _FEWEST_VIEWS or len(labels) > _MOST_POINTS:
        return None
    residual = scores.X[-1] if not real else _beside(scores, rows, real)
    seen = np.bincount(index, minlength=len(labels))
    lost = np.bincount(index, weights=rows.weight == 0, minlength=len(labels))
    left_out = tuple(labels[(seen >= _FEWEST_VIEWS) & (lost > 0.5 * seen)].tolist())
    J, (aa, ab, bb), turned, displacement = _displacements(rows, scores, residual, index, len(labels))
    # Two questions: all points together, and each by itself.
    chance = 2 * min(_repeats(turned), _stands_out(turned.reshape(n, -1, 2), seen))
    variance = 0.5 * scores.sigma_px**2 * (aa + bb) / np.maximum(aa * bb - ab**2, np.finfo(float).tiny)
    tau2 = max(float(np.mean(np.sum(displacement**2, axis=1) / 2 - variance)), 0.0)
    if chance > CHANCE or tau2 == 0:
        return BoardPoints(chance, CHANCE, left_out, 1e3 * float(np.sqrt(tau2)), 0, 0.0, 0.0, 0.0)
    lengths = np.linalg.norm(displacement, axis=1)
    worst = int(np.argmax(lengths))
    moved = _shift_of_lens(rows, scores, real, index, J, tau2)
    return BoardPoints(
        chance,
        CHANCE,
        left_out,
        1e3 * float(np.sqrt(tau2)),
        int(labels[worst]),
        1e3 * float(lengths[worst]),
        1e3 * float(np.sqrt(variance[worst])),
        lens_shift(scores, moved),
        moved,
    )


def _displacements(
    rows: Rows, scores: ViewScores, residual: Array, index: Indices, points: int
) -> tuple[Array, tuple[Array, Array, Array], Array, Array]:
    """J (2, N, 2), pixels by displacements along the board's x and y; the entries of each point's information
    [[aa, ab], [ab, bb]]; turned (n, 2 points), the views' scores over its root; displacement (points, 2), metres."""
    counts, place = np.diff(rows.stacked.offsets), scores.X[POSE - 3 : POSE]
    axes = np.repeat(rows.T_camera_target[:, :3, :2].reshape(-1, 6).T, counts, axis=1)
    a, b = (place[0] * axes[k] + place[1] * axes[2 + k] + place[2] * axes[4 + k] for k in (0, 1))
    each = (a * residual, b * residual, a * a, a * b, b * b)
    sa, sb, aa, ab, bb = (product[0] + product[1] for product in each)
    Sa, Sb, AA, AB, BB = (_summed(index, w, points) for w in (sa, sb, aa, ab, bb))
    floor = 1e-9 * max(float(AA.max() + BB.max()), np.finfo(float).tiny)
    AA, BB = AA + floor, BB + floor
    first = np.sqrt(AA)
    below = AB / first
    second = np.sqrt(np.maximum(BB - below**2, floor))
    ua = sa / first[index]
    ub = (sb - below[index] * ua) / second[index]
    turned = np.zeros((len(scores), points, 2))
    turned[rows.view, index, 0], turned[rows.view, index, 1] = ua, ub
    determinant = (first * second) ** 2
    displacement = np.column_stack([AB * Sb - BB * Sa, AB * Sa - AA * Sb]) / determinant[:, None]
    return np.stack([a, b], axis=-1), (AA, AB, BB), turned.reshape(len(scores), -1), displacement


def _summed(index: Indices, values: Array, points: int) -> Array:
    return np.asarray(np.bincount(index, weights=values, minlength=points), dtype=np.float64)


def _stands_out(turned: Array, seen: Indices) -> float:
    """Chance of any point as far off in its views' mean, by Hotelling's T^2. Args: turned (n, p, 2), seen (p,)."""
    total = turned.sum(axis=0)
    V = np.einsum("npi,npj->pij", turned, turned)
    V += np.eye(2) * max(1e-9 * float(np.einsum("pii->p", V).max()), np.finfo(float).tiny)
    share = np.einsum("pi,pi->p", total, np.linalg.solve(V, total[:, :, None])[..., 0])
    n = np.maximum(seen, 3)
    F = (n - 2) / 2 * share / np.maximum(n - share, np.finfo(float).eps)
    # The largest of the points that equally many views saw has the smallest chance.
    counts = np.unique(n[n >= _FEWEST_VIEWS]).tolist()
    return min((float(f_tail(2, m - 2, F[n == m].max())) for m in counts), default=1.0) * len(seen)


def _repeats(turned: Array) -> float:
    """Chance of views as much alike."""
    K = turned @ turned.T
    pairs = K[np.triu_indices(len(K), 1)]
    spread = float(np.sqrt(np.sum(pairs**2)))
    if spread == 0:
        return 1.0
    z = float(pairs.sum()) / spread
    freedom = float(np.trace(K)) ** 2 / float(np.sum(K**2))
    return chi2_tail(freedom, max(freedom + z * np.sqrt(2 * freedom), 0.0))


def _beside(scores: ViewScores, rows: Rows, real: tuple[str, ...]) -> Array:
    """Residuals (2, N) once the faults found, and the lens and the poses with them, are taken out."""
    columns, _ = kept_columns(scores, *real)
    found = estimate(scores, columns)
    if found is None:
        return scores.X[-1]
    moved = scores.X[-1] + np.tensordot(found.value, scores.X[POSE + columns], axes=1)
    out = np.empty_like(moved)
    for a, b in pairwise(rows.stacked.offsets.tolist()):
        pose = scores.X[:POSE, :, a:b].reshape(POSE, -1)
        r = moved[:, a:b].reshape(-1)
        out[:, a:b] = (r - pose.T @ np.linalg.lstsq(pose.T, r, rcond=None)[0]).reshape(2, -1)
    return out


def _shift_of_lens(
    rows: Rows, scores: ViewScores, real: tuple[str, ...], index: Indices, J: Array, tau2: float
) -> Array:
    """What free points do to the lens, (k,): lens, faults, points are one problem, every pose projected out."""
    columns = kept_columns(scores, *real)[0] if real else scores.lens
    k, p = len(columns), int(index.max()) + 1
    A, y = np.zeros((k + 2 * p, k + 2 * p)), np.zeros(k + 2 * p)
    for a, b in pairwise(rows.stacked.offsets.tolist()):
        at = (k + 2 * index[a:b, None] + np.arange(2)).ravel()
        where = np.concatenate([np.arange(k), at])
        pose = scores.X[:POSE, :, a:b].reshape(POSE, -1).T
        lens = scores.X[POSE + columns, :, a:b].reshape(k, -1).T
        m = b - a
        dots = np.zeros((2, m, m, 2))
        dots[:, np.arange(m), np.arange(m)] = J[:, a:b]
        block = np.column_stack([lens, dots.reshape(2 * m, 2 * m)])
        basis = np.linalg.qr(pose)[0]
        block -= basis @ (basis.T @ block)
        r = scores.X[-1, :, a:b].reshape(-1)
        A[np.ix_(where, where)] += block.T @ block
        y[where] += block.T @ r
    before = np.linalg.solve(A[:k, :k], y[:k])
    A[np.arange(k, k + 2 * p), np.arange(k, k + 2 * p)] += scores.sigma_px**2 / tau2
    scale = 1 / np.sqrt(np.diag(A))
    found = scale * np.linalg.solve(A * scale[:, None] * scale, scale * y)
    return np.asarray(before - found[:k], dtype=np.float64)[: len(scores.lens)]
