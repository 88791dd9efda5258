"""Links: where a view's target sits in its camera, as a product of unknown and known transforms.

    T_camera_target = prod_k L_k,  L_k a variable or its inverse

    intrinsics   T_camera_target
    rig          T_camera_rig  T_rig_target
    eye-in-hand  T_gripper_camera^-1  T_base_gripper^-1  T_base_target
    eye-to-hand  T_base_camera^-1  T_base_gripper  T_gripper_target

Factors differentiate with respect to the product; each link's share follows from a 6x6 matrix that maps the link's
tangent to the product's, both in `se3.retract`'s chart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.geometry import se3, so3


@dataclass(frozen=True, eq=False)
class Link:
    """One transform of the product: a variable, the instance (m,) each edge uses, and whether it enters inverted."""

    variable: str
    indices: Indices
    inverted: bool = False


def is_plain(links: Sequence[Link]) -> bool:
    """True for one link that is its variable itself: its tangent is the product's."""
    return len(links) == 1 and not links[0].inverted


def product(links: Sequence[Link], values: Sequence[Array]) -> Array:
    """The product (m, 4, 4) of the links' values (m, 4, 4)."""
    return _multiply(_factors(links, values))


def link_maps(links: Sequence[Link], values: Sequence[Array]) -> list[Array]:
    """Matrices (m or 1, 6, 6) from each link's tangent to the product's.

    For T = L T_k M: omega = R_L omega_k, v = R_L (omega_k x (R_k t_M) + v_k); an inverted link first maps its own
    tangent to its inverse's: omega' = -R^T omega, v' = -R^T (v - omega x t).
    """
    if is_plain(links):
        return [np.eye(6)[None]]
    factors = _factors(links, values)
    maps = []
    for k, link in enumerate(links):
        left, right = _multiply(factors[:k]), _multiply(factors[k + 1 :])
        R_left = left[:, :3, :3]
        arm = (factors[k][:, :3, :3] @ right[:, :3, 3, None])[..., 0]
        M = np.zeros((max(len(R_left), len(arm)), 6, 6))
        M[:, :3, :3] = M[:, 3:, 3:] = R_left
        M[:, 3:, :3] = -R_left @ so3.hat(arm)
        maps.append(M @ inverse_map(values[k]) if link.inverted else M)
    return maps


def compiled_products(links: Sequence[Link], values: Sequence[Array], edges: int) -> tuple[Array, Array]:
    """`product` (m, 4, 4) and `link_maps` (m, links, 6, 6) of m edges in one compiled pass."""
    from calibrant.calibrate.reprojection import link_kernels

    stacked = np.empty((len(links), edges, 4, 4))
    for one, value in zip(stacked, values):
        one[:] = value
    inverted = np.array([link.inverted for link in links])
    T, maps = np.empty((edges, 4, 4)), np.empty((edges, len(links), 6, 6))
    link_kernels.products(stacked, inverted, T, maps)
    return T, maps


def through_links(H: Array, g: Array, maps: Array) -> tuple[Array, Array]:
    """Normal equations of the links and the rest from those of (product, rest): B^T H B, B^T g, B = [maps, 0; 0, I].

    Args: H (m, 6 + r, 6 + r), g (m, 6 + r), maps (m, links, 6, 6).
    """
    from calibrant.calibrate.reprojection import link_kernels

    width = 6 * maps.shape[1] + H.shape[1] - 6
    H_links, g_links = np.empty((len(H), width, width)), np.empty((len(H), width))
    link_kernels.through_links(H, g, maps, H_links, g_links)
    return H_links, g_links


def _factors(links: Sequence[Link], values: Sequence[Array]) -> list[Array]:
    return [se3.inverse(value) if link.inverted else value for link, value in zip(links, values)]


def _multiply(factors: Sequence[Array]) -> Array:
    T: Array = np.eye(4)[None]
    for factor in factors:
        T = T @ factor
    return T


def inverse_map(T: Array) -> Array:
    """Tangent of T^-1 from the tangent of T: [[-R^T, 0], [-R^T hat(t), -R^T]]."""
    Rt = np.swapaxes(T[:, :3, :3], -1, -2)
    M = np.zeros((len(T), 6, 6))
    M[:, :3, :3] = M[:, 3:, 3:] = -Rt
    M[:, 3:, :3] = -Rt @ so3.hat(T[:, :3, 3])
    return M
