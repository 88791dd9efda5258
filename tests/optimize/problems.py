"""Small problems of every shape that the optimiser is made for, drawn at random from a seed.

Factors here are plain NumPy: what the tests prove holds for the solver whatever stands behind a factor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrant.geometry import se3, so3
from calibrant.optimize import (
    SE3,
    SO3,
    Factor,
    Positive,
    Problem,
    RotationPrior,
    Subspace,
    TranslationPrior,
    Variable,
    VectorPrior,
    vector,
)

Array = NDArray[np.float64]


class Curve(Factor):
    """y = a exp(b x) + c: r = prediction - y, one residual a sample, all of one edge."""

    def __init__(
        self, x: Array, y: Array, *, name: str = "curve", noise: str = "y", sigma: Array | float = 1.0, loss=None
    ):
        self.x, self.y = x, y
        super().__init__(
            name, variables=("abc",), indices=(np.zeros(1, int),), dim=1, noise=noise, relative_sigma=sigma,
            row_offsets=np.array([0, len(x)]), loss=loss,
        )  # fmt: skip

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        a, b, c = values[0][0]
        e = np.exp(b * self.x)
        J = np.stack([e, a * self.x * e, np.ones_like(e)], axis=-1)
        return (a * e + c - self.y)[:, None], (J[:, None, :],)


class Sight(Factor):
    """A point seen from a pose through a focal length: r = f (x/z, y/z) - uv; every edge is one sight."""

    def __init__(self, pose: Array, point: Array, uv: Array, *, loss=None, sigma: Array | float = 1.0):
        self.uv = uv
        zeros = np.zeros(len(uv), int)
        super().__init__(
            "sight", variables=("pose", "point", "focal"), indices=(pose, point, zeros), dim=2, noise="pixel",
            relative_sigma=sigma, loss=loss,
        )  # fmt: skip

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        T, p, f = values
        rotated = np.einsum("nij,nj->ni", T[:, :3, :3], p)
        q = rotated + T[:, :3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            iz = np.where(q[:, 2] > 0, 1 / q[:, 2], np.nan)
        ideal = q[:, :2] * iz[:, None]
        J = np.zeros((len(q), 2, 3))
        J[:, 0, 0] = J[:, 1, 1] = f[:, 0] * iz
        J[:, :, 2] = -f * ideal * iz[:, None]
        pose = np.concatenate([-J @ so3.hat(rotated), J], axis=-1)
        return f * ideal - self.uv, (pose, J @ T[:, :3, :3], ideal[:, :, None])


class Relative(Factor):
    """T_j = T_i M_ij measured: r = local of the two, translation and rotation along the world's axes."""

    def __init__(self, i: Array, j: Array, measured: Array):
        self.measured = measured
        super().__init__("relative", variables=("node", "node"), indices=(i, j), dim=6, noise="relative")

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        A, B = values
        P = A @ self.measured
        r = se3.local(P, B)
        inverse = so3.left_jacobian_inverse(r[:, :3])
        J_a, J_b = np.zeros((len(r), 6, 6)), np.zeros((len(r), 6, 6))
        J_b[:, :3, :3], J_b[:, 3:, 3:] = inverse, np.eye(3)
        J_a[:, :3, :3] = -inverse @ so3.exp(r[:, :3])
        J_a[:, 3:, 3:] = -np.eye(3)
        J_a[:, 3:, :3] = so3.hat((A[:, :3, :3] @ self.measured[:, :3, 3, None])[..., 0])
        return r, (J_a, J_b)


class Directions(Factor):
    """Directions turned by one rotation and scaled: r = s R d - e."""

    def __init__(self, d: Array, e: Array):
        self.d, self.e = d, e
        zeros = np.zeros(len(d), int)
        super().__init__("directions", variables=("R", "s"), indices=(zeros, zeros), dim=3, noise="e")

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        R, s = values
        turned = np.einsum("nij,nj->ni", R, self.d)
        return s * turned - self.e, (-s[:, :, None] * so3.hat(turned), turned[:, :, None])


def curve(seed: int, *, n: int = 40, sigma: float = 0.05, loss=None) -> Problem:
    rng = np.random.default_rng(seed)
    truth = np.array([rng.uniform(1, 3), rng.uniform(-1.5, -0.3), rng.uniform(-1, 1)])
    x = np.linspace(0, 3, n)
    y = truth[0] * np.exp(truth[1] * x) + truth[2] + sigma * rng.normal(size=n)
    start = truth * rng.uniform(0.8, 1.2, 3)
    return Problem((vector("abc", start, ("a", "b", "c")),), (Curve(x, y, loss=loss),), {"y": sigma})


