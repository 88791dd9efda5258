"""Carrying covariances on: to functions of the unknowns, to points in a frame, to products of transforms.

First order: y = f(x), C_y = J C_x J^T. Transforms carry their covariance in `se3.retract`'s chart: rotation about, then
translation along, the axes of the parent frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import so3
from calibrant.optimize.solution import Solution


def of_function(solution: Solution, jacobians: Mapping[tuple[str, int], Array]) -> Array:
    """Covariance (..., d, d) of a function of any unknowns, from their joint covariance.

    jacobians: for each (variable, instance) that the function depends on, d y / d natural tangent, (..., d, k).
    Raises: InputError for unknown names or a Jacobian of the wrong width; RefusedError where there is no covariance.
    """
    if not jacobians:
        raise InputError("the uncertainty of a function needs the Jacobian of at least one variable")
    joint = solution.joint_covariance(list(jacobians))
    J = np.concatenate([np.asarray(j, dtype=np.float64) for j in jacobians.values()], axis=-1)
    if J.shape[-1] != len(joint):
        raise InputError(f"the Jacobians have {J.shape[-1]} columns, the variables {len(joint)} tangent components")
    return J @ joint @ np.swapaxes(J, -1, -2)


def of_point(T_a_b: ArrayLike, covariance: ArrayLike, p_b: ArrayLike, *, of_p_b: ArrayLike | None = None) -> Array:
    """Covariance (..., 3, 3), square metres along a's axes, of p_a = R p_b + t.

    d p_a = -hat(R p_b) omega + v + R d p_b. Args: T_a_b (4, 4) with covariance (6, 6); p_b (..., 3) metres;
    of_p_b (..., 3, 3): the point's own covariance in b, independent of the transform's.
    """
    T, C = np.asarray(T_a_b, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    p = np.asarray(p_b, dtype=np.float64)
    J = np.zeros((*p.shape[:-1], 3, 6))
    J[..., :3] = -so3.hat(p @ T[:3, :3].T)
    J[..., 3:] = np.eye(3)
    out = J @ C @ np.swapaxes(J, -1, -2)
    if of_p_b is not None:
        out = out + T[:3, :3] @ np.asarray(of_p_b, dtype=np.float64) @ T[:3, :3].T
    return out


def of_inverse(T_a_b: ArrayLike, covariance: ArrayLike) -> Array:
    """Covariance (6, 6) of T_b_a along b's axes from that of T_a_b along a's."""
    M = inverse_map(np.asarray(T_a_b, dtype=np.float64))
    return M @ np.asarray(covariance, dtype=np.float64) @ M.T


def inverse_map(T: Array) -> Array:
    """Tangent (..., 6, 6) of T^-1 from that of T: [[-R^T, 0], [-R^T hat(t), -R^T]]."""
    Rt = np.swapaxes(T[..., :3, :3], -1, -2)
    M = np.zeros((*T.shape[:-2], 6, 6))
    M[..., :3, :3] = M[..., 3:, 3:] = -Rt
    M[..., 3:, :3] = -Rt @ so3.hat(T[..., :3, 3])
    return M


def of_product(transforms: Sequence[ArrayLike], covariances: Sequence[ArrayLike | None]) -> tuple[Array, Array]:
    """T_1 T_2 ... T_n (4, 4) and its covariance (6, 6), the factors independent; None stands for an exact one.

    For T = L T_k M: omega = R_L omega_k, v = R_L (v_k - (R_k t_M) x omega_k).
    """
    Ts = [np.asarray(T, dtype=np.float64) for T in transforms]
    if len(Ts) != len(covariances):
        raise InputError(
            f"{len(Ts)} transforms need as many covariances (None for an exact one), got {len(covariances)}"
        )
    total = np.zeros((6, 6))
    for k, (T, C) in enumerate(zip(Ts, covariances)):
        if C is None:
            continue
        left, right = _transform_product(Ts[:k]), _transform_product(Ts[k + 1 :])
        M = np.zeros((6, 6))
        M[:3, :3] = M[3:, 3:] = left[:3, :3]
        M[3:, :3] = -left[:3, :3] @ so3.hat(T[:3, :3] @ right[:3, 3])
        total += M @ np.asarray(C, dtype=np.float64) @ M.T
    return _transform_product(Ts), total


def _transform_product(transforms: Sequence[Array]) -> Array:
    T = np.eye(4)
    for factor in transforms:
        T = T @ factor
    return T
