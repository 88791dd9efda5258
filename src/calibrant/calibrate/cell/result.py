"""The result of several cameras and robots: transforms with their joint covariance, views, held-out error, checks."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.cell.held_out import CLOSE_ENOUGH
from calibrant.calibrate.cell.held_out import rms_px as _rms_of
from calibrant.calibrate.cell.problem.checks import LoopDeviations, several_checks
from calibrant.calibrate.cell.problem.layout import STANDING, Frame, Layout, Pictures, variable
from calibrant.calibrate.cell.problem.problem import (
    Several,
    fitted_cameras,
    fitted_transforms,
    geometry_variable,
    joint_group,
    pictures_factor,
    pixel_group,
    pose_noise,
    prediction,
    robot_groups,
    said_poses,
    scale_variable,
    several_problem,
)
from calibrant.calibrate.cell.starts.seed import compare_methods, mean_of_methods, method_result
from calibrant.calibrate.cell.views import HandEyeViews
from calibrant.calibrate.reprojection.links import Link, link_maps, product
from calibrant.calibrate.reprojection.outliers import points_reason
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.data import (
    CalibrationResult,
    CellLayout,
    HeldOut,
    JointCovariance,
    Measured,
    MethodResult,
    Observations,
    PictureList,
    RobotPoses,
    SigmaRobot,
    TransformEstimate,
    ViewResult,
    as_transform,
    verdict_of,
)
from calibrant.data.details import RobotParameter, RobotParameters
from calibrant.geometry import se3
from calibrant.optimize.levenberg_marquardt import solve
from calibrant.optimize.noise import NoiseEstimate, NoiseLevel
from calibrant.optimize.problem import Problem, Values
from calibrant.optimize.solution import Solution

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FOLDS = 10
"""Groups that are held out one after the other: a tenth less data costs no more than the tenth of a sigma."""


def several_result(
    several: Several, noise: NoiseEstimate, left_out: Sequence[ViewResult], options: Mapping[str, Any]
) -> CalibrationResult:
    """The result, whose verdict follows from its checks."""
    solution, layout = noise.solution, several.layout
    loop = _deviations(several, solution, [d.use for d in several.data])
    held = _held_out(several, solution)
    views = (*_views(several, solution), *left_out)
    transforms, scales = _transforms(several, solution), _scales(several, solution)
    checks = several_checks(several, noise, loop, held, views, transforms, scales)
    levels = noise.levels
    return CalibrationResult(
        kind="hand-eye",
        verdict=verdict_of(checks),
        checks=checks,
        cameras=fitted_cameras(several, solution),
        transforms=transforms,
        joint_covariance=_joint(several, solution),
        rms_px=_rms_px(several, solution),
        sigma_px=_pooled([levels[pixel_group(c)] for c in layout.cameras]),
        sigma_robot=_sigma_robot(several, noise, next(iter(layout.robots))) if len(layout.robots) == 1 else None,
        views=views,
        methods=_methods(several, solution),
        target_scale=next(iter(scales.values())) if len(scales) == 1 else None,
        held_out=None if held is None else HeldOut(*held.rms, held.rms_px),
        options=options,
        cell=_cell_layout(several, noise),
        details=_robot_parameters(several, noise),
        observations=_observations(layout),
        robot_poses=_poses(several, solution),
    )


def _methods(several: Several, solution: Solution) -> dict[str, MethodResult]:
    """The table of a single camera for each list of pictures that is a hand-eye problem of its own; names have the
    list's in front: "left: park"."""
    out: dict[str, MethodResult] = {}
    for p, data in zip(several.layout.pictures, several.data):
        if len(p.movers) != 1 or data.use.sum() < 3:
            continue
        setup = get_setup(p.setup)
        A, B = setup.normal_form(_said_at(several, solution, p.robot, data)), data.B[data.use]
        table = compare_methods(A, B)
        table["mean"] = mean_of_methods(A, B, table)
        table["joint"] = method_result(A, B, _camera_at(several, solution, p))
        label = p.camera if len(several.layout.robots) == 1 else f"{p.camera} at {p.robot}"
        out |= {f"{label}: {name}": row for name, row in table.items()}
    return out


