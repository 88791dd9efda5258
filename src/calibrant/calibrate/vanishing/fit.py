"""Rotation of a camera against a Manhattan scene by least squares on SO(3), with the focal length where it is unknown.

Edge i, of normal n_i, follows column k of R = R_camera_scene. Its arc turned about the point where it meets the
direction costs nothing, so that what is left is (profile likelihood, first order)

    r_i = n_i . d / sigma_i,    sigma_i^2 = (sigma^2 + counts_i e^2) d^T C_i d,    d = S R e_k,    S = diag(s, s, 1),

sigma the noise of an edge's points, found from their own arcs, and e what all points of an edge have in common: a wall
that is not straight, a lens that is not the model's. Which edge follows which direction, or none, and e, are found with
R by expectation maximisation (Schindler and Dellaert 2004, "Atlanta world").
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.calibrate.vanishing.circles import Circles
from calibrant.calibrate.vanishing.search import FIRST_EXCESS_PX, GATE, Found, scaled_normals, spread, whitened
from calibrant.optimize.factors import Factor, VectorPrior
from calibrant.optimize.levenberg_marquardt import solve
from calibrant.optimize.manifolds import SO3, Variable, vector
from calibrant.optimize.problem import Problem
from calibrant.optimize.solution import Solution

ROUNDS = 30
"""Assignment, fit and noise in turn: they settle in five to fifteen."""
NO_DIRECTION = -1
FOLLOWING = 0.7
"""Share of a scene's edges that follow a direction, to begin with; it is estimated."""
FIRST_ROUNDS = 6
"""After these a start shows where it leads."""
FOCAL_WIDTH = 1.0
"""1 sigma of ln s: lenses have a third to three times the reference. It keeps what the edges do not show from running
away, and changes a focal length that is known to a tenth by a hundredth of its sigma."""
LEAST_SHARE = 1e-3
"""Probability below which an edge has no say about a direction."""
FEWEST = 3


@dataclass(frozen=True, eq=False)
class Fit:
    """member (m,): which column of R each edge follows, or NO_DIRECTION; noise (m,) as `search.spread`."""

    R_camera_scene: Array
    focal: float
    member: Indices
    noise: Array
    sigma_px: float
    excess_px: float
    solution: Solution


class LineFactor(Factor):
    """n_i . S R e_k of edges and their directions; slots R (1, 3, 3) and log s (1, 1)."""

    def __init__(self, circles: Circles, member: Indices, sigma: Array) -> None:
        self.normals, self.member = circles.normals, member
        zero = np.zeros(len(member), dtype=np.int64)
        super().__init__(
            "edges", variables=("R_camera_scene", "log_focal"), indices=(zero, zero), dim=1, noise="edge",
            relative_sigma=sigma,
        )  # fmt: skip

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        R, logarithm = values
        s = np.exp(logarithm)
        d = np.take_along_axis(R, self.member[:, None, None], axis=2)[:, :, 0]
        n = self.normals * np.concatenate([s, s, np.ones_like(s)], axis=1)
        # d (R e) = omega x R e, and n . (omega x d) = omega . (d x n).
        turn = np.cross(d, n)
        zoom = np.sum(n[:, :2] * d[:, :2], axis=1)
        return np.sum(n * d, axis=1)[:, None], (turn[:, None, :], zoom[:, None, None])


def fit_directions(circles: Circles, starts: Sequence[Found], *, sigma_px: float, focal: str) -> Fit:
    """Rotation, focal length and noise from where the search ended: the most likely of what its hypotheses lead to.

    Several, as edges that lie near a direction by chance can hold a fit. Args: focal, "known" or "unknown".
    """
    begins = [_State(start.R_camera_scene, start.focal, start.excess_px, FOLLOWING) for start in starts]
    ends = [_settled(circles, state, sigma_px, focal, rounds=FIRST_ROUNDS) for state in begins]
    best = max(ends, key=lambda state: _likelihood(circles, state, sigma_px))
    best = _settled(circles, best, sigma_px, focal, rounds=ROUNDS)
    member = _members(circles, best, sigma_px)
    used = member >= 0
    noise = spread(circles, sigma_px, best.excess_px)
    if used.sum() < FEWEST:  # next to nothing follows it: it is refused for that
        used, member = np.ones(len(circles), dtype=np.bool_), np.where(used, member, NO_DIRECTION)
    _, unit = whitened(circles, best.R_camera_scene.T, best.focal)
    each = np.where(
        member >= 0, member, np.argmin(np.abs(whitened(circles, best.R_camera_scene.T, best.focal)[0]), axis=1)
    )
    sigma = unit[np.arange(len(unit)), each] * noise
    solution = _solve_lines(LineFactor(circles.only(used), each[used], sigma[used]), best, focal)
    s = float(np.exp(solution.value("log_focal")[0, 0]))
    return Fit(solution.value("R_camera_scene")[0], s, member, noise, sigma_px, best.excess_px, solution)


