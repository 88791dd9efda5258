"""What photos of a known target should show, as one small least-squares problem with what is known and what is not.

    min_u  sum_i sum_j |project(theta, T_i p_ij) - uv_ij|^2 / sigma_ij^2 + |z|^2

T_i is a product of transforms by name (`reprojection.links`); every transform and the lens stand at a base value moved
by a tangent that is linear in the unknowns u = (z, f). z are latent numbers of unit variance: what is known with a
covariance C enters as root z, root root^T = C, so that a singular C (a parameter that was held) needs no care, and
what photos have in common is one latent that several names share. f are free: what a hypothesis allows to have changed.

A Gauss-Newton step costs O(rows * unknowns^2), some 600 rows and 50 unknowns for three photos: a millisecond.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.reprojection.links import Link, link_maps, product
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.geometry import se3, so3

LENS = "lens"
"""Name of the camera's parameters among what is known."""
STEPS = 40
"""Gauss-Newton takes some five; a start far off takes twice that."""
SETTLED = 1e-7
"""Decrease of the cost, of its value, below which nothing more is to be had."""
_UNSEEN_PX = 1e3
"""Residual of a point that falls behind the camera, so that a step that puts it there is not taken."""


@dataclass(frozen=True, eq=False)
class Known:
    """What is known of the named tangents together: root (d, r), covariance root root^T. A transform has six
    components, the lens its parameters."""

    names: tuple[str, ...]
    root: Array


@dataclass(frozen=True, eq=False)
class Photo:
    """A view, the chain of transforms (name, inverted) that puts the target into its camera, and sigma (n,) of each
    point per axis, pixels. The view's own sigma_px is the detector's word."""

    view: View
    chain: tuple[tuple[str, bool], ...]
    sigma: Array
    now: bool = True
    """Whether it was taken now: a photo of then sees through the lens of then."""


@dataclass(frozen=True, eq=False)
class Model:
    """The problem: where everything stands by name, what is known, and what is free.

    free: names of transforms without a prior; shifted: name of one that is free to move but not to turn. free_lens:
    whether photos of now have a focal length and a principal point of their own, as (relative change of the focal
    lengths, shift of cx, shift of cy).
    """

    camera: Camera
    photos: tuple[Photo, ...]
    base: Mapping[str, Array]
    known: tuple[Known, ...] = ()
    free: tuple[str, ...] = ()
    free_lens: bool = False
    shifted: str = ""

    def freed(self, *names: str, lens: bool = False, at: Mapping[str, Array] | None = None) -> Model:
        """The same with these transforms free beside those that are, begun at the places given."""
        free = (*self.free, *(n for n in names if n not in self.free))
        return replace(self, free=free, free_lens=self.free_lens or lens, base={**self.base, **(at or {})})

    @property
    def freedom(self) -> int:
        """How many numbers are free."""
        return 6 * len(self.free) + 3 * bool(self.shifted) + 3 * self.free_lens


@dataclass(frozen=True, eq=False)
class Fit:
    """The end of a fit: chi-square of residuals and priors, the transforms by name, the lens (k,) of then and of now,
    and the covariance of all unknowns with the maps (d, unknowns) from them to each tangent."""

    model: Model
    chi2: float
    place: Mapping[str, Array]
    lens: Array
    lens_now: Array
    covariance: Array
    maps: Mapping[str, Array]
    residuals: tuple[Array, ...] = field(repr=False)

    def of(self, name: str) -> Array:
        """Covariance of the tangent of a transform, or of the change of the lens."""
        return self.maps[name] @ self.covariance @ self.maps[name].T

    def pose(self, i: int) -> Array:
        """T_camera_target (4, 4) of photo i."""
        links, values = _links(self.model.photos[i].chain, self.place)
        return product(links, values)[0]


CHANGE = "change of the lens"
"""Name of (relative focal length, cx, cy) among the maps of a fit."""


def square_root(C: Array) -> Array:
    """root (d, r) with root root^T = C, of rank r: directions without variance are left out."""
    scale = np.sqrt(np.maximum(np.diag(C), 0.0))
    unit = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(C / unit[:, None] / unit)
    kept = values > 1e-12 * max(float(values.max(initial=0.0)), 1e-300)
    root: Array = unit[:, None] * vectors[:, kept] * np.sqrt(values[kept])
    return root


def lens_change(camera: Camera, values: Array) -> Array:
    """d parameters / d (relative focal length, cx, cy), (k, 3)."""
    J = np.zeros((len(values), 3))
    for name in ("fx", "fy"):
        J[camera.model.index(name), 0] = values[camera.model.index(name)]
    J[camera.model.index("cx"), 1] = J[camera.model.index("cy"), 2] = 1.0
    return J


