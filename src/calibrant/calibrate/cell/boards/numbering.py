"""Which end each view of a symmetric board is numbered from, told by the motion of the robot.

A board that looks the same when it is turned by 2 pi / k about its normal is numbered by what is up in each image: with
G the turn, view i shows B_i or any B_i G^s. Rotations alone decide,

    R_A_i R_X R_B_i G^(s_i) = R_Z   for all i,    s_i in 0 .. k - 1,

so neither the unit of length nor the middle of the board matters. No majority needs to be numbered alike:

1. Whatever X is, angle(R_A_j^T R_A_i) = angle(R_B_j G^(s_j - s_i) R_B_i^T) (Chen, "A screw motion approach to
   uniqueness analysis of head-eye geometry of robots", CVPR 1991). Triples of views, each with every relative
   numbering, are tried in the order in which their angles agree.
2. A triple gives R_X and R_Z, and each view then takes the numbering that is nearest: the others are 2 pi / k away.
3. The best hypotheses are refined. One is taken where the numbering as given leaves far more of the rotations (F test,
   every numbering there is counted), and left open where yet another numbering fits as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.calibrate.solvers.relative import odd_part, sample
from calibrant.geometry import so3
from calibrant.optimize.chances import MAXWELL_MEDIAN, f_tail

Steps = NDArray[np.intp]

TRIPLES = 100
"""Triples solved: with a third of the views wrong every fourth is clean, and congruence finds those first."""
DRAWN = 2000
"""Triples looked at for their congruence, each with every relative numbering."""
AS_GIVEN, DRAWN_AS_GIVEN = 20, 500
"""Triples solved with the numbering they have, the most congruent ones of so many."""
MOST_VIEWS, MOST_SUSPECTS = 100, 20
"""Views of a longer session that the search goes over, and those besides whose numbering looks wrong; what is found
then numbers every view."""
REFINED = 8
"""Numberings that are refined and compared, the best ones."""
STEPS = 3
"""Gauss-Newton steps of a refinement; it starts within a few degrees, and converges quadratically."""
FLOOR = 1e-5
"""Radians below which a deviation is rounding: no camera sees a thousandth of a degree."""
NEAR_SIGMAS, NEAR = 6.0, np.deg2rad(5.0)
"""Views within six sigma of the median's are compared; others are wrong for another reason, or seen too badly. Five
degrees are near in any case: few views fit some numbering by chance, and their median says little."""
LEAST_AGREEING = 6
"""Views that judge a hypothesis, where there are as many: of the numberings of three or four, some fit by chance."""
AGREE = 0.25
"""Rotations that agree to a quarter of the motion's are consistent: noise gives some per cent, chance 1."""
P = 1e-3
"""Chance of renumbering views that were numbered alike; and of calling a numbering impossible that is the right one."""


@dataclass(frozen=True, eq=False)
class Numbering:
    """steps (n,): how many turns each view's board is to be turned by, B_i G^steps.

    verdict: "given", the numbering stays as it is; "turned", it becomes consistent by `steps`; "open", the one given
    does not fit and several others do. given_deg, turned_deg: rms of the rotations of the views compared.
    """

    steps: Steps
    verdict: Literal["given", "turned", "open"]
    given_deg: float = 0.0
    turned_deg: float = 0.0


@dataclass(frozen=True, eq=False)
class _Hypotheses:
    """h hypotheses: the side of the robot's poses each belongs to, R_X and R_Z (h, 3, 3), steps (h, n), angle (h, n)
    left of every view, score (h,) by the half of the views that agrees best."""

    side: Steps
    R_X: Array
    R_Z: Array
    steps: Steps
    angle: Array
    score: Array

    def take(self, rows: Steps | list[int]) -> _Hypotheses:
        return _Hypotheses(*(field[rows] for field in self.fields))

    @property
    def fields(self) -> tuple[NDArray, ...]:
        return self.side, self.R_X, self.R_Z, self.steps, self.angle, self.score

    @property
    def best(self) -> int:
        return int(np.argmin(self.score))