def bundle(seed: int, *, poses: int = 6, points: int = 12, sigma: float = 1e-3, seen: float = 0.8) -> Problem:
    """Poses, points and a focal length; priors on the first pose and on one distance fix the gauge."""
    rng = np.random.default_rng(seed)
    p = rng.uniform(-0.5, 0.5, (points, 3))
    T = se3.make(so3.exp(rng.uniform(-0.4, 0.4, (poses, 3))), rng.uniform([-0.2, -0.2, 2], [0.2, 0.2, 3], (poses, 3)))
    sights = rng.uniform(size=(poses, points)) < seen
    sights[:3] = True  # every point is determined
    i, j = np.nonzero(sights)
    q = se3.apply(T[i], p[j])
    uv = 1.3 * q[:, :2] / q[:, 2:] + sigma * rng.normal(size=(len(i), 2))
    variables = (
        Variable("pose", SE3(), se3.retract(T, 0.02 * rng.normal(size=(poses, 6)))),
        Variable("point", vector("p", np.zeros(3), ("x", "y", "z")).manifold, p + 0.02 * rng.normal(size=p.shape)),
        Variable("focal", Positive(("f",)), np.array([[1.2]])),
    )
    gauge = (
        RotationPrior("turn", "pose", T[:1], noise="gauge", indices=np.array([0])),
        TranslationPrior("place", "pose", T[:1], noise="gauge", indices=np.array([0])),
        VectorPrior("distance", "point", 0, p[0], sqrt_information=np.eye(3) / 0.01),
    )
    return Problem(variables, (Sight(i, j, uv), *gauge), {"pixel": sigma, "gauge": 0.01})


def graph(seed: int, *, nodes: int = 8, extra: int = 10) -> Problem:
    """Poses tied by measured relative poses, the first one held by a prior."""
    rng = np.random.default_rng(seed)
    T = se3.make(so3.exp(rng.normal(size=(nodes, 3))), rng.normal(size=(nodes, 3)))
    i = np.concatenate([np.arange(nodes - 1), rng.integers(0, nodes, extra)])
    j = np.concatenate([np.arange(1, nodes), rng.integers(0, nodes, extra)])
    i, j = i[i != j], j[i != j]
    M = se3.retract(se3.inverse(T[i]) @ T[j], 0.02 * rng.normal(size=(len(i), 6)))
    noise = 0.1 * rng.normal(size=(nodes, 6))
    noise[0] = 0  # turning the whole graph is a long curved valley, which is not what is looked at here
    start = Variable("node", SE3(), se3.retract(T, noise))
    first = np.array([0])
    gauge = (
        RotationPrior("turn", "node", T[:1], noise="gauge", indices=first),
        TranslationPrior("place", "node", T[:1], noise="gauge", indices=first),
    )
    return Problem((start,), (Relative(i, j, M), *gauge), {"relative": 0.02, "gauge": 1e-3})


def similarity(seed: int, *, n: int = 15) -> Problem:
    """A rotation and a scale from pairs of directions."""
    rng = np.random.default_rng(seed)
    R, s, d = so3.exp(rng.normal(size=3)), rng.uniform(0.5, 2), rng.normal(size=(n, 3))
    e = s * d @ R.T + 0.01 * rng.normal(size=d.shape)
    variables = (
        Variable("R", SO3(), so3.exp(0.2 * rng.normal(size=3))[None] @ R),
        Variable("s", Positive(("s",)), np.array([[1.0]])),
    )
    return Problem(variables, (Directions(d, e),), {"e": 0.01})


def tied(seed: int) -> Problem:
    """The curve with b and c tied: a subspace in place of free parameters."""
    free = curve(seed)
    directions = np.array([[1.0, 0], [0, 1], [0, -0.5]])
    manifold = Subspace(("a", "b", "c"), directions, ("a", "b with c"))
    return Problem((Variable("abc", manifold, free.start[0]),), free.factors, free.sigmas)


SHAPES = {"curve": curve, "bundle": bundle, "graph": graph, "similarity": similarity, "tied": tied}