def _said_at(several: Several, solution: Solution, robot: str, data: HandEyeViews) -> Array:
    """T_base_gripper of the used rows, joint offsets applied."""
    index = {name: k for k, name in enumerate(several.layout.robots[robot].ids)}
    return said_poses(several, solution, robot)[[index[i] for i, use in zip(data.ids, data.use) if use]]


def _camera_at(several: Several, solution: Solution, p: Pictures) -> Array:
    """X of these pictures' own problem: the camera in the gripper, or in this robot's base."""
    layout, (at, camera) = several.layout, several.layout.constants(p)[0]
    X = solution.value(variable((layout.camera_parent(p), camera)))[0]
    if at == layout.camera_parent(p):
        return X
    return np.asarray(se3.inverse(solution.value(variable((layout.root, at)))[0]) @ X)


def _scales(several: Several, solution: Solution) -> dict[str, Measured]:
    """Scale of each target by the robots' motion, all else as fitted; empty where the motions do not tell them."""
    problem = several_problem(several, fitted_transforms(several, solution), solution.sigmas, free_scale=True)
    targets = {scale_variable(p.target): p.target for p in several.layout.pictures}
    start = _nearest_start(problem, solution, new=targets)
    freed = solve(problem, start=start, options=CLOSE_ENOUGH)
    if freed.unobservable:
        return {}
    there = {v.name for v in problem.variables}
    return {
        target: Measured(1 + float(freed.value(name)[0, 0]), float(np.sqrt(freed.covariance(name)[0, 0])))
        for name, target in targets.items()
        if name in there
    }


def _transforms(several: Several, solution: Solution) -> tuple[TransformEstimate, ...]:
    """All unknown transforms, then T_a_b of every two cameras on one body, with the covariance that both share."""
    out = [
        as_transform(*frame, T, solution.covariance(variable(frame)))
        for frame, T in fitted_transforms(several, solution).items()
    ]
    cameras = [f for f in several.layout.unknown if f[1] in several.layout.cameras]
    for a, b in combinations(cameras, 2):
        if a[0] == b[0]:
            out.append(_between(solution, a, b))
    return tuple(out)


def _between(solution: Solution, a: Frame, b: Frame) -> TransformEstimate:
    """T_a_b = T_parent_a^-1 T_parent_b with its covariance."""
    once = np.zeros(1, dtype=np.int64)
    chain = [Link(variable(a), once, inverted=True), Link(variable(b), once)]
    values = [solution.value(k.variable) for k in chain]
    J = np.concatenate([M[0] for M in link_maps(chain, values)], axis=1)
    C = J @ solution.joint_covariance([(k.variable, 0) for k in chain]) @ J.T
    return as_transform(a[1], b[1], product(chain, values)[0], C)


def _joint(several: Several, solution: Solution) -> JointCovariance:
    frames = several.layout.unknown
    return JointCovariance(frames, solution.joint_covariance([(variable(f), 0) for f in frames]))


def _deviations(several: Several, solution: Solution, rows: Sequence[Mask]) -> LoopDeviations:
    """Of these rows of every list; standing cameras have no loop."""
    deltas, px = [np.zeros((0, 6))], [np.zeros(0)]
    cameras = fitted_cameras(several, solution)
    for i, (p, r) in enumerate(zip(several.layout.pictures, rows)):
        if p.setup == STANDING or not r.any():
            continue
        T, _ = prediction(several, solution, i, r)
        deltas.append(se3.local(T, several.data[i].B[r]))
        seen = [v for v, wanted in zip(several.data[i].views or (), r) if wanted]
        px.append(np.array([_rms_of(cameras[p.camera], v, pose) for v, pose in zip(seen, T)]))
    d = np.concatenate(deltas)
    mm, deg = 1e3 * np.linalg.norm(d[:, 3:], axis=1), np.rad2deg(np.linalg.norm(d[:, :3], axis=1))
    return LoopDeviations(mm, deg, np.concatenate(px))


