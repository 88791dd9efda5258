"""What of a camera is held and what is tied: the options of `--fix`, as a parameterisation of its variable."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import CameraModel
from calibrant.errors import InputError
from calibrant.expected import names_of
from calibrant.optimize.manifolds import Euclidean, Manifold, Subspace

_FIX = "a list of names of parameters or groups, such as ['k3', 'aspect']"
RADIAL = ("k1", "k2", "k3", "k4", "k5", "k6")
GROUPS = {"tangential": ("p1", "p2"), "focal": ("fx", "fy"), "principal": ("cx", "cy")}
RADIAL_GROUP = "radial"
"""All radial terms that a model has."""
ASPECT = "aspect"


def expand_fix(fix: Sequence[str], model: CameraModel) -> tuple[tuple[str, ...], bool]:
    """Names of held parameters, and whether the aspect ratio is held.

    Raises: InputError for a name that is neither a parameter of the model nor a group.
    """
    held: list[str] = list(model.gauge)
    aspect = False
    for name in names_of(fix, "fix", _FIX):
        if name == ASPECT:
            aspect = True
        elif name == RADIAL_GROUP and (terms := [p for p in RADIAL if p in model.parameter_names]):
            held += terms
        elif name in GROUPS and all(p in model.parameter_names for p in GROUPS[name]):
            held += GROUPS[name]
        elif name in model.parameter_names:
            held.append(name)
        else:
            groups = [g for g, members in GROUPS.items() if all(p in model.parameter_names for p in members)]
            groups += [RADIAL_GROUP] * any(p in model.parameter_names for p in RADIAL)
            raise InputError(
                f"cannot fix {name!r}: the {model.name} model has {model.listed}; "
                f"groups are {', '.join([*groups, ASPECT])}"
            )
    return tuple(dict.fromkeys(held)), aspect


def camera_manifold(model: CameraModel, fix: Sequence[str], start: Array) -> Manifold:
    """The camera's parameters as the solver may move them. start (k,): gives the ratio fy / fx that `aspect` holds."""
    held, aspect = expand_fix(fix, model)
    names = model.parameter_names
    if not aspect or {"fx", "fy"} & set(held):
        if aspect:
            held = tuple(dict.fromkeys([*held, "fx", "fy"]))
        return Euclidean(names, held)
    free = [n for n in names if n not in held and n != "fy"]
    directions = np.zeros((len(names), len(free)))
    for column, name in enumerate(free):
        directions[names.index(name), column] = 1.0
    fx, fy = names.index("fx"), names.index("fy")
    directions[fy, free.index("fx")] = start[fy] / start[fx]
    return Subspace(names, directions, tuple("fx with fy" if n == "fx" else n for n in free))
