"""Which three orthogonal directions a scene's edges follow: random sampling, and whether chance could do as well.

An edge of normal n follows direction d where n . d = 0. Two edges give a direction d1 = n_i x n_j, a third one the
second, d2 = n_k x d1, and d3 = d1 x d2. With a focal length s times the reference one, n becomes S n, S = diag(s, s,
1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.vanishing.circles import Circles

GATE = 3.0
"""Sigmas from a direction up to which an edge follows it: 0.3 % of those that do are lost."""
FIRST_EXCESS_PX = 0.5
"""How far an edge may be off its direction before anything is known of the scene: walls and lenses are good to that."""
SENSES_PX = (FIRST_EXCESS_PX, 0.15, 0.05)
"""Excesses to judge hypotheses by: edges that lie near by chance outweigh good ones in the widest sense alone."""
KEPT = 3
"""Hypotheses of each sense that are refined."""
HYPOTHESES = 1500
"""With a third of the edges in each direction two of one and one of another are drawn in 22 % of all trials; with
nine in ten edges following none, still in one of 4500: scenes like that are not worth an answer."""
LONGEST = 150
"""Edges that hypotheses are drawn from: long ones say most."""
FOCAL_GRID = 2.0 ** np.arange(-2, 3.01, 0.25)
"""Focal lengths to try, of the reference (the image's larger side): 127 to 7 degrees of view, a fifth apart."""
SEED = 0


@dataclass(frozen=True, eq=False)
class Found:
    """R_camera_scene (3, 3), its columns the directions, and the focal length over the reference's.

    excess_px: the sense in which most edges follow it; score: how many points of edges do.
    """

    R_camera_scene: Array
    focal: float
    excess_px: float
    score: float


def search(circles: Circles, *, sigma_px: float, focal: Array) -> tuple[Found, ...]:
    """The directions that most edges follow, in a wide sense and in narrower ones, the best few of each.

    Args: focal, the focal lengths to try over the reference's.
    """
    rng = np.random.default_rng(SEED)
    trials = max(HYPOTHESES // len(focal), 300)
    kept: dict[float, list[Found]] = {excess: [] for excess in SENSES_PX}
    for s in focal.tolist():
        R = _hypotheses(scaled_normals(circles, s), trials, rng)
        for excess, score in zip(SENSES_PX, _scores(circles, R, s, sigma_px)):
            top = np.argsort(-score, kind="stable")[:KEPT]
            kept[excess] += [Found(R[i], s, excess, float(score[i])) for i in top]
    return tuple(f for found in kept.values() for f in sorted(found, key=lambda f: -f.score)[:KEPT])


def scaled_normals(circles: Circles, s: float) -> Array:
    """S n (m, 3), not normalised."""
    return circles.normals * np.array([s, s, 1.0])


def whitened(circles: Circles, directions: Array, s: float) -> tuple[Array, Array]:
    """n . d and its sigma for 1 px of noise a point, of each edge and direction (…, 3): two (m, …)."""
    v = directions * np.array([s, s, 1.0])
    r = np.tensordot(circles.normals, v, axes=(1, -1))
    variance = np.einsum("mij,...i,...j->m...", circles.covariance, v, v, optimize=True)
    return r, np.sqrt(np.maximum(variance, 1e-30))


def spread(circles: Circles, sigma_px: float, excess_px: float) -> Array:
    """Noise (m,) of an edge in the unit of `whitened`: that of its points, and what all its points have in common."""
    return np.sqrt(sigma_px**2 + excess_px**2 * circles.counts)


def _hypotheses(normals: Array, trials: int, rng: np.random.Generator) -> Array:
    """Rotations (h, 3, 3) of random triples among the longest edges."""
    n = normals[:LONGEST] / np.linalg.norm(normals[:LONGEST], axis=1, keepdims=True)
    i, j, k = rng.integers(0, len(n), (3, trials))
    d1 = np.cross(n[i], n[j])
    length = np.linalg.norm(d1, axis=1)
    d1 = d1 / np.maximum(length, 1e-12)[:, None]
    d2 = np.cross(n[k], d1)
    other = np.linalg.norm(d2, axis=1)
    # Two edges of one line, or a third one that follows the first direction too, leave the others open.
    good = (length > 1e-2) & (other > 1e-2)
    if not good.any():
        return np.eye(3)[None]
    d1, d2 = d1[good], d2[good] / other[good][:, None]
    return np.stack([d1, d2, np.cross(d1, d2)], axis=-1)


def _scores(circles: Circles, R: Array, s: float, sigma_px: float) -> Array:
    """Points of the edges that follow one of three directions, less the nearer they are to the gate: (senses, h)."""
    r, unit = whitened(circles, np.swapaxes(R, -1, -2), s)
    nearest = np.min(np.abs(r) / unit, axis=2)
    noise = np.array([spread(circles, sigma_px, excess) for excess in SENSES_PX])
    return np.array([circles.counts @ np.maximum(1 - (nearest / n[:, None] / GATE) ** 2, 0.0) for n in noise])


def chance_log10(followers: int, candidates: int, tests: float, share: float) -> float:
    """log10 of how many directions as well followed chance would show: tests times a binomial tail.

    share: the part of random edges that passes within the gate (Desolneux, Moisan and Morel 2000, "Meaningful
    alignments").
    """
    from scipy.stats import binom

    tail = float(binom.logsf(followers - 1, candidates, min(share, 1.0))) if followers > 0 else 0.0
    return float(np.log10(max(tests, 1.0)) + tail / np.log(10))