def _held_out(several: Several, solution: Solution) -> LoopDeviations | None:
    """Errors of views whose moments were left out of the fit, its noise levels kept; None with too few moments."""
    moments = sorted({(p.robot, m) for p in several.layout.pictures if p.movers for m in several.moments(p.robot)})
    folds = min(FOLDS, len(moments))
    if folds < 4:
        return None
    fold = {moment: k % folds for k, moment in enumerate(moments)}
    transforms, parts = fitted_transforms(several, solution), []
    for k in range(folds):
        out = [
            np.array([use and fold.get((p.robot, name), -1) == k for name, use in zip(d.ids, d.use)], dtype=bool)
            & (p.setup != STANDING)
            for p, d in zip(several.layout.pictures, several.data)
        ]
        rest = several.kept([~o for o in out])
        if any(before.use.any() and not after.use.any() for before, after in zip(several.data, rest.data)):
            return None
        problem = several_problem(rest, transforms, solution.sigmas)
        without = solve(problem, start=_nearest_start(problem, solution), options=CLOSE_ENOUGH)
        if without.unobservable:
            return None
        parts.append(_deviations(several, without, out))
    mm, deg, px = (np.concatenate([getattr(p, name) for p in parts]) for name in ("mm", "deg", "px"))
    return LoopDeviations(mm, deg, px)


def _nearest_start(problem: Problem, fit: Solution, new: Collection[str] = ()) -> Values:
    """Values of the problem's unknowns as fitted with more views, moment by moment; `new` ones as they are."""
    out = []
    for v in problem.variables:
        if v.name in new:
            out.append(v.values)
            continue
        values = fit.value(v.name)
        if len(values) != v.count:
            whole = fit.problem.variables[fit.problem.variable_index(v.name)]
            index = {label: k for k, label in enumerate(whole.labels or ())}
            values = values[[index[label] for label in v.labels or ()]]
        out.append(values)
    return tuple(out)


def _views(several: Several, solution: Solution) -> list[ViewResult]:
    out = []
    for i, (p, data) in enumerate(zip(several.layout.pictures, several.data)):
        views = several.used_views(i)
        squares, poses = _fit_of(solution, i) if views else (np.zeros(0), np.zeros((0, 4, 4)))
        parts = iter(np.split(squares, np.cumsum([len(v) for v in views])[:-1]) if views else ())
        refined = iter(poses)
        total = {v.id: len(v) for v in p.observations.views}
        for view, use, reason, B in zip(data.views or (), data.use, data.reasons, data.B):
            if not use:
                out.append(ViewResult(view.id, False, len(view), None, reason, p.camera, 0, B))
                continue
            squares_here = next(parts)
            lost = total.get(view.id, len(view)) - len(view)
            far = float(np.sqrt(squares_here.max()))
            words = reason or (points_reason(lost, len(view) + lost, far) if lost else None)
            rms = float(np.sqrt(squares_here.mean()))
            out.append(ViewResult(view.id, True, len(view), rms, words, p.camera, lost, next(refined)))
    return out


def _fit_of(solution: Solution, i: int) -> tuple[Array, Array]:
    """Squared residual norms (N,), px^2, and T_camera_target (m, 4, 4) of list i in the joint fit."""
    k = solution.problem.factor_index(pictures_factor(i))
    factor = solution.problem.factors[k]
    T = factor.T_camera_target(*solution.problem.gather(k, solution.values))  # type: ignore[attr-defined]
    return np.sum(solution.residuals(pictures_factor(i)) ** 2, axis=1), T


def _rms_px(several: Several, solution: Solution) -> float:
    lists = [i for i in range(len(several.data)) if several.used_views(i)]
    return float(np.sqrt(np.concatenate([_fit_of(solution, i)[0] for i in lists]).mean()))


def _pooled(levels: Sequence[NoiseLevel]) -> float:
    """One noise level for the reader: the mean square over what each camera's rests on."""
    weight = np.array([level.redundancy for level in levels])
    return float(np.sqrt(np.sum(weight * [level.sigma**2 for level in levels]) / weight.sum()))


