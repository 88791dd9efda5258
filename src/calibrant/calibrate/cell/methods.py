"""The closed forms beside the weighted refinement: the table of a result, and one of them as the answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.fitted import mounting, robot_side
from calibrant.calibrate.cell.problem.problem import Cell
from calibrant.calibrate.cell.starts.seed import compare_methods, mean_of_methods, method_result
from calibrant.calibrate.solvers.registry import JOINT, MEAN
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.data import CalibrationResult, Check, MethodResult, as_transform, verdict_of
from calibrant.errors import RefusedError
from calibrant.geometry import se3
from calibrant.optimize.solution import Solution


def normal_pairs(cell: Cell, solution: Solution, i: int) -> tuple[Array, Array]:
    """A and B (n, 4, 4) of the used rows of list i, a hand-eye problem of its own; joint offsets applied."""
    p, data = cell.layout.pictures[i], cell.data[i]
    A = get_setup(p.setup).normal_form(robot_side(cell, solution.value, i, data.use))
    return A, data.B[data.use]


def methods_table(cell: Cell, solution: Solution) -> Mapping[str, MethodResult]:
    """Every method for each list of pictures that is a hand-eye problem of its own.

    With several lists names have the list's in front: "left: park".
    """
    out: dict[str, MethodResult] = {}
    for i, p, data in cell.lists:
        if not p.alone or data.use.sum() < 3:
            continue
        A, B = normal_pairs(cell, solution, i)
        table = compare_methods(A, B)
        table[MEAN] = mean_of_methods(A, B, table)
        table[JOINT] = method_result(A, B, mounting(cell, solution.value, p))
        label = cell.layout.label(i)
        out |= {f"{label}: {name}" if label else name: row for name, row in table.items()}
    return out


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
    mm, deg = se3.deviation(camera.matrix, X)
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
