"""The answer of one closed form in place of the joint refinement's, for comparison with other programs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.solvers import SOLVERS
from calibrant.data import CalibrationResult, Check, as_transform, verdict_of
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3

Array = NDArray[np.float64]

JOINT, MEAN = "joint", "mean"
METHODS = (JOINT, *SOLVERS, MEAN)
"""The joint refinement, every closed form, and the mean transform over the closed forms that answered."""


def require_method(name: str) -> str:
    """The method's name. Raises: InputError listing the methods there are."""
    if name not in METHODS:
        raise InputError(f"unknown method {name!r}; known: {', '.join(METHODS)}")
    return name


def answered_by(result: CalibrationResult, method: str, A: Array, B: Array) -> CalibrationResult:
    """The result with the transforms of a closed form, which come without covariance: it weighs nothing, states none.

    Z is the mean of A_i X B_i over the pairs A, B (n, 4, 4) that the result used. Views, noise and held-out error stay
    those of the joint refinement, whose checks judge the data and not the method.
    Raises: RefusedError when the method has no answer for these poses.
    """
    row = result.methods[method]
    if row.matrix is None:
        raise RefusedError(f"method {method}: {row.message}; leave --method out for the joint refinement")
    camera, target = result.transforms
    X = np.asarray(row.matrix)
    apart = se3.local(camera.matrix, X)
    mm, deg = 1e3 * np.linalg.norm(apart[3:]), np.rad2deg(np.linalg.norm(apart[:3]))
    text = (
        f"{method} answers alone: it weighs all poses alike and states no uncertainty; the joint refinement puts the "
        f"camera {mm:.3g} mm and {deg:.2g} deg from there"
    )
    checks = (Check("method", "warn", text, float(mm)), *result.checks)
    return replace(
        result,
        transforms=(
            as_transform(camera.parent, camera.child, X),
            as_transform(target.parent, target.child, se3.mean(A @ X @ B)),
        ),
        checks=checks,
        verdict=verdict_of(checks),
        options={**result.options, "method": method},
    )
