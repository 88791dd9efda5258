"""Hand-eye from data of which up to half may be wrong: RANSAC over triples of poses, guided by screws.

1. Whatever X is, robot and camera turn by the same angle between two poses (Chen, "A screw motion approach to
   uniqueness analysis of head-eye geometry of robots", CVPR 1991: congruent screws). Triples of views whose angles
   agree best are tried, those that turn about well separated axes first: two motions are the fewest that determine X.
2. Each triple gives X in closed form (Park and Martin's rotation, then linear translation). It is judged by the half of
   the views that agree best with it, sum of ln distance + ln angle: no noise level needs to be known.
3. The best are improved by concentration steps (Rousseeuw and Van Driessen, "Computing LTS regression for large data
   sets", 2006); views within the noise of that core are taken in again, each judged by F(6, freedom).

Everything is drawn from a seeded generator: the same data give the same answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import lgamma

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.cell.loop.fit import LoopFit, fit_loop
from calibrant.calibrate.solvers.loop_errors import loop_consistency
from calibrant.calibrate.solvers.relative import odd_part, sample
from calibrant.geometry import se3, so3
from calibrant.optimize.chances import CHI2_6_LIMIT, CHI2_6_MEDIAN, f_tail

TRIPLES = 200
"""Triples solved: with half of the views wrong one in eight is clean, so that none is has a chance of 1e-11; the
congruence of the angles makes it far less."""
DRAWN = 3000
"""Triples looked at for their congruence, before the best are solved."""
MOST_FOR_CONSENSUS = 200
"""Views of a longer session that the search goes over: where at least half of all are right, less than 90 of 200 drawn
are so once in fifteen, and 80 once in five hundred; what is found is then fitted to and judged by every view."""
REFINED = 4
"""Triples refined by concentration steps."""
FLOOR_METRES, FLOOR_RADIANS = 1e-6, 1e-6
"""Differences below a micrometre and a microradian are rounding: no robot repeats better."""
OUTLIER_P = 1e-3
"""Chance that any one of the views of clean data is called an outlier (Bonferroni over the views)."""
TYPICAL_FACTOR = 9.0
"""And its statistic must be nine times the median's, three times the typical deviation: robots err by more than their
Gaussian noise now and then, and a view that deviates twice as much as others is no fault."""

MANY, AGREE = 1 / 3, 0.05
"""More than a third of the views is called outlying only where all views together do not agree, to 5 % of the motion:
noise is not the same in every view, and some views always agree far better among themselves."""


SHARES = (1 / 2, 2 / 5, 3 / 10)
"""Of the views that may be all that agree, the largest first: a triple of the smallest is drawn once in 37."""
LEAST_GROUP = 6
"""Views of a group beside many that disagree. The triple behind it agrees with itself; that three others agree with it
to AGREE of the motion by chance, in all six numbers each, has P = 0.05^18 times the choices of such groups."""


@dataclass(frozen=True, eq=False)
class RobustFit:
    """The loop fitted to the views that agree (`fit.used`), and how far each view is from that.

    p_value (n,): chance of a deviation as large as the view's from noise alone; outlier (n,).
    """

    fit: LoopFit
    p_value: Array
    outlier: NDArray[np.bool_]

    @property
    def X(self) -> Array:
        return self.fit.X[0]

    @property
    def Z(self) -> Array:
        return self.fit.Z[0]


def robust_fit(A: Array, B: Array, *, certainty: Array | None = None, seed: int = 0) -> RobustFit:
    """Fit X and Z to the largest part of the views that agrees.

    Args: A, B (n, 4, 4) of the normal form A_i X B_i = Z, n >= 3, metres; certainty (n,) >= 1, how much less certain
    each view is than a typical one.
    """
    n = len(A)
    c = np.ones(n) if certainty is None else np.maximum(certainty, 1.0)
    rows = sample(n, MOST_FOR_CONSENSUS)
    core = _core(A[rows], B[rows], c[rows], seed)
    if len(rows) < n:
        core = _concentrated(A, B, core.X[0], c, _half(n))
    return _admitted(A, B, core, c)


@dataclass(frozen=True, eq=False)
class Group:
    """The largest part of the views that agrees: members (n,), and the loop over them, rms mm and deg."""

    members: NDArray[np.bool_]
    mm: float
    deg: float

    @property
    def loop_text(self) -> str:
        """The loop in words."""
        return f"{self.mm:.3g} mm / {self.deg:.2g} deg"


def agreeing_group(A: Array, B: Array, *, certainty: Array | None = None, seed: int = 0) -> Group | None:
    """The views that agree with each other where perhaps most agree with nothing; None where no group stands out.

    Args as for `robust_fit`, which takes it that the half of the views agrees.
    """
    n = len(A)
    c = np.ones(n) if certainty is None else np.maximum(certainty, 1.0)
    rows = sample(n, MOST_FOR_CONSENSUS)
    for share in SHARES:
        h = max(LEAST_GROUP, int(share * len(rows)))
        if h > len(rows):
            return None
        starts = consensus(A[rows], B[rows], seed=seed, agreeing=h)
        fits = [_concentrated(A[rows], B[rows], X, c[rows], h) for X in starts]
        core = min(fits, key=lambda fit: float(np.sort(log_misfit(fit.deviation))[:h].sum()))
        if _all_agree(A[rows][core.used], B[rows][core.used], core.X[0]):
            core = _concentrated(A, B, core.X[0], c, max(LEAST_GROUP, int(share * n)))
            return _group(A, B, core, c)
    return None


def _all_agree(A: Array, B: Array, X: Array) -> bool:
    """True where every view is within AGREE of the motion: a single wrong one among many hides from a median."""
    loop = loop_consistency(A, B, X)
    worst = max(
        float(view.max()) / max(median, 1e-12)
        for view, median in ((loop.view_mm, loop.median_mm), (loop.view_deg, loop.median_deg))
    )
    return loop.score * worst < AGREE


def disagreement(n: int, group: Group, others: Sequence[str]) -> str:
    """What is said of n views of which more than a third agree with nothing, and the way out."""
    return (
        f"{int(group.members.sum())} of {n} views agree with each other (their loop closes to {group.loop_text}), the "
        f"other {len(others)} not with them. More than a third is wrong, so the fault is not in single views: check "
        f"how poses and images were recorded. To go on with those that agree: --exclude {','.join(others)}"
    )


def _group(A: Array, B: Array, core: LoopFit, c: Array) -> Group:
    """The core with every view that its noise explains."""
    for _ in range(3):
        squares = np.sum((core.deviation / core.sigmas) ** 2, axis=1)
        typical = float(np.median(squares[core.used])) / CHI2_6_MEDIAN
        members = core.used | (squares / max(typical, 1e-12) < CHI2_6_LIMIT)
        if np.array_equal(members, core.used):
            break
        core = fit_loop(A, B, core.X[0], used=members, certainty=c)
    d = core.deviation[core.used]
    mm = 1e3 * float(np.sqrt(np.mean(np.sum(d[:, 3:] ** 2, axis=1))))
    return Group(core.used, mm, float(np.rad2deg(np.sqrt(np.mean(np.sum(d[:, :3] ** 2, axis=1))))))


def _core(A: Array, B: Array, c: Array, seed: int) -> LoopFit:
    """The fit to the half of the views that agrees best."""
    h = _half(len(A))
    fits = [_concentrated(A, B, start, c, h) for start in consensus(A, B, seed=seed)]
    return min(fits, key=lambda fit: float(np.sort(log_misfit(fit.deviation))[:h].sum()))


def _half(n: int) -> int:
    return max(3, n // 2 + 1)


def consensus(A: Array, B: Array, *, seed: int = 0, triples: int = TRIPLES, agreeing: int | None = None) -> Array:
    """The most promising X (k, 4, 4) of triples of views, the best first, k <= REFINED; agreeing: how many views judge
    them, the half if not said."""
    n = len(A)
    chosen = _triples(A, B, triples, np.random.default_rng(seed))
    X = _solve_triples(A, B, chosen)
    loops = A @ X[:, None] @ B
    h = agreeing or _half(n)
    # The triple's own loops agree with each other: their middle is the hypothesis' centre.
    own = np.take_along_axis(loops, chosen[:, :, None, None], axis=1)
    t = own[..., :3, 3].mean(axis=1)
    R = so3.nearest(own[..., :3, :3].sum(axis=1)).reshape(-1, 1, 9)
    metres = np.linalg.norm(loops[..., :3, 3] - t[:, None], axis=-1)
    chord = np.linalg.norm(loops[..., :3, :3].reshape(len(X), n, 9) - R, axis=-1) / np.sqrt(2)
    misfit = np.log(metres + FLOOR_METRES) + np.log(chord + FLOOR_RADIANS)
    score = np.partition(misfit, h - 1, axis=1)[:, :h].sum(axis=1)
    return X[np.argsort(score, kind="stable")[:REFINED]]


def _distances(a: Array, b: Array) -> Array:
    """Distances (n, m) of rows of a (n, d) and b (m, d)."""
    squares = np.sum(a * a, axis=1)[:, None] + np.sum(b * b, axis=1) - 2 * a @ b.T
    return np.sqrt(np.maximum(squares, 0.0))


def relative_angles(T: Array) -> Array:
    """Angles (n, n) between rotations of T (n, 4, 4), rad, by the chord |R_i - R_j| = 2 sqrt(2) sin(angle / 2)."""
    R = T[:, :3, :3].reshape(-1, 9)
    return 2 * np.arcsin(np.clip(_distances(R, R) / np.sqrt(8), 0, 1))


def _triples(A: Array, B: Array, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Triples (k, 3) of views, k <= count: congruent first, weighed by how well their axes are separated."""
    n = len(A)
    if n * (n - 1) * (n - 2) // 6 <= DRAWN:
        i, j, k = np.meshgrid(*(np.arange(n),) * 3, indexing="ij")
        drawn = np.column_stack([a[(i < j) & (j < k)] for a in (i, j, k)])
    else:
        drawn = np.sort(rng.random((DRAWN, n)).argpartition(3, axis=1)[:, :3], axis=1)
    if len(drawn) <= count:
        return drawn
    mismatch = np.abs(relative_angles(A) - relative_angles(B))
    a, b, c = drawn.T
    worst = np.maximum.reduce([mismatch[a, b], mismatch[b, c], mismatch[a, c]])
    R = A[:, :3, :3]
    first, second = odd_part(np.swapaxes(R[a], 1, 2) @ R[b]), odd_part(np.swapaxes(R[a], 1, 2) @ R[c])
    spread = np.linalg.norm(np.cross(first, second), axis=1)  # zero for parallel axes: nothing is determined
    # Noise of a degree is fine where the axes are well apart: mismatch over spread is what it does to X.
    quality = (worst + np.deg2rad(0.05)) / (np.sqrt(spread) + 1e-6)
    return drawn[np.argsort(quality, kind="stable")[:count]]


