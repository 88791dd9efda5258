"""Held-out error: calibrate without a moment, then ask where its views see the target.

Every moment (a pose of a robot, with all that was seen there) is held out once, alone up to `ALONE` moments and in
`GROUPS` groups beyond. The noise levels stay those of the full fit; the solve starts from it, and where one step leads
to its end that step is the full fit's equations less what the poses held out have in them (`fit_without`).

A view that was left out sees its target by the lens of the fit without it, as any new photo does: by the lens of the
full fit, the difference between the two lenses, millimetres for few views, would count as an error of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array, Mask
from calibrant.calibrate.cell.checks import LoopDeviations
from calibrant.calibrate.cell.fitted import Value, fitted_places, prediction
from calibrant.calibrate.cell.problem.fit_without import PoseShares, pose_shares
from calibrant.calibrate.cell.problem.groups import lens_variable
from calibrant.calibrate.cell.problem.layout import poses_variable
from calibrant.calibrate.cell.problem.problem import Cell, cell_problem
from calibrant.cameras import Camera
from calibrant.cancel import checkpoint
from calibrant.data import View
from calibrant.geometry import se3
from calibrant.optimize import linear
from calibrant.optimize.levenberg_marquardt import CLOSE_ENOUGH, solve
from calibrant.optimize.problem import Problem, Values
from calibrant.optimize.solution import Solution

ALONE = 30
GROUPS = 10
"""A tenth less data changes the errors of more than thirty poses by a twentieth at most: no need to go one by one."""
NEAR = 5.0
"""Decrease of the cost, half of the squared distance in sigmas: within three sigma the problem is as good as linear, as
a sigma is thousandths of the distances and angles that it is bent by."""


def loop_deviations(cell: Cell, value: Value, rows: Sequence[Mask]) -> LoopDeviations:
    """How far these rows of every list, one mask each, are from where the robots put them."""
    deltas, px = [np.zeros((0, 6))], []
    for i, p, data in cell.lists:
        if not p.movers or not rows[i].any():  # no robot stands between: there is no loop
            continue
        T = prediction(cell, value, i, rows[i])
        deltas.append(se3.local(T, data.B[rows[i]]))
        if data.views is not None:
            camera = _lens(cell, value, p.camera)
            px += [rms_px(camera, data.views[int(k)], pose) for k, pose in zip(np.flatnonzero(rows[i]), T)]
    mm, deg = se3.mm_and_deg(np.concatenate(deltas))
    return LoopDeviations(mm, deg, np.array(px))


def loop_of_list(cell: Cell, value: Value, i: int) -> LoopDeviations:
    """How far the used views of list i are from where the robots put them."""
    return loop_deviations(
        cell, value, [d.use if k == i else np.zeros(len(d), dtype=bool) for k, d in enumerate(cell.data)]
    )


def leave_out(cell: Cell, fit: Solution) -> LoopDeviations | None:
    """Errors of views whose moments were left out of the fit; None where none can be left out.

    A moment that alone holds a list of pictures is not left out: nothing would tell where its camera is.
    """
    numbers = folds(cell)
    count = 1 + max((int(f.max()) for f in numbers if len(f)), default=-1)
    shares, parts = _shares(cell, fit), []
    for k in range(count):
        checkpoint()
        out = [f == k for f in numbers]
        if any(d.use.any() and not (d.use & ~o).any() for d, o in zip(cell.data, out)):
            continue
        value = _without(cell, fit, shares, out)
        parts.append(loop_deviations(_seen_by(cell, value, out), value, out))
    if not parts:
        return None
    mm, deg, px = (np.concatenate([getattr(p, name) for p in parts]) for name in ("mm", "deg", "px"))
    return LoopDeviations(mm, deg, px)


def _seen_by(cell: Cell, value: Value, rows: Sequence[Mask]) -> Cell:
    """The cell whose rows, one mask a list, see their targets by these lenses where photos determine the lenses."""
    from calibrant.calibrate.pose.target_poses import poses_from  # not needed for pose pairs

    data = list(cell.data)
    for i, p, own in cell.lists:
        out = rows[i]
        if own.views is None or not p.movers or not out.any() or cell.roles[p.camera].exact:
            continue
        B = own.B.copy()
        B[out] = poses_from(_lens(cell, value, p.camera), [v for v, k in zip(own.views, out) if k], own.B[out])
        data[i] = replace(own, B=B)
    return replace(cell, data=tuple(data))


def _lens(cell: Cell, value: Value, name: str) -> Camera:
    lens = cell.roles[name].camera
    return Camera(lens.model, lens.image_size, value(lens_variable(name))[0])


def folds(cell: Cell) -> list[NDArray[np.intp]]:
    """The group that each row of every list is held out with; -1 for none."""
    number: dict[tuple[str, str], int] = {}
    for i, p, _ in cell.lists:
        for name in cell.used_ids(i) if p.movers else ():
            number.setdefault((p.robot, name), len(number))
    groups = len(number) if len(number) <= ALONE else GROUPS
    return [
        np.array(
            [number[p.robot, n] % groups if use and p.movers else -1 for n, use in zip(data.ids, data.use)],
            dtype=np.intp,
        )
        for _, p, data in cell.lists
    ]


@dataclass(frozen=True, eq=False)
class _Shares:
    """The shares of one robot's poses in the equations of the fit, and their names."""

    moments: tuple[str, ...]
    of_poses: PoseShares


