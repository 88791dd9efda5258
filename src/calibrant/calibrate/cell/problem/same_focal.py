"""Two lenses of one focal length: fx and fy are one unknown each, which both lenses' variables share.

The free components of the first lens end with what is tied, those of the second begin with it (`Variable.shares`), so
that each variable is whole: its values, its covariance, its part in every factor.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.problem.camera_role import CameraRole
from calibrant.errors import InputError
from calibrant.optimize.manifolds import Subspace, Variable

FOCAL = ("fx", "fy")


def with_one_focal(a: Variable, b: Variable, role_a: CameraRole, role_b: CameraRole) -> tuple[Variable, Variable]:
    """The variables of two lenses with their focal lengths tied, started at the mean of what each has by its photos.

    Raises: InputError for a focal length that is held, or aspect ratios of which one is held.
    """
    names_a, names_b = (_tied_names(v) for v in (a, b))
    for v, names in ((a, names_a), (b, names_b)):
        if not names:
            raise InputError(
                f"same focal lengths: that of {v.words} is held; leave it free, or hold it in both and leave this out"
            )
    if names_a != names_b:
        raise InputError("same focal lengths: the aspect ratio is held in one camera alone; hold it in both or in none")
    focal = _mean_focal(role_a, role_b)
    first, second = _at(a, focal), _at(b, focal)
    return _ordered(first, names_a, last=True), replace(
        _ordered(second, names_b, last=False), shares=(a.name, len(names_b))
    )


def _tied_names(v: Variable) -> tuple[str, ...]:
    """Free components that move the focal lengths: both, or one where the aspect ratio is held; none where one is
    held."""
    there = tuple(n for n in v.manifold.free_names if n in FOCAL or n == "fx with fy")
    return there if set(FOCAL) <= {part for n in there for part in n.split(" with ")} else ()


def _mean_focal(*roles: CameraRole) -> Array:
    """fx and fy (2,), the mean weighed by what each camera's own photos know; plain where they state nothing."""
    values, weights = [], []
    for role in roles:
        sigma = role.camera.sigma
        values.append([role.camera.parameters[n] for n in FOCAL])
        weights.append([sigma[n] ** -2 if sigma.get(n) else 1.0 for n in FOCAL])
    return np.average(values, axis=0, weights=weights)


def _at(v: Variable, focal: Array) -> Variable:
    values = v.values.copy()
    values[0, [v.manifold.natural_names.index(n) for n in FOCAL]] = focal
    return replace(v, values=values)


def _ordered(v: Variable, tied: tuple[str, ...], *, last: bool) -> Variable:
    """The variable with the tied components at one end of its free ones, along directions of their own."""
    names = v.manifold.natural_names
    basis = v.manifold.basis(v.values)
    columns = np.eye(len(names)) if basis is None else basis[0]
    free = v.manifold.free_names
    others = tuple(n for n in free if n not in tied)
    order = (*others, *tied) if last else (*tied, *others)
    directions = columns[:, [free.index(n) for n in order]].copy()
    for k, n in enumerate(order):
        if n == "fx with fy":  # the ratio of the common focal lengths
            fx, fy = (v.values[0, names.index(f)] for f in FOCAL)
            directions[names.index("fy"), k] = fy / fx
    return replace(v, manifold=Subspace(names, directions, order))
