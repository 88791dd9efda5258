"""Globally optimal AX = XB: a semidefinite relaxation whose dual value certifies the answer.

    min |M x - k|^2 over x = (vec R, t), R in SO(3)

with the system of Andreff et al. t enters freely and is eliminated, which leaves z^T Q z in z = (vec R, 1). R in SO(3)
is a set of quadratic equations z^T P_k z = 0 (orthonormal rows and columns, right-handed columns). The Lagrangian dual

    max rho   subject to   S = Q + sum lambda_k P_k - rho E >= 0,   E = e_10 e_10^T

is a semidefinite programme of 10 x 10 matrices: rho never exceeds the cost of any rotation. When a rotation reaches it,
no better one exists. The programme is solved by a logarithmic barrier with Newton steps; its primal W = mu S^-1 tends
to z z^T.

Sources: E. Wise, M. Giamou, S. Khoubyarian, A. Grover, J. Kelly, "Certifiably optimal monocular hand-eye calibration",
MFI 2020; J. Briales, J. Gonzalez-Jimenez, "Convex global 3D registration with Lagrangian duality", CVPR 2017 (the
equations of SO(3)); S. Boyd, L. Vandenberghe, "Convex Optimization", 2004, chapter 11 (barrier).
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.solvers.kronecker import linear_system
from calibrant.calibrate.solvers.relative import PosePairs
from calibrant.calibrate.solvers.solver import HandEyeSolver
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3

BARRIER_END = 1e-8
"""Last weight of the barrier, Q scaled to a trace of 1: the dual is then within 10 times this of its optimum, and
Newton's matrix, whose condition grows as its inverse square, still has some digits."""

GAP_RELATIVE, GAP_ABSOLUTE = 1e-3, 1e-6
"""The certificate: the cost exceeds its lower bound by no more than 0.1 % of itself, or ten times what the barrier
leaves open (Q scaled to a trace of 1)."""


def convex(pairs: PosePairs) -> tuple[Array, None]:
    """X at the global minimum of the linear system over rigid transforms.

    Raises: RefusedError when the bound stays below the best rotation found, so that global optimality is not proven.
    """
    Q, translation = _reduced(pairs)
    rho, z = _solve_dual(Q)
    R = _polish(Q, so3.nearest(z[:9].reshape(3, 3)))
    point = np.append(R.reshape(-1), 1.0)
    cost = float(point @ Q @ point)
    if cost - rho > GAP_RELATIVE * cost + GAP_ABSOLUTE:
        raise RefusedError(
            f"convex: the best rotation found costs {cost:.3g}, the proven lower bound is {rho:.3g}: the relaxation "
            "is not tight on these data, which contradict each other; look for wrong views"
        )
    return se3.make(R, pairs.length * (translation @ point)), None


def _reduced(pairs: PosePairs) -> tuple[Array, Array]:
    """Q (10, 10) of the cost z^T Q z, trace 1, with t eliminated; and the (3, 10) that maps z to the optimal t.

    By QR of [M_t, M_r, -k]: the first three rows of the triangle give t, the rest is a square root of Q.
    """
    rows, known = linear_system(pairs)
    columns = np.concatenate([rows[:, 9:], rows[:, :9], -known[:, None]], axis=1)
    triangle = np.asarray(np.linalg.qr(columns, mode="r"), dtype=np.float64)
    root: Array = triangle[3:, 3:]
    translation = -np.asarray(np.linalg.solve(triangle[:3, :3], triangle[:3, 3:]), dtype=np.float64)
    return root.T @ root / np.sum(root**2), translation


def _constraints() -> Array:
    """Symmetric P_k (21, 10, 10): z^T P_k z = 0 for z = (vec R, 1), vec by rows, R in SO(3)."""
    index = np.arange(9).reshape(3, 3)
    out: list[Array] = []

    def add(terms: list[tuple[int, int, float]]) -> None:
        P = np.zeros((10, 10))
        for i, j, value in terms:
            P[i, j] += value / 2
            P[j, i] += value / 2
        out.append(P)

    for lines in (index, index.T):  # R R^T = I, R^T R = I
        for a in range(3):
            for b in range(a, 3):
                products = [(int(i), int(j), 1.0) for i, j in zip(lines[a], lines[b], strict=True)]
                add([*products, (9, 9, -1.0)] if a == b else products)
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # column a x column b = column c
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            add([(index[i, a], index[j, b], 1.0), (index[j, a], index[i, b], -1.0), (index[k, c], 9, -1.0)])
    return np.stack(out)


def _solve_dual(Q: Array) -> tuple[float, Array]:
    """Lower bound rho and the point z (10,) of the relaxation, its last element 1."""
    E = np.zeros((10, 10))
    E[9, 9] = 1.0
    D = np.concatenate([_constraints(), -E[None]])
    # Strictly feasible start: the squared lengths of the three rows (P_0, P_3, P_5) with weight 1, rho = -6 below -3.
    v = np.zeros(len(D))
    v[[0, 3, 5]], v[-1] = 1.0, -6.0
    mu = 1.0
    while True:
        for _ in range(20):
            v, decrement = _newton_step(Q, D, v, mu)
            if decrement < 0.1:  # well inside the region of quadratic convergence: follow the path
                break
        if mu <= BARRIER_END:
            break
        mu = max(mu / 5, BARRIER_END)
    W = np.linalg.inv(Q + np.einsum("k,kij->ij", v, D))
    return float(v[-1]), W[9] / W[9, 9]


def _newton_step(Q: Array, D: Array, v: Array, mu: float) -> tuple[Array, float]:
    """One damped Newton step on -rho / mu - log det S(v), and its decrement. The step stays inside S > 0."""
    S_inverse = np.linalg.inv(Q + np.einsum("k,kij->ij", v, D))
    T = S_inverse @ D
    gradient = -np.trace(T, axis1=1, axis2=2)
    gradient[-1] -= 1 / mu
    hessian = np.einsum("aij,bji->ab", T, T)
    # R R^T and R^T R have the same trace: one combination of the constraints is empty, so least squares, not solve.
    step = -np.linalg.lstsq(hessian, gradient, rcond=1e-13)[0]
    decrement = float(np.sqrt(max(0.0, -(gradient @ step))))
    return v + step / (1 + decrement), decrement


def _polish(Q: Array, R: Array) -> Array:
    """The local minimum of z^T Q z next to R, by Gauss-Newton with R <- exp(omega) R."""
    for _ in range(30):
        z = np.append(R.reshape(-1), 1.0)
        J = np.zeros((10, 3))
        J[:9] = (so3.hat(np.eye(3)) @ R).reshape(3, 9).T
        omega = -np.linalg.solve(J.T @ Q @ J, J.T @ Q @ z)
        R = so3.exp(omega) @ R
        if np.linalg.norm(omega) < 1e-14:
            break
    return R


CONVEX = HandEyeSolver("convex", "Wise, Giamou, Khoubyarian, Grover and Kelly 2020", convex)
