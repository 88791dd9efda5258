"""What a camera model needs besides its points: the depth that parallel rays cannot see, a surface where no point lies.

Both priors leave residuals of exact data at zero, or so small that pixels do not notice; without them the normal
equations would be singular.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import CameraModel
from calibrant.cameras.splined import Splined
from calibrant.optimize.factors import EXACT, Factor, FactorBlocks

GAUGE_SIGMA = 1e-3
"""A turn of the camera can be undone by the surface and all poses. The surface's shift and twist at its centre are held
at 0 instead: nothing opposes it, so that a weight of the order of the points' is enough, and leaves no residual."""
BEND_SIGMA = 0.1
"""Second difference of neighbouring control points: strong lenses bend by 0.02 a cell, so that one observed pixel
outweighs this by a thousand, and where there is none the surface goes on straight."""


def model_priors(kind: CameraModel, *, camera: str, poses: str, T_camera_target: Array) -> tuple[Factor, ...]:
    """The priors of a model on its camera variable and on the poses, which start at T_camera_target (m, 4, 4)."""
    if isinstance(kind, Splined):
        return (SurfacePrior("surface", camera, kind),)
    if kind.projection == "parallel":
        return (DepthPrior("depth", poses, T_camera_target[:, 2, 3]),)
    return ()


def parameter_information(kind: CameraModel) -> Array:
    """Inverse covariance (k, k) that a model's parameters have before any point is seen; 0 for most."""
    if isinstance(kind, Splined):
        root = _surface_root(kind)
        return root.T @ root
    return np.zeros((len(kind.parameter_names),) * 2)


class DepthPrior(Factor):
    """r = t_z - depth, metres: holds what parallel rays do not see, and changes nothing that they do."""

    def __init__(self, name: str, variable: str, depth: Array) -> None:
        self.depth = depth
        super().__init__(name, variables=(variable,), indices=(np.arange(len(depth)),), dim=1, noise=EXACT)

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        (T,) = values
        J = np.zeros((len(T), 1, 6))
        J[:, 0, 5] = 1.0
        return T[:, 2, 3, None] - self.depth[:, None], (J,)


class SurfacePrior(Factor):
    """A smooth surface, upright and centred: r = L c, L the weighted second differences and the gauge."""

    def __init__(self, name: str, variable: str, kind: Splined) -> None:
        self.root = _surface_root(kind)
        self.information = parameter_information(kind)
        super().__init__(name, variables=(variable,), indices=(np.array([0]),), dim=len(self.root), noise=EXACT)

    def linearize(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        (x,) = values
        return x @ self.root.T, (self.root[None],)

    def blocks(self, values: Sequence[Array], *, sigma: float) -> FactorBlocks:
        (x,) = values
        gradient = x @ self.information
        return FactorBlocks(
            0.5 * float(np.sum(gradient * x)), self.information[None], gradient, (len(self.information),)
        )


def _surface_root(kind: Splined) -> Array:
    """L (d, k): residuals of all parameters, fx fy cx cy free."""
    columns, rows = kind.columns, kind.rows_count
    node = np.arange(kind.nodes).reshape(rows, columns)
    triples = [np.stack([node[:, :-2], node[:, 1:-1], node[:, 2:]], axis=-1).reshape(-1, 3)]
    triples.append(np.stack([node[:-2], node[1:-1], node[2:]], axis=-1).reshape(-1, 3))
    bends = np.concatenate(triples)
    bend = np.zeros((len(bends), kind.nodes))
    bend[np.arange(len(bends))[:, None], bends] = np.array([1.0, -2.0, 1.0]) / BEND_SIGMA
    shift, along_x, along_y = kind.centre_weights()
    root = np.zeros((2 * len(bend) + 3, 4 + 2 * kind.nodes))
    x, y = slice(4, 4 + kind.nodes), slice(4 + kind.nodes, None)
    root[: len(bend), x] = root[len(bend) : -3, y] = bend
    root[-3, x] = root[-2, y] = shift / GAUGE_SIGMA
    root[-1, x], root[-1, y] = -along_y / GAUGE_SIGMA, along_x / GAUGE_SIGMA
    return root
