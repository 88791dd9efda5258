"""The spot of a working plane that a pointer points at, seen by two cameras of which nothing is known.

Each camera's image of the plane is a homography T, s (u, v, 1)^T = T (X, Y, 1)^T, from four points or more (Cipolla
1994; lecture 001, slides 74-78). The pointer's axis appears in it as the line l_i, and as seen from there covers

    l_gp = T^T l_i

of the plane; the two cameras' lines meet in the spot. (Slide 76 writes T^-1 l_i, which is how points go: x on l_i
means l_i^T T X = (T^T l_i)^T X = 0.) With more than four points T is the least-squares one in pixels. The spot's
covariance is first order: of T from the points' pixels, Cov(T) = sigma^2 (J^T J)^-1 on the tangent of |T| = 1, and of
l_i from its two points, through x = l_gp x l'_gp, spot = (x_1, x_2) / x_3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import projective, so3
from calibrant.optimize.chances import chi2_tail

UNIT_PLANE = ((0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0))
"""Corners of the working plane where no size is said, in the order of slide 75."""
COLLINEAR = "collinear corners"
COMMON_PLANE = "pointer in one plane with both cameras"
PARALLEL = "pointer parallel to the plane"
_SURE = 3.0
"""Sigmas by which lines must differ to be told apart: noise alone does it once in 400 times."""
_EXACT = 1e-9
"""Sine of an angle, or part of the plane's size, that is rounding where the noise is nearly none."""
_STEPS = 30
_SETTLED = 1e-14


class Ambiguous(RefusedError):  # noqa: N818 - the condition is its name, as errors here say it
    """Lines that meet nowhere. `name` is one of this module's: COLLINEAR, COMMON_PLANE, PARALLEL."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(f"{name}: {message}")
        self.name = name


@dataclass(frozen=True, eq=False)
class Sight:
    """What one camera sees: corners (n, 2) px of the working plane, n >= 4, and two points (2, 2) px of the axis.

    Raises: InputError for shapes that do not fit, NaN, an axis whose two points are one.
    """

    corners: Array
    axis: Array

    def __post_init__(self) -> None:
        corners, axis = np.array(self.corners, dtype=np.float64), np.array(self.axis, dtype=np.float64)
        if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 4:
            raise InputError(f"a camera needs four corners of the plane or more, (n, 2) pixels, got {corners.shape}")
        if axis.shape != (2, 2):
            raise InputError(f"the pointer's axis is two points of it, (2, 2) pixels, got {axis.shape}")
        if not (np.isfinite(corners).all() and np.isfinite(axis).all()):
            raise InputError("corners and axis hold NaN or infinite pixels; leave such points out")
        if not np.any(axis[0] != axis[1]):
            raise InputError("the two points of the pointer's axis are the same pixel: give two that are far apart")
        object.__setattr__(self, "corners", corners)
        object.__setattr__(self, "axis", axis)


@dataclass(frozen=True, eq=False)
class Spot:
    """Where the pointer's axis meets the plane: xy (2,) in the plane's unit, with its covariance (2, 2).

    T (2, 3, 3): plane to pixels of each camera; uv (2, 2): where they see the spot; crossing_deg: angle at which the
    two lines cross, seen square on; rms_px: what the corners are off by, per point over both axes, and fits: the chance
    of more under the stated noise, both None for four corners, which always fit.
    """

    xy: Array
    covariance: Array
    T: Array
    uv: Array
    crossing_deg: float
    sigma_crossing_deg: float
    rms_px: float | None = None
    fits: float | None = None

    @property
    def sigma(self) -> Array:
        """1 sigma along the plane's X and Y."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def radius_95(self) -> float:
        """Half the longer axis of the ellipse that holds the spot with 95 %: sqrt(-2 ln 0.05) sigmas."""
        return float(np.sqrt(-2 * np.log(0.05) * np.linalg.eigvalsh(self.covariance)[-1]))