def find_numbering(sides: Sequence[Array], R_B: Array, order: int) -> Numbering:
    """The numbering that makes n views of a board with `order` equal turns consistent with the robot.

    Args: sides, the ways to read the robot's rotations, each R_A (n, 3, 3) of the normal form; R_B (n, 3, 3) of
    T_camera_target; order, 2 where half a turn of the board is not seen, 4 for quarter turns.
    """
    n = len(R_B)
    given = Numbering(np.zeros(n, dtype=np.intp), "given")
    if n < 3:
        return given
    G = so3.exp(np.arange(order)[:, None] * [0.0, 0.0, 2 * np.pi / order])
    rows = sample(n, MOST_VIEWS)
    plain = _searched([R_A[rows] for R_A in sides], R_B[rows], G, as_given=True)
    suspects = _suspects(plain.take([plain.best]), sides, R_B, G)
    if len(suspects) == 0:
        return given
    rows = np.union1d(rows, suspects[:MOST_SUSPECTS])
    some = [R_A[rows] for R_A in sides]
    found = _refined(some, R_B[rows], G, _searched(some, R_B[rows], G, as_given=False))
    return _judged(sides, R_B, G, rows, found, plain.take(np.argsort(plain.score, kind="stable")[:REFINED]))


def congruence(R_A: Array, R_B: Array, order: int) -> float:
    """Median difference of the angles that robot and camera turn by, rad, each pair numbered as suits it best.

    Args: as for `find_numbering`, with one R_A (n, 3, 3).
    """
    rows = sample(len(R_B), MOST_VIEWS)
    G = so3.exp(np.arange(order)[:, None] * [0.0, 0.0, 2 * np.pi / order])
    off = np.abs(_angles(R_A[rows], R_A[rows][None]) - _angles(R_B[rows], R_B[rows] @ G[:, None])).min(axis=0)
    return float(np.median(off[np.triu_indices(len(rows), 1)]))


def _suspects(one: _Hypotheses, sides: Sequence[Array], R_B: Array, G: Array) -> Steps:
    """Rows of the views that another numbering than the one given brings nearer, by the hypothesis that favours it."""
    every = _nearest(one.side, sides[one.side[0]], R_B, G, one.R_X, one.R_Z)
    fits = every.angle[0] < np.pi / (2 * len(G))
    # Where less than half of the views agree with anything, all are suspect.
    return np.flatnonzero(fits & (every.steps[0] > 0) if 2 * fits.sum() > len(fits) else np.ones(len(fits), dtype=bool))