def _shares(cell: Cell, fit: Solution) -> _Shares | None:
    """None where other unknowns are eliminated with one robot's poses: several robots, free joints, other views,
    handheld targets."""
    robots = [r for r in cell.layout.robots if cell.moments(r)]
    others = cell.layout.handheld or any(role.extra for role in cell.roles.values())
    if len(robots) != 1 or cell.free or others:
        return None
    found = pose_shares(fit, poses_variable(robots[0]))
    return None if found is None else _Shares(cell.moments(robots[0]), found)


def _without(cell: Cell, fit: Solution, shares: _Shares | None, out: Sequence[Mask]) -> Value:
    """The unknowns of a fit without these rows."""
    if shares is not None:
        gone = {n for data, o in zip(cell.data, out) for n, k in zip(data.ids, o) if k}
        end = shares.of_poses.without(np.array([m in gone for m in shares.moments]))
        if end is not None and end[1] <= NEAR:
            return _by_name(fit.problem, end[0])
    rest = cell.kept([~o for o in out])
    problem = cell_problem(rest, fitted_places(cell, fit), fit.sigmas)
    return _by_name(problem, _end(problem, nearest_start(problem, fit)))


def fit_without(cell: Cell, fit: Solution, out: Sequence[Mask]) -> Value:
    """The unknowns of the fit without these rows, one mask a list, by the names of their variables."""
    return _without(cell, fit, _shares(cell, fit), out)


def _by_name(problem: Problem, values: Values) -> Value:
    return lambda name: values[problem.variable_index(name)]


def nearest_start(problem: Problem, fit: Solution) -> Values:
    """Values of the problem's unknowns as fitted with more views, moment by moment; unknowns that are new, as they
    are."""
    known = {v.name: v for v in fit.problem.variables}
    out = []
    for v in problem.variables:
        whole = known.get(v.name)
        if whole is None:
            out.append(v.values)
            continue
        values = fit.value(v.name)
        if len(values) != v.count:
            index = {label: k for k, label in enumerate(whole.labels or ())}
            values = values[[index[label] for label in v.labels or ()]]
        out.append(values)
    return tuple(out)


def _end(problem: Problem, start: Values) -> Values:
    """Where the fit ends: one Gauss-Newton step away, unless what was left out had a large say."""
    step = linear.solve(problem.linearize(start, problem.sigmas), 0.0)
    if step is not None and step.predicted <= NEAR:
        return problem.retract(start, step)
    return solve(problem, start=start, options=CLOSE_ENOUGH).values


def rms_px(camera: Camera, view: View, T_camera_target: Array) -> float:
    """Distance between predicted and observed pixels of a view; points behind the camera count as an image's width."""
    d = view.residuals(camera, T_camera_target)
    d = np.where(np.isfinite(d), d, float(camera.image_size[0]))
    return float(np.sqrt(np.mean(np.sum(d * d, axis=1))))