def _solve_triples(A: Array, B: Array, triples: NDArray[np.intp]) -> Array:
    """X (k, 4, 4) of each triple: rotation from its three motions, translation by linear least squares."""
    motions_a, motions_b = [], []
    for i, j in ((0, 1), (1, 2), (0, 2)):
        motions_a.append(se3.inverse(A[triples[:, j]]) @ A[triples[:, i]])
        motions_b.append(B[triples[:, j]] @ se3.inverse(B[triples[:, i]]))
    a, b = np.stack(motions_a, axis=1), np.stack(motions_b, axis=1)
    # Odd parts are continuous through half a turn: no branch needs to be chosen.
    odd_a, odd_b = odd_part(a[..., :3, :3]), odd_part(b[..., :3, :3])
    R = so3.nearest(np.swapaxes(odd_a, 1, 2) @ odd_b)
    rows = (a[..., :3, :3] - np.eye(3)).reshape(len(triples), 9, 3)
    known = (np.einsum("kij,kpj->kpi", R, b[..., :3, 3]) - a[..., :3, 3]).reshape(len(triples), 9)
    normal = np.swapaxes(rows, 1, 2) @ rows + 1e-12 * np.eye(3)
    t = np.linalg.solve(normal, np.einsum("kri,kr->ki", rows, known)[..., None])[..., 0]
    return se3.make(R, t)