def pointing_spot(left: Sight, right: Sight, *, plane: ArrayLike = UNIT_PLANE, sigma_px: float = 0.5) -> Spot:
    """The spot of the working plane, and how certain it is.

    Args: plane (n, 2): the corners in the plane, any unit, in the order of the sights' corners; sigma_px: noise of a
    pixel that is given, per axis.
    Raises: InputError for unequal numbers of corners, an order in which they cannot be seen; Ambiguous for corners on
    one line, a pointer in one plane with both cameras, a pointer parallel to the plane.

    >>> from calibrant.perceive.pointing.spot import Sight, pointing_spot
    >>> left = Sight([[0, 0], [0, 100], [100, 0], [100, 100]], [[25, 0], [25, 50]])
    >>> right = Sight([[10, 10], [10, 90], [90, 10], [90, 90]], [[0, 30], [50, 30]])
    >>> pointing_spot(left, right).xy.round(9).tolist()
    [0.25, 0.25]
    """
    X = np.asarray(plane, dtype=np.float64)
    for name, sight in (("left", left), ("right", right)):
        if X.shape != sight.corners.shape:
            raise InputError(f"the plane has corners {X.shape}, the {name} camera sees {sight.corners.shape}")
    if not 0 < sigma_px < np.inf:
        raise InputError(f"the pixel noise is {sigma_px:g} px; expected one above 0")
    scale = 1 / max(float(np.std(X)), np.finfo(float).tiny)
    centre = X.mean(axis=0)
    sides = [_side(name, s, scale * (X - centre), sigma_px) for name, s in (("left", left), ("right", right))]
    _same_way_round(*sides)
    a, b = sides
    _refuse_parallel(a, b, sigma_px)
    x = np.cross(a.line, b.line)
    J = np.concatenate([-so3.hat(b.line) @ a.J, so3.hat(a.line) @ b.J], axis=1) * sigma_px
    spot = x[:2] / x[2]
    to_spot = (np.eye(3)[:2] - np.outer(spot, [0.0, 0.0, 1.0])) / x[2]
    covariance = to_spot @ J @ J.T @ to_spot.T / scale**2
    n_a, n_b = (float(np.linalg.norm(side.line[:2])) for side in sides)
    sine = float(x[2] / (n_a * n_b))
    sigma_sine = sigma_px * float(np.hypot(_turn(a.line / n_a, a.J / n_a), _turn(b.line / n_b, b.J / n_b)))
    T = np.stack([side.T @ _similarity(scale, centre) for side in sides])
    uv = np.stack([projective.apply_homography(t, [spot / scale + centre])[0] for t in T])
    spare = 4 * len(X) - 16
    square = a.squares + b.squares
    return Spot(
        spot / scale + centre,
        covariance,
        T,
        uv,
        float(np.rad2deg(np.arcsin(min(1.0, abs(sine))))),
        float(np.rad2deg(sigma_sine)),
        float(np.sqrt(square / (2 * len(X)))) if spare else None,
        chi2_tail(spare, square / sigma_px**2) if spare else None,
    )


@dataclass(frozen=True, eq=False)
class _Side:
    """One camera: T, plane (normalised) to pixels; its line of the plane, and J (3, m) of it by a pixel."""

    T: Array
    line: Array
    J: Array
    squares: float
    turns: float


def _side(name: str, sight: Sight, X: Array, sigma_px: float) -> _Side:
    _refuse_narrow(name, sight.corners, sigma_px)
    try:
        start = projective.homography(X, sight.corners)
    except InputError as error:
        raise Ambiguous(COLLINEAR, f"{name} camera: {error}") from None
    # Pixels about their mean, in units of their spread: T's elements are then of one size.
    k, m = 1 / float(np.std(sight.corners)), sight.corners.mean(axis=0)
    S = _similarity(k, m)
    T, root, squares = _refined(S @ start, X, k * (sight.corners - m))
    depth = np.concatenate([X, np.ones((len(X), 1))], axis=1) @ T[2]
    if not (np.all(depth > 0) or np.all(depth < 0)):
        raise InputError(
            f"the {name} camera cannot see the corners in this order: give its pixels in the order of the plane's"
        )
    p, q = (np.append(k * (end - m), 1.0) for end in sight.axis)
    l_i = np.cross(p, q)
    line = T.T @ l_i
    J_ends = T.T @ np.concatenate([-so3.hat(q)[:, :2], so3.hat(p)[:, :2]], axis=1)
    # d(T^T l) = sum_i dT_ij l_i, T row by row.
    J_T = np.kron(l_i, np.eye(3)) @ root
    size = np.linalg.norm(line)
    return _Side(
        np.asarray(np.linalg.solve(S, T), dtype=np.float64),
        line / size,
        k * np.concatenate([J_T, J_ends], axis=1) / size,
        squares / k**2,
        float(np.linalg.det(T) * np.sign(depth[0])),
    )


def _refined(T: Array, X: Array, uv: Array) -> tuple[Array, Array, float]:
    """The homography of least squares in pixels by Gauss-Newton on |T| = 1, a root (9, 8) of its covariance for unit
    noise, and the squares left."""
    h = T.ravel() / np.linalg.norm(T)
    best = np.inf
    for _ in range(_STEPS):
        error, J = _homography_errors(h, X, uv)
        tangent = np.linalg.svd(h[None])[2][1:].T
        square = float(error @ error)
        if not square < best:
            break
        best, kept = square, h
        step = tangent @ np.linalg.lstsq(J @ tangent, -error, rcond=None)[0]
        if np.linalg.norm(step) < _SETTLED:
            break
        h = (h + step) / np.linalg.norm(h + step)
    _, J = _homography_errors(kept, X, uv)
    tangent = np.linalg.svd(kept[None])[2][1:].T
    root = np.linalg.pinv(J @ tangent)
    return kept.reshape(3, 3), tangent @ root, best