@dataclass(frozen=True, eq=False)
class _State:
    """Rotation, focal length, excess e and the share of edges that follow a direction."""

    R_camera_scene: Array
    focal: float
    excess_px: float
    following: float


def _settled(circles: Circles, state: _State, sigma_px: float, focal: str, *, rounds: int) -> _State:
    """Expectation maximisation from a state."""
    for _ in range(rounds):
        before, state = state, _damped_step(circles, state, sigma_px, focal)
        turned = np.abs(state.R_camera_scene - before.R_camera_scene).max()
        if turned < 1e-9 and abs(state.excess_px - before.excess_px) < 1e-3 * sigma_px:
            break
    return state


def _densities(circles: Circles, state: _State, sigma_px: float) -> tuple[Array, Array]:
    """Density of each edge's n . d under each direction (m, 3), times its share; and under none (m,).

    n . d of a random plane is even over -1 .. 1.
    """
    r, unit = whitened(circles, state.R_camera_scene.T, state.focal)
    length = np.linalg.norm(scaled_normals(circles, state.focal), axis=1)[:, None]
    sigma = unit * spread(circles, sigma_px, state.excess_px)[:, None] / length
    follows = np.exp(-0.5 * (r / length / sigma) ** 2) / (np.sqrt(2 * np.pi) * sigma)
    return state.following / 3 * follows, np.full(len(r), (1 - state.following) / 2)


def _likelihood(circles: Circles, state: _State, sigma_px: float) -> float:
    follows, free = _densities(circles, state, sigma_px)
    return float(np.sum(np.log(follows.sum(axis=1) + free)))


def _damped_step(circles: Circles, state: _State, sigma_px: float, focal: str) -> _State:
    """Which direction each edge follows with what probability, then the fit that is most likely for these."""
    follows, free = _densities(circles, state, sigma_px)
    belongs = follows / (follows.sum(axis=1) + free)[:, None]
    row, member = np.nonzero(belongs > LEAST_SHARE)
    if len(row) < FEWEST:
        return state
    weight = belongs[row, member]
    _, unit = whitened(circles, state.R_camera_scene.T, state.focal)
    noise = spread(circles, sigma_px, state.excess_px)
    picked = Circles(circles.normals[row], circles.covariance[row], circles.counts[row], circles.rms_px[row])
    sigma = unit[row, member] * noise[row] / np.sqrt(weight)
    solution = _solve_lines(LineFactor(picked, member, sigma), state, focal)
    squares = (solution.residuals("edges")[:, 0] / unit[row, member]) ** 2
    following = float(np.clip(belongs.sum() / len(circles), 1 / len(circles), 1 - 1 / len(circles)))
    return _State(
        solution.value("R_camera_scene")[0],
        float(np.exp(solution.value("log_focal")[0, 0])),
        _excess(squares, circles.counts[row], weight, sigma_px),
        following,
    )


def _solve_lines(factor: LineFactor, state: _State, focal: str) -> Solution:
    variables = (_rotation_variable(state.R_camera_scene), _focal_variable(state.focal, focal))
    factors: tuple[Factor, ...] = (factor,)
    if focal == "unknown":
        width = np.array([[1 / FOCAL_WIDTH]])
        factors = (factor, VectorPrior("lenses", "log_focal", 0, np.zeros(1), sqrt_information=width))
    return solve(Problem(variables, factors, {"edge": 1.0}))


def _members(circles: Circles, state: _State, sigma_px: float) -> Indices:
    """Which direction each edge follows: the only one within the gate.

    An edge on the line of two vanishing points may follow either and is left out: the wrong one would bend the fit.
    """
    r, unit = whitened(circles, state.R_camera_scene.T, state.focal)
    z = np.abs(r) / (unit * spread(circles, sigma_px, state.excess_px)[:, None])
    return np.where(np.sum(z <= GATE, axis=1) == 1, np.argmin(z, axis=1), NO_DIRECTION)