def log_misfit(d: Array) -> Array:
    """(n,) ln distance + ln angle of deviations (n, 6): the log-likelihood of a view whose noise is not known."""
    squares = d * d
    metres, radians = np.sqrt(squares[:, 3:].sum(axis=1)), np.sqrt(squares[:, :3].sum(axis=1))
    return np.asarray(np.log((metres + FLOOR_METRES) * (radians + FLOOR_RADIANS)))


def _concentrated(A: Array, B: Array, X: Array, c: Array, h: int) -> LoopFit:
    """Fit to the h views that agree best, chosen again until the choice settles."""
    loops = A @ X @ B
    near = sample(len(A), MOST_FOR_CONSENSUS)
    centre = loops[near[int(np.argmin(_distances(loops[near, :3, 3], loops[:, :3, 3]).sum(axis=1)))]]
    used = _nearest(log_misfit(se3.local(centre, loops)), h)
    for _ in range(4):  # settles in two or three
        fit = fit_loop(A, B, X, used=used, certainty=c, steps=2)
        chosen = _nearest(np.sum((fit.deviation / fit.sigmas) ** 2, axis=1), h)
        X = fit.X[0]
        if np.array_equal(chosen, used):
            break
        used = chosen
    return fit


def _nearest(distance: Array, h: int) -> NDArray[np.bool_]:
    used = np.zeros(len(distance), dtype=bool)
    used[np.argsort(distance, kind="stable")[:h]] = True
    return used