def _homography_errors(h: Array, X: Array, uv: Array) -> tuple[Array, Array]:
    """predicted - observed (2 n,) and its derivative by the nine elements (2 n, 9)."""
    P = np.concatenate([X, np.ones((len(X), 1))], axis=1)
    su, sv, s = (P @ row for row in h.reshape(3, 3))
    u, v, zero = su / s, sv / s, np.zeros_like(P)
    J_u = np.concatenate([P, zero, -u[:, None] * P], axis=1) / s[:, None]
    J_v = np.concatenate([zero, P, -v[:, None] * P], axis=1) / s[:, None]
    return np.stack([u - uv[:, 0], v - uv[:, 1]], axis=1).ravel(), np.stack([J_u, J_v], axis=1).reshape(-1, 9)


def _refuse_narrow(name: str, corners: Array, sigma_px: float) -> None:
    """Raises: Ambiguous where the noise could have put all corners, or all but one, off one line of the picture."""
    for out in (None, *range(len(corners))):
        points = corners if out is None else np.delete(corners, out, axis=0)
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        # Points on a line leave chi-square of n - 2 degrees of freedom across it.
        if spread[1] < max(_SURE * sigma_px * np.sqrt(len(points) - 2), _EXACT * float(spread[0])):
            width = float(spread[1]) / np.sqrt(len(points))
            who = "all corners" if out is None else f"all corners but number {out + 1}"
            raise Ambiguous(
                COLLINEAR,
                f"{who} lie on one line in the {name} picture, to {width:.2g} px; expected four of which no three "
                "are on a line: choose others, or look less flatly at the plane",
            )


def _same_way_round(a: _Side, b: _Side) -> None:
    """Raises: InputError where one camera sees the plane mirrored."""
    if (a.turns > 0) != (b.turns > 0):
        raise InputError(
            "the corners go around clockwise in one picture and anticlockwise in the other: the same corner must come "
            "first in both, both cameras must look at the same side of the plane, and neither picture may be mirrored"
        )


def _refuse_parallel(a: _Side, b: _Side, sigma_px: float) -> None:
    """Raises: Ambiguous where the two lines of the plane are one, or meet nowhere, as far as the noise tells.

    Plane coordinates are about the corners' middle, in units of their spread. A line that passes no finite point of the
    plane, (0, 0, 1), is its horizon: there l_gp / |(l_1, l_2)| has no value.
    """
    normals = [float(np.linalg.norm(side.line[:2])) for side in (a, b)]
    if min(normals) < _EXACT:
        raise Ambiguous(PARALLEL, "the pointer's axis covers the plane's horizon; point at the plane")
    la, lb = a.line / normals[0], b.line / normals[1]
    Ja, Jb = sigma_px * a.J / normals[0], sigma_px * b.J / normals[1]
    sine = float(la[0] * lb[1] - la[1] * lb[0])
    sigma_sine = float(np.hypot(_turn(la, Ja), _turn(lb, Jb)))
    if abs(sine) > max(_SURE * sigma_sine, _EXACT):
        return
    # Distances of the lines from the middle of the corners, the lines looking the same way.
    way = 1.0 if la[:2] @ lb[:2] > 0 else -1.0
    apart = abs(float(la[2] - way * lb[2]))
    sigma_apart = float(np.hypot(np.linalg.norm(Ja[2]), np.linalg.norm(Jb[2])))
    angle = f"{np.rad2deg(np.arcsin(min(1.0, abs(sine)))):.2g} deg apart, known to {np.rad2deg(sigma_sine):.2g} deg"
    if apart < max(_SURE * sigma_apart, _EXACT):
        raise Ambiguous(
            COMMON_PLANE,
            f"the two cameras' lines of the plane are one line ({angle}), so that every point of it may be the spot: "
            "move a camera out of the plane of pointer and other camera",
        )
    raise Ambiguous(
        PARALLEL,
        f"the two cameras' lines of the plane are parallel ({angle}) and not one: the pointer does not point at the "
        "plane; tilt it, or look from farther apart",
    )


def _turn(line: Array, J: Array) -> float:
    """1 sigma of the direction of a line whose normal has length 1, radians."""
    return float(np.linalg.norm(line[0] * J[1] - line[1] * J[0]))


def _similarity(scale: float, centre: Array) -> Array:
    return np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1.0]])
