"""Reprojection: the factor that ties cameras, poses and targets together in every calibration problem.

    r = project(theta, T_camera_target (p + sum_j m_j d_j)) - uv

with T_camera_target a product of transforms (see `links`), theta the camera's parameters and d_j the target's modes
(scale, bending). The kernel differentiates with respect to T_camera_target; `links` hands that on to each of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibrant.arrays import Array, Indices
from calibrant.calibrate.reprojection.links import Link, compiled_products, is_plain, link_maps, through_links
from calibrant.cameras import CameraModel
from calibrant.data import View
from calibrant.geometry import so3
from calibrant.optimize.factors import Factor, FactorBlocks
from calibrant.optimize.losses import Loss
from calibrant.optimize.threads import over_range

SECONDS_PER_POINT = {"normal equations": 8e-8, "residuals": 1.5e-8}
"""Time of a point on one core, for the decision whether more cores pay. Nine parameters; more modes cost more."""


@dataclass(frozen=True, eq=False)
class TargetModes:
    """How the target may deform: points + sum_j m_j directions_j.

    variable: name of the one that holds m (1, k); directions (k, N, 3), metres.
    """

    variable: str
    directions: Array


@dataclass(frozen=True, eq=False)
class StackedViews:
    """Views laid end to end: points (N, 3), uv (N, 2), sigma (N,) relative, offsets (m + 1,) of their first points.

    whitening (N, 2, 2): sigma C^-1/2 of points whose covariance C is not alike to all sides, I of the others, None
    where all are: residuals are white after it and 1 / sigma.
    """

    points: Array
    uv: Array
    sigma: Array
    offsets: Indices
    whitening: Array | None = None

    def alike(self) -> StackedViews:
        """The same with all points of the same weight."""
        return StackedViews(self.points, self.uv, np.ones(len(self.uv)), self.offsets)

    def noisier(self, ratio: float) -> StackedViews:
        """The same with relative sigmas this many times as large."""
        return self if ratio == 1 else replace(self, sigma=ratio * self.sigma)


def stack(views: Sequence[View]) -> StackedViews:
    """Lay views end to end. Sigmas become relative, the mean of 1 / sigma^2 being 1: their level is estimated."""
    counts = np.array([len(v) for v in views], dtype=np.int64)
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    points = np.concatenate([v.points for v in views])
    uv = np.concatenate([v.uv for v in views])
    if all(v.sigma_px is None for v in views):
        return StackedViews(points, uv, np.ones(len(uv)), offsets)
    known = [v.sigma_px for v in views if v.sigma_px is not None]
    typical = 1 / np.sqrt(np.mean(np.concatenate(known) ** -2))
    sigma = np.concatenate([np.ones(len(v)) if v.sigma_px is None else v.sigma_px / typical for v in views])
    return StackedViews(points, uv, sigma, offsets, _whitening(views, offsets))


def _whitening(views: Sequence[View], offsets: Indices) -> Array | None:
    """sigma C^-1/2 (N, 2, 2), symmetric; None where no view has a covariance."""
    if all(v.covariance_px is None for v in views):
        return None
    W = np.tile(np.eye(2), (int(offsets[-1]), 1, 1))
    for view, first, last in zip(views, offsets[:-1], offsets[1:]):
        if view.covariance_px is not None and view.sigma_px is not None:
            values, axes = np.linalg.eigh(view.covariance_px / view.sigma_px[:, None, None] ** 2)
            W[first:last] = (axes / np.sqrt(values)[:, None]) @ np.swapaxes(axes, 1, 2)
    return W


class ReprojectionFactor(Factor):
    """Residuals in pixels of views of one camera model; an edge is a view, a residual block a point."""

    def __init__(
        self,
        name: str,
        *,
        model: CameraModel,
        camera: str,
        links: Sequence[Link],
        views: StackedViews,
        camera_indices: Indices | None = None,
        modes: TargetModes | None = None,
        noise: str = "pixel",
        loss: Loss | None = None,
    ) -> None:
        m = len(views.offsets) - 1
        cameras = np.zeros(m, dtype=np.int64) if camera_indices is None else np.asarray(camera_indices, dtype=np.int64)
        self.model, self.links, self.views, self.modes = model, tuple(links), views, modes
        variables, indices = [link.variable for link in links] + [camera], [link.indices for link in links] + [cameras]
        if modes is not None:
            variables.append(modes.variable)
            indices.append(np.zeros(m, dtype=np.int64))
        super().__init__(
            name,
            variables=variables,
            indices=indices,
            dim=2,
            noise=noise,
            relative_sigma=views.sigma,
            whitening=views.whitening,
            row_offsets=views.offsets,
            loss=loss,
        )
        self._edge_of_row = np.repeat(np.arange(m), np.diff(views.offsets))
        self._points = np.ascontiguousarray(views.points.T)
        self._uv = np.ascontiguousarray(views.uv.T)
        W = views.whitening
        self._white = np.zeros((3, 0)) if W is None else np.ascontiguousarray(W.reshape(-1, 4).T[[0, 1, 3]])
        n_modes = 0 if modes is None else len(modes.directions)
        self._modes = (
            np.zeros((0, 3, 0)) if modes is None else np.ascontiguousarray(np.swapaxes(modes.directions, 1, 2))
        )
        self._width = 6 + len(model.parameter_names) + n_modes
        self._first, self._each = np.zeros(m, dtype=np.int64), np.arange(m)
        self._plain = is_plain(self.links)
        poses, k = 6 * len(self.links), len(model.parameter_names)
        self._ends = (*range(6, poses + 6, 6), poses + k, *([] if modes is None else [poses + k + n_modes]))

    def _split(self, values: Sequence[Array]) -> tuple[Sequence[Array], Array, Array]:
        k = len(self.links)
        theta = values[k + 1] if self.modes is not None else np.zeros((1, 0))
        return values[:k], values[k], theta

    def T_camera_target(self, *values: Array) -> Array:
        """The links' product (m, 4, 4) for the slots' values."""
        transforms = self._split(values)[0]
        if self._plain:
            T = transforms[0]
            return np.ascontiguousarray(T if len(T) == self.edges else np.broadcast_to(T, (self.edges, 4, 4)))
        return compiled_products(self.links, transforms, self.edges)[0]

    def _deformed(self, theta: Array) -> Array:
        if self.modes is None:
            return self.views.points
        return self.views.points + np.tensordot(theta[0], self.modes.directions, axes=1)

    def residuals(self, *values: Array) -> Array:
        from calibrant.calibrate.reprojection import kernels as reprojection_kernels

        kernel: Any = reprojection_kernels.residuals
        out = np.empty_like(self.views.uv)
        views = self._kernel_arguments(values, self.T_camera_target(*values))

        def run(first: int, last: int) -> None:
            kernel(*views, self.views.offsets, first, last, out)

        over_range(run, self.edges, seconds=len(out) * SECONDS_PER_POINT["residuals"])
        return out

    def _kernel_arguments(self, values: Sequence[Array], T: Array) -> tuple[Any, ...]:
        """Model, parameters, poses, modes and points as the compiled kernels take them."""
        from calibrant.calibrate.reprojection import kernels as reprojection_kernels

        _, parameters, theta = self._split(values)
        return (
            reprojection_kernels.rows_of(self.model),
            np.ascontiguousarray(parameters),
            self._each if len(parameters) > 1 else self._first,
            T,
            np.ascontiguousarray(theta[:1]),
            self._modes,
            self._points,
            self._uv,
        )

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        _, parameters, theta = self._split(values)
        T = self.T_camera_target(*values)
        rows = T[self._edge_of_row]
        rotated = np.einsum("nij,nj->ni", rows[:, :3, :3], self._deformed(theta))
        p = rotated + rows[:, :3, 3]
        uv, J_point, J_camera = self._project(parameters, p)
        J_pose = np.concatenate([-J_point @ so3.hat(rotated), J_point], axis=-1)
        jacobians = [
            J_pose @ np.broadcast_to(M, (self.edges, 6, 6))[self._edge_of_row]
            for M in link_maps(self.links, self._split(values)[0])
        ]
        jacobians.append(J_camera)
        if self.modes is not None:
            directions = np.einsum("nij,knj->nik", rows[:, :3, :3], self.modes.directions)
            jacobians.append(J_point @ directions)
        return uv - self.views.uv, tuple(jacobians)

    def influence(
        self, across: Sequence[Array | None], values: Sequence[Array], *, weight: Array
    ) -> tuple[Array, Array]:
        """Of every point: weight J across^T summed over the slots, (N, 2, p), and its weighted residual, (N, 2).

        Args: across, (m or 1, p, k) of each slot, None for a held one; weight (N,). One compiled pass over the views.
        """
        from calibrant.calibrate.reprojection import influence_kernels

        k, p = len(self.links), next(a.shape[1] for a in across if a is not None)
        M = np.zeros((self.edges, p, self._width))
        for a, chart in zip(across[:k], link_maps(self.links, self._split(values)[0])):
            if a is not None:  # the chart moves by `chart` times the link's tangent
                M[:, :, :6] += a @ np.swapaxes(chart, -1, -2)
        first = 6
        for a in across[k:]:
            if a is not None:
                M[:, :, first : first + a.shape[2]] = a
            first += len(self.model.parameter_names)
        out, e = np.empty((*self.views.uv.shape, p)), np.empty_like(self.views.uv)
        influence_kernels.influence_rows(
            *self._kernel_arguments(values, self.T_camera_target(*values)), self._white, weight, self.views.offsets,
            M, out, e,
        )  # fmt: skip
        return out, e

    def _project(self, parameters: Array, p: Array) -> tuple[Array, Array, Array]:
        k = len(self.model.parameter_names)
        if len(parameters) == 1:
            return self.model.project_with_jacobians(parameters[0], p)
        uv, J_point, J_camera = np.empty((len(p), 2)), np.empty((len(p), 2, 3)), np.empty((len(p), 2, k))
        for edge in range(self.edges):
            s = slice(self.views.offsets[edge], self.views.offsets[edge + 1])
            uv[s], J_point[s], J_camera[s] = self.model.project_with_jacobians(parameters[edge], p[s])
        return uv, J_point, J_camera

    def blocks(self, values: Sequence[Array], *, sigma: float) -> FactorBlocks:
        from calibrant.calibrate.reprojection import kernels as reprojection_kernels

        kernel: Any = reprojection_kernels.normal_equations
        m, width = self.edges, self._width
        H, g, cost = np.empty((m, width, width)), np.empty((m, width)), np.empty(m)
        if self._plain:
            T, maps = self.T_camera_target(*values), None
        else:
            T, maps = compiled_products(self.links, self._split(values)[0], m)
        views, weight, offsets = self._kernel_arguments(values, T), self.weight / sigma, self.views.offsets
        loss = (self.loss.kind, self.loss.scale_sq)
        # Rows of u and v that are mixed have more entries than a local one holds: such views take the dense kernel.
        local = None if self.whitening is not None else self.model.local_rows()
        if local is not None:
            from calibrant.calibrate.reprojection import local_kernels

            kernel, views = local_kernels.normal_equations, (*local, *views[1:])
        else:
            views = (*views, self._white)

        def run(first: int, last: int) -> None:
            kernel(*views, weight, offsets, *loss, first, last, H, g, cost)

        over_range(run, m, seconds=len(weight) * SECONDS_PER_POINT["normal equations"])
        if maps is not None:
            H, g = through_links(H, g, maps)
        return FactorBlocks(float(cost.sum()), H, g, self._ends)