def _admitted(A: Array, B: Array, core: LoopFit, c: Array) -> RobustFit:
    """The core with every view taken in that its noise explains."""
    squares = np.sum((core.deviation / core.sigmas) ** 2, axis=1)
    used = core.used | (squares * CHI2_6_MEDIAN / max(float(np.median(squares)), 1e-12) < CHI2_6_LIMIT)
    fit = fit_loop(A, B, core.X[0], used=used, certainty=c)
    for _ in range(6):
        outlier = judged(fit)
        if np.array_equal(~outlier, used) or (~outlier).sum() < max(3, len(A) // 2):
            break
        used = ~outlier
        fit = fit_loop(A, B, fit.X[0], used=used, certainty=c)
    many = (~used).sum() > MANY * len(A)
    agree = many and loop_consistency(A, B, fit_loop(A, B, fit.X[0], certainty=c).X[0]).score < AGREE
    while not used.all() and (chosen_by_chance(fit) or (agree and (~used).sum() > MANY * len(A))):
        # The views left out were chosen for being far off: the least of them goes back.
        used = used.copy()
        left = np.flatnonzero(~used)
        used[left[int(np.argmin(fit.statistic[left]))]] = True
        fit = fit_loop(A, B, fit.X[0], used=used, certainty=c)
    return RobustFit(fit, p_values(fit), ~used)


def noise_freedom(fit: LoopFit) -> float:
    """Numbers left free for either noise level: half of all, as rotations and translations have one each."""
    return max(fit.freedom / 2, 0.5)


def p_values(fit: LoopFit) -> Array:
    """(n,) chance of each view's deviation from noise alone."""
    return f_tail(6, noise_freedom(fit), np.maximum(fit.statistic, 0.0))


def judged(fit: LoopFit) -> NDArray[np.bool_]:
    """Views whose deviation no noise explains."""
    statistic = fit.statistic
    size = np.maximum(
        np.linalg.norm(fit.deviation[:, :3], axis=1) / FLOOR_RADIANS,
        np.linalg.norm(fit.deviation[:, 3:], axis=1) / FLOOR_METRES,
    )
    typical = float(np.median(statistic[fit.used])) if fit.used.any() else 0.0
    far = (p_values(fit) * len(size) < OUTLIER_P) & (statistic > TYPICAL_FACTOR * typical) & (size > 1)
    return np.asarray(far)


def chosen_by_chance(fit: LoopFit) -> bool:
    """True when leaving out the k views that fit worst of n would look like this in clean data too.

    The mean of their statistics is F(6 k, freedom / 2); any k of the n views could have been left out, so p is
    multiplied by the number of choices (Bonferroni).
    """
    n, k = len(fit.used), int((~fit.used).sum())
    mean = float(fit.statistic[~fit.used].mean())
    log_p = float(np.log(max(float(f_tail(6 * k, noise_freedom(fit), mean)), 1e-300)))
    choices = lgamma(n + 1) - lgamma(k + 1) - lgamma(n - k + 1)
    return log_p + choices > np.log(OUTLIER_P)