def _searched(sides: Sequence[Array], R_B: Array, G: Array, *, as_given: bool) -> _Hypotheses:
    """Hypotheses of the most congruent triples, of every side; steps are relative to the first view of the triple."""
    n, k = len(R_B), len(G)
    turned = R_B[None] @ G[:, None]
    angles_B = _angles(R_B, turned)
    drawn = _triples(n)
    if as_given:
        drawn = drawn[:: max(1, len(drawn) // DRAWN_AS_GIVEN)]
    first, second = np.divmod(np.arange(1 if as_given else k * k), k)
    found = []
    for number, R_A in enumerate(sides):
        mismatch = np.abs(_angles(R_A, R_A[None]) - angles_B)
        a, b, c = drawn.T[:, :, None]
        worst = np.maximum(mismatch[first, a, b], mismatch[second, a, c])
        worst = np.maximum(worst, mismatch[(second - first) % k, b, c])
        one, two = (odd_part(np.swapaxes(R_A[drawn[:, 0]], 1, 2) @ R_A[drawn[:, m]]) for m in (1, 2))
        spread = np.linalg.norm(np.cross(one, two), axis=1)[:, None]  # zero for parallel axes: nothing is determined
        # Noise of a degree is fine where the axes are well apart: mismatch over spread is what it does to X.
        quality = ((worst + np.deg2rad(0.05)) / (np.sqrt(spread) + 1e-6)).ravel()
        chosen = np.argsort(quality, kind="stable")[: AS_GIVEN if as_given else TRIPLES]
        triple, way = np.divmod(chosen, len(first))
        steps = np.column_stack([np.zeros(len(chosen), dtype=np.intp), first[way], second[way]])
        found.append(_of_triples(number, R_A, R_B, G, drawn[triple], steps))
    return _Hypotheses(*(np.concatenate(fields) for fields in zip(*(f.fields for f in found))))


def _triples(n: int) -> Steps:
    """Triples (m, 3) of n views: all of them, or as many as are looked at, always the same."""
    if n * (n - 1) * (n - 2) // 6 <= DRAWN:
        i, j, k = np.meshgrid(*(np.arange(n),) * 3, indexing="ij")
        return np.column_stack([x[(i < j) & (j < k)] for x in (i, j, k)])
    return np.random.default_rng(0).random((DRAWN, n)).argpartition(3, axis=1)[:, :3]


def _angles(R: Array, other: Array) -> Array:
    """Angles (k, n, n) between R_i of R (n, 3, 3) and R_j of other (k, n, 3, 3), rad."""
    cosine = (R.reshape(len(R), 9) @ np.swapaxes(other.reshape(len(other), -1, 9), 1, 2) - 1) / 2
    return np.arccos(np.clip(cosine, -1, 1))


def _of_triples(side: int, R_A: Array, R_B: Array, G: Array, triples: Steps, steps: Steps) -> _Hypotheses:
    """R_X of each triple by its three motions, R_Z by its three loops."""
    A, B = R_A[triples], R_B[triples] @ G[steps]
    one, other = [0, 1, 0], [1, 2, 2]
    # Odd parts are continuous through half a turn: no branch needs to be chosen.
    a = odd_part(np.swapaxes(A[:, other], -1, -2) @ A[:, one])
    b = odd_part(B[:, other] @ np.swapaxes(B[:, one], -1, -2))
    R_X = so3.nearest(np.swapaxes(a, 1, 2) @ b)
    R_Z = so3.nearest((A @ R_X[:, None] @ B).sum(axis=1))
    return _nearest(np.full(len(R_X), side), R_A, R_B, G, R_X, R_Z)


def _nearest(side: Steps, R_A: Array, R_B: Array, G: Array, R_X: Array, R_Z: Array) -> _Hypotheses:
    """Every view with the numbering that is nearest for R_X, R_Z (h, 3, 3). R_A (n, 3, 3) or (h, n, 3, 3)."""
    loops = (R_A @ R_X[:, None] @ R_B).reshape(len(R_X), -1, 9)
    wanted = (R_Z[:, None] @ np.swapaxes(G, 1, 2)).reshape(len(R_X), -1, 9)
    traces = loops @ np.swapaxes(wanted, 1, 2)
    steps = np.argmax(traces, axis=2)
    angle = np.arccos(np.clip((np.take_along_axis(traces, steps[..., None], axis=2)[..., 0] - 1) / 2, -1, 1))
    half = max(min(LEAST_AGREEING, angle.shape[1]), angle.shape[1] // 2 + 1)
    score = np.log(np.partition(angle, half - 1, axis=1)[:, :half] + FLOOR).sum(axis=1)
    return _Hypotheses(side, R_X, R_Z, steps, angle, score)


def _refined(sides: Sequence[Array], R_B: Array, G: Array, found: _Hypotheses) -> _Hypotheses:
    """The best hypotheses of different numbering, each fitted to the views that are near it and numbered again."""
    order = np.argsort(found.score, kind="stable")
    relative = (found.steps[order] - found.steps[order, :1]) % len(G)
    _, first = np.unique(np.column_stack([found.side[order], relative]), axis=0, return_index=True)
    chosen = found.take(order[np.sort(first)[:REFINED]])
    R_A = np.stack(sides)[chosen.side]
    R_X, R_Z, _ = _fitted(R_A, R_B @ G[chosen.steps], chosen.R_X, _near(chosen.angle))
    return _nearest(chosen.side, R_A, R_B, G, R_X, R_Z)


def _near(angle: Array) -> NDArray[np.bool_]:
    """Views (h, n) whose angles are within what noise makes of the median's."""
    sigma = np.median(angle, axis=1, keepdims=True) / MAXWELL_MEDIAN + FLOOR
    return np.asarray(angle <= np.maximum(NEAR_SIGMAS * sigma, NEAR))


def _fitted(R_A: Array, R_B: Array, R_X: Array, used: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """R_X and R_Z (h, 3, 3) with the least squares of the angles of the views used (h, n), and that sum (h,).

    log(R_A_i exp(x) R_X R_B_i R_Z^T) = d_i + R_A_i x - z; z is eliminated, R_Z is the mean of the loops.
    """
    weight = used.astype(np.float64)[..., None, None]
    share = weight / weight.sum(axis=1, keepdims=True)
    J = R_A - (share * R_A).sum(axis=1, keepdims=True)
    normal = (weight * np.swapaxes(J, -1, -2) @ J).sum(axis=1)
    # Motions about one axis leave a direction open: it stays where it is.
    inverse = np.linalg.pinv(normal, rcond=1e-9, hermitian=True)
    for step in range(STEPS + 1):
        loops = R_A @ R_X[:, None] @ R_B
        R_Z = so3.nearest((weight * loops).sum(axis=1))
        d = so3.log(loops @ np.swapaxes(R_Z, -1, -2)[:, None])
        if step < STEPS:
            slope = (weight * np.swapaxes(J, -1, -2) @ d[..., None]).sum(axis=1)
            R_X = so3.exp(-(inverse @ slope)[..., 0]) @ R_X
    return R_X, R_Z, np.sum(weight[..., 0] * d * d, axis=(1, 2))


def _judged(
    sides: Sequence[Array], R_B: Array, G: Array, rows: Steps, found: _Hypotheses, plain: _Hypotheses
) -> Numbering:
    """The best numbering against the one given and against all others, over the views that are near it."""
    n, k, best = len(R_B), len(G), found.best
    given = Numbering(np.zeros(n, dtype=np.intp), "given")
    near = _near(found.angle[best : best + 1])[0]
    used, m = rows[near], int(near.sum())
    steps = (found.steps[:, near] - found.steps[:, near][:, :1]) % k
    if m < 3 or not _consistent(sides[found.side[best]][used], found.angle[best, near]) or not steps[best].any():
        return given

    def left(some: _Hypotheses, numbered: Steps) -> Array:
        R_A = np.stack(sides)[some.side][:, used]
        return _fitted(R_A, R_B[used] @ G[numbered], some.R_X, np.ones((len(some.side), m), dtype=bool))[2]

    freedom = 3 * m - 6
    squares = left(found, steps) + m * FLOOR**2
    as_given = float(left(plain, np.zeros((len(plain.side), m), dtype=np.intp)).min()) + m * FLOOR**2
    log_p = np.log(max(float(f_tail(freedom, freedom, as_given / squares[best])), 1e-300))
    if log_p + (m - 1) * np.log(k) > np.log(P):
        return given
    figures = [float(np.rad2deg(np.sqrt(s / m))) for s in (as_given, squares[best])]
    others = np.any(steps != steps[best], axis=1)
    if np.any(f_tail(freedom, freedom, squares[others] / squares[best]) > P):
        return Numbering(given.steps, "open", *figures)
    R_A = sides[found.side[best]]
    R_X, R_Z, _ = _fitted(R_A[None, used], (R_B[used] @ G[steps[best]])[None], found.R_X[[best]], near[None, near])
    every = _nearest(found.side[[best]], R_A, R_B, G, R_X, R_Z)
    # A view that no numbering brings near is wrong for another reason, and stays as it is.
    fits = every.angle[0] < np.pi / (2 * k)
    turned = (every.steps[0] - np.bincount(every.steps[0, fits], minlength=k).argmax()) % k
    return Numbering(np.where(fits, turned, 0), "turned", *figures)


def _consistent(R_A: Array, angle: Array) -> bool:
    """True when the rotations agree to a fraction of the motion."""
    size = float(np.median(_angles(R_A, R_A[None])[0][np.triu_indices(len(R_A), 1)]))
    return bool(np.median(angle) <= AGREE * size)