def _rotation_variable(R: Array) -> Variable:
    return Variable("R_camera_scene", SO3(), R[None], words="the camera's rotation")


def _focal_variable(s: float, focal: str) -> Variable:
    name = "log focal length"
    return vector("log_focal", [np.log(s)], [name], held=[name] if focal == "known" else [])


def _excess(squares: Array, counts: Indices, weight: Array, sigma_px: float) -> float:
    """e >= 0 that makes the squares most likely: sum w c (u - v) / v^2 = 0 with v = sigma^2 + c e^2."""

    def surplus(e: float) -> float:
        v = sigma_px**2 + counts * e**2
        return float(np.sum(weight * counts * (squares - v) / v**2))

    return _root_below(surplus, FIRST_EXCESS_PX)


def _root_below(surplus: Callable[[float], float], high: float) -> float:
    """Where a falling function of e >= 0 passes 0; 0 where it starts below."""
    if surplus(0.0) <= 0:
        return 0.0
    low = 0.0
    while surplus(high) > 0:
        low, high = high, 2 * high
    for _ in range(40):  # bisection to a part in 1e12
        middle = 0.5 * (low + high)
        low, high = (middle, high) if surplus(middle) > 0 else (low, middle)
    return high


def rotation_covariance(fit: Fit) -> tuple[Array, float]:
    """Covariance (3, 3) of the rotation, radians along the camera's axes, and sigma of log s (0 where it is held).

    Raises: RefusedError where the edges do not determine them.
    """
    joint = fit.solution.joint_covariance([("R_camera_scene", 0), ("log_focal", 0)])
    return joint[:3, :3], float(np.sqrt(max(joint[3, 3], 0.0)))


def camera_share(
    fit: Fit, circles: Circles, refit: Callable[[Array], Circles], values: Array, covariance: Array
) -> Array:
    """Covariance (3, 3) of the rotation from the camera's: D C D^T, D = -H^-1 sum J^T (dr / d theta).

    dr / d theta by differences over one sigma of each parameter. Args: refit, circles of other parameter values (k,).
    """
    used = fit.member >= 0
    d = fit.R_camera_scene.T[fit.member[used]]
    _, unit = whitened(circles, fit.R_camera_scene.T, fit.focal)
    sigma = (unit[np.arange(len(unit)), fit.member] * fit.noise)[used]
    J = np.cross(d, circles.normals[used]) / sigma[:, None]
    D = np.zeros((3, len(values)))
    for j, h in enumerate(np.sqrt(np.diag(covariance)).tolist()):
        if h > 0:
            step = np.zeros(len(values))
            step[j] = h
            moved = [_signed_like(refit(values + k * step).normals, circles.normals)[used] for k in (1, -1)]
            D[:, j] = -J.T @ (np.sum((moved[0] - moved[1]) * d, axis=1) / (2 * h * sigma))
    slope = np.linalg.solve(J.T @ J, D)
    return np.asarray(slope @ covariance @ slope.T, dtype=np.float64)


def _signed_like(normals: Array, like: Array) -> Array:
    """Normals with the signs of others: a plane has two."""
    return normals * np.where(np.sum(normals * like, axis=1) < 0, -1.0, 1.0)[:, None]


def nearest_axes(R: Array) -> Indices:
    """Order and signs that make a scene's axes the camera's nearest: columns R[:, |p| - 1] sign(p), determinant 1.

    The scene does not say which direction is called x: of the 24 ways the one is taken that turns the camera least.
    """
    best, chosen = -np.inf, np.array([1, 2, 3])
    for p in _SIGNED:
        columns = R[:, np.abs(p) - 1] * np.sign(p)
        if np.linalg.det(columns) > 0 and np.trace(columns) > best:
            best, chosen = float(np.trace(columns)), p
    return chosen


_SIGNED = [
    np.array([a * i, b * j, c * k])
    for i, j, k in ((1, 2, 3), (1, 3, 2), (2, 1, 3), (2, 3, 1), (3, 1, 2), (3, 2, 1))
    for a in (1, -1)
    for b in (1, -1)
    for c in (1, -1)
]