def solve(model: Model) -> Fit:
    """The least squares of a model by Gauss-Newton, damped where a step does not help."""
    maps, latents = _maps(model)
    unknowns = next(iter(maps.values())).shape[1]
    place, change, z = dict(model.base), np.zeros(3), np.zeros(latents)
    r, J = _linearised(model, maps, place, change, z)
    cost, damping = float(r @ r + z @ z), 0.0
    prior = np.concatenate([np.eye(latents), np.zeros((latents, unknowns - latents))], axis=1)
    for _ in range(STEPS):
        H = J.T @ J + prior.T @ prior
        g = J.T @ r + prior.T @ z
        scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
        damped = H / scale[:, None] / scale + damping * np.eye(unknowns)
        # One photo does not tell a camera that moved from a target that did: the least step of many is taken.
        step = -np.linalg.lstsq(damped, g / scale)[0] / scale
        moved = _moved(model, maps, place, change, z, step)
        r_new, J_new = _linearised(model, maps, *moved)
        new = float(r_new @ r_new + moved[2] @ moved[2])
        if not np.isfinite(new) or new > cost * (1 + 1e-12):
            damping = max(10 * damping, 1e-6)
            if damping > 1e6:
                break
            continue
        settled = cost - new <= SETTLED * cost
        (place, change, z), r, J, cost, damping = moved, r_new, J_new, new, damping / 10 if damping > 1e-6 else 0.0
        if settled:
            break
    H = J.T @ J + prior.T @ prior
    scale = 1 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    covariance = np.linalg.pinv(H * scale[:, None] * scale, hermitian=True) * scale[:, None] * scale
    placed = {name: se3.retract(T, maps[name][:, :latents] @ z) for name, T in place.items()}
    lens = model.camera.values + maps[LENS][:, :latents] @ z
    ends = np.cumsum([2 * len(p.view) for p in model.photos])[:-1]
    residuals = tuple(
        part.reshape(-1, 2) * p.sigma[:, None] for part, p in zip(np.split(r, ends), model.photos, strict=True)
    )
    now = lens + lens_change(model.camera, model.camera.values) @ change
    return Fit(model, cost, placed, lens, now, covariance, maps, residuals)


def _maps(model: Model) -> tuple[dict[str, Array], int]:
    """The tangent of every name as a linear map (d, unknowns) of the unknowns, and how many of these are latent."""
    sizes = {**dict.fromkeys(model.base, 6), LENS: len(model.camera.values), CHANGE: 3}
    latents = sum(k.root.shape[1] for k in model.known)
    maps = {name: np.zeros((size, latents + model.freedom)) for name, size in sizes.items()}
    at = 0
    for known in model.known:
        width, row = known.root.shape[1], 0
        for name in known.names:
            maps[name][:, at : at + width] += known.root[row : row + sizes[name]]
            row += sizes[name]
        at += width
    for name in model.free:
        maps[name][:, at : at + 6] = np.eye(6)
        at += 6
    if model.shifted:
        maps[model.shifted][3:, at : at + 3] = np.eye(3)
        at += 3
    if model.free_lens:
        maps[CHANGE][:, at : at + 3] = np.eye(3)
    return maps, latents


def _moved(
    model: Model, maps: Mapping[str, Array], place: Mapping[str, Array], change: Array, z: Array, step: Array
) -> tuple[dict[str, Array], Array, Array]:
    """Everything after a step: free transforms are moved where they are, latent numbers add up."""
    latents = len(z)
    moved = {
        name: se3.retract(T, maps[name][:, latents:] @ step[latents:])
        if name in model.free or name == model.shifted
        else T
        for name, T in place.items()
    }
    return moved, change + maps[CHANGE] @ step, z + step[:latents]


def _linearised(
    model: Model, maps: Mapping[str, Array], place: Mapping[str, Array], change: Array, z: Array
) -> tuple[Array, Array]:
    """Residuals over sigma (rows,) and their Jacobian (rows, unknowns)."""
    latents = len(z)
    values = {name: se3.retract(T, maps[name][:, :latents] @ z) for name, T in place.items()}
    lens = model.camera.values + maps[LENS][:, :latents] @ z
    of_change = lens_change(model.camera, model.camera.values)
    residuals, jacobians = [], []
    for photo in model.photos:
        links, chain = _links(photo.chain, values)
        T = product(links, chain)[0]
        to_pose = sum(
            (M[0] @ maps[name] for M, (name, _) in zip(link_maps(links, chain), photo.chain)),
            np.zeros((6, len(maps[LENS][0]))),
        )
        theta = lens + of_change @ change if photo.now else lens
        to_lens = maps[LENS] + of_change @ maps[CHANGE] if photo.now else maps[LENS]
        turned = photo.view.points @ T[:3, :3].T
        p = turned + T[:3, 3]
        seen = model.camera.model.sees(theta, p)
        uv, J_point, J_lens = model.camera.model.project_with_jacobians(theta, np.where(seen[:, None], p, [0, 0, 1.0]))
        r = np.where(seen[:, None], uv - photo.view.uv, _UNSEEN_PX)
        J = np.concatenate([-J_point @ so3.hat(turned), J_point], axis=-1) @ to_pose + J_lens @ to_lens
        residuals.append((r / photo.sigma[:, None]).ravel())
        jacobians.append((J / photo.sigma[:, None, None]).reshape(-1, J.shape[-1]))
    return np.concatenate(residuals), np.concatenate(jacobians)


def _links(chain: Sequence[tuple[str, bool]], values: Mapping[str, Array]) -> tuple[list[Link], list[Array]]:
    once = np.zeros(1, dtype=np.int64)
    return [Link(name, once, inverted) for name, inverted in chain], [values[name][None] for name, _ in chain]