def _sigma_robot(several: Several, noise: NoiseEstimate, robot: str) -> SigmaRobot | None:
    """Noise of a robot's poses, that of its joints with it: root mean square over its poses and axes."""
    levels = noise.levels
    rotation, translation = (levels.get(g) for g in robot_groups(robot))
    if rotation is None or translation is None:
        return None
    C = pose_noise(several, noise.solution, robot).mean(axis=0)
    joint = levels.get(joint_group(robot))
    deg, deg_sigma = _with_joints(rotation, joint, float(np.trace(C[:3, :3])) / 3)
    mm, mm_sigma = _with_joints(translation, joint, float(np.trace(C[3:, 3:])) / 3)
    return SigmaRobot(
        1e3 * mm,
        float(np.rad2deg(deg)),
        None if mm_sigma is None else 1e3 * mm_sigma,
        None if deg_sigma is None else float(np.rad2deg(deg_sigma)),
    )


def _with_joints(own: NoiseLevel, joint: NoiseLevel | None, variance: float) -> tuple[float, float | None]:
    """Root of a variance s^2 = own^2 + by joints^2, and its deviation, 4 s^2 var(s) = var(own^2) + var(by joints^2)."""
    known = [own.sigma**2 * own.deviation**2] if np.isfinite(own.deviation) else []
    if joint is not None and joint.sigma > 0 and np.isfinite(joint.deviation):
        known.append((max(variance - own.sigma**2, 0.0) * joint.deviation / joint.sigma) ** 2)
    sigma = float(np.sqrt(variance))
    return sigma, float(np.sqrt(sum(known)) / sigma) if known and sigma > 0 else None


def _cell_layout(several: Several, noise: NoiseEstimate) -> CellLayout:
    """Who stands where, and the noise by camera and robot, which the one number of a result cannot hold."""
    layout = several.layout
    robots = {r: _sigma_robot(several, noise, r) for r in layout.robots} if len(layout.robots) > 1 else {}
    joints = {r: noise.levels.get(joint_group(r)) for r in several.free}
    return CellLayout(
        tuple(PictureList(p.camera, p.robot, p.setup, p.target, p.other) for p in layout.pictures),
        {c: noise.levels[pixel_group(c)].sigma for c in layout.cameras} if len(layout.cameras) > 1 else {},
        {r: sigma for r, sigma in robots.items() if sigma is not None},
        {r: float(np.rad2deg(level.sigma)) for r, level in joints.items() if level is not None},
    )


def _robot_parameters(several: Several, noise: NoiseEstimate) -> tuple[RobotParameters, ...]:
    """The robots' own errors; nothing where no joints were free."""
    robots = {
        robot: tuple(
            RobotParameter(
                p.parameter.name, p.parameter.unit, p.correction, p.sigma, p.reason if p.sigma is None else None
            )
            for p in free.parameters(noise.solution, geometry_variable(robot))
        )
        for robot, free in several.free.items()
    }
    return (RobotParameters(robots),) if robots else ()


def _observations(layout: Layout) -> Observations:
    """All cameras' views; their moments are the ids of the result's robot poses."""
    views = [v for p in layout.pictures for v in _as_moments(layout, p.robot, p.observations).views]
    sizes = {c: s for p in layout.pictures for c, s in p.observations.image_sizes.items()}
    missed = tuple(m for p in layout.pictures for m in p.observations.missed)
    specs = {p.observations.target for p in layout.pictures}
    return Observations(tuple(views), sizes, specs.pop() if len(specs) == 1 else None, missed)


def _as_moments(layout: Layout, robot: str, observations: Observations) -> Observations:
    if len(layout.robots) == 1:
        return observations
    return replace(observations, views=tuple(replace(v, moment=f"{robot}/{v.moment}") for v in observations.views))


def _poses(several: Several, solution: Solution) -> RobotPoses:
    """The poses that the fit rests on, joint offsets applied; with several robots, each in its own base."""
    robots = several.layout.robots
    ids = [i if len(robots) == 1 else f"{r}/{i}" for r, poses in robots.items() for i in poses.ids]
    T = np.concatenate([said_poses(several, solution, r) for r in robots])
    source = "joint offsets applied" if several.free else "; ".join(p.source for p in robots.values() if p.source)
    return RobotPoses(tuple(ids), T, source)
