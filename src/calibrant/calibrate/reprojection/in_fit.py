"""What the views of a fit are left with."""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.reprojection.carried import CarriedFactor
from calibrant.calibrate.reprojection.factor import ReprojectionFactor
from calibrant.errors import InputError
from calibrant.optimize.solution import Solution


def seen_in_fit(fit: Solution, name: str) -> list[tuple[Array, Array]]:
    """Of every view of the reprojection factor of that name: squared residual norms (n,), px^2, and T_camera_target.

    For carried points too the residual is what is predicted less what was found.
    Raises: InputError for a factor of another kind.
    """
    k = fit.problem.factor_index(name)
    given, values = fit.problem.factors[k], fit.problem.gather(k, fit.values)
    factor = given.seen if isinstance(given, CarriedFactor) else given
    values = values[: len(factor.variables)]
    if not isinstance(factor, ReprojectionFactor):
        raise InputError(f"factor {name!r} has no views: it is a {type(factor).__name__}")
    squares = np.sum(factor.residuals(*values) ** 2, axis=1)
    return list(zip(np.split(squares, factor.views.offsets[1:-1]), factor.T_camera_target(*values)))
