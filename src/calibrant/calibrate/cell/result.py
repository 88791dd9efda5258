"""The result of a cell: transforms with their common covariance, views, sizes, held-out error, checks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell import checks as questions
from calibrant.calibrate.cell.certainty.image_causes import no_cause_repeats
from calibrant.calibrate.cell.certainty.lens import along_with
from calibrant.calibrate.cell.certainty.touched import touch_checks
from calibrant.calibrate.cell.certainty.whole import Certainty
from calibrant.calibrate.cell.certainty_checks import arm_errors_record, certainty_checks, named
from calibrant.calibrate.cell.checks import LoopDeviations
from calibrant.calibrate.cell.clocks import clocks_found
from calibrant.calibrate.cell.fitted import fitted_cameras, fitted_transforms, said_poses
from calibrant.calibrate.cell.held_out import leave_out, loop_deviations, loop_of_list
from calibrant.calibrate.cell.held_out_chance import held_out_chance
from calibrant.calibrate.cell.methods import methods_table
from calibrant.calibrate.cell.noise_figures import noise_by_name, robot_parameters, sigma_px, sigma_robot
from calibrant.calibrate.cell.problem.groups import geometry_variable, lens_variable, pictures_factor
from calibrant.calibrate.cell.problem.layout import HANDHELD, Frame, Layout, variable
from calibrant.calibrate.cell.problem.problem import Cell
from calibrant.calibrate.cell.rig_checks import held_out_moments, rig_checks, shared_moments, together
from calibrant.calibrate.cell.sizes import Sizes
from calibrant.calibrate.cell.starts.cell import CellStart
from calibrant.calibrate.reprojection.in_fit import seen_in_fit
from calibrant.calibrate.reprojection.links import Link, link_maps, product
from calibrant.calibrate.reprojection.view_results import fitted_view, unused_view
from calibrant.data import (
    CalibrationResult,
    Check,
    HeldOut,
    JointCovariance,
    Observations,
    RobotPoses,
    TransformEstimate,
    ViewResult,
    as_transform,
    verdict_of,
)
from calibrant.optimize.noise import NoiseEstimate
from calibrant.optimize.solution import Solution


def cell_result(
    cell: Cell,
    start: CellStart,
    noise: NoiseEstimate,
    sizes: Sizes,
    certainty: Certainty,
    left_out: Sequence[ViewResult],
    numbering: Sequence[Check],
    asked: Mapping[str, Any],
) -> CalibrationResult:
    """The result, whose verdict follows from its checks. asked: options that are not in the layout."""
    solution, layout = noise.solution, cell.layout
    held = leave_out(cell, solution)
    seen, squares = _cell_views(cell, solution)
    views = (*seen, *left_out)
    transforms = _transforms(cell, solution)
    checks = _checks(cell, start, noise, certainty, held, views, transforms, sizes, numbering)
    plain = cell.layout.plain and not cell.free
    measured = [d.B for p, d in zip(layout.pictures, cell.data) if p.seen is None]
    return CalibrationResult(
        kind="rig" if layout.rig else "hand-eye",
        verdict=verdict_of(checks),
        checks=checks,
        cameras=fitted_cameras(cell, solution),
        transforms=transforms,
        joint_covariance=_covariance_of_all(cell, solution),
        rms_px=float(np.sqrt(squares.mean())) if len(squares) else None,
        sigma_px=sigma_px(cell, noise),
        sigma_robot=sigma_robot(cell, noise, next(iter(layout.robots))) if len(layout.robots) == 1 else None,
        views=views,
        methods=methods_table(cell, solution),
        target_scale=sizes.targets.get(layout.target_names[0]) if len(layout.target_names) == 1 else None,
        held_out=None if held is None else HeldOut(*held.rms, held.rms_px),
        options=_asked(cell, asked),
        decided=_decided(cell),
        cell=None if plain else noise_by_name(cell, noise),
        details=(
            *robot_parameters(cell, solution),
            *arm_errors_record(cell, solution, certainty),
            *([clocks] if (clocks := clocks_found(cell, solution)) else []),
            *([shared] if (shared := shared_moments(cell)) else []),
        ),
        figures=held_out_moments(cell, solution),
        observations=_observations(layout),
        robot_poses=_poses(cell, solution),
        T_camera_target=measured[0] if len(measured) == len(cell.data) == 1 else None,
    )


def along_with_lenses(
    reviewed: CalibrationResult, found: CalibrationResult, cell: Cell, solution: Solution
) -> CalibrationResult:
    """The reviewed result, whose transforms hold what the review added to the lenses that they rest on.

    An error of the lens moves all else along, as the fit has it: C + K (C_reviewed - C_found) K^T, K = C_xl C_ll^-1.
    found: the result of the solution, before its review.
    """
    beside: Array = np.zeros_like(solution.shared_covariance)
    for name, camera in reviewed.cameras.items():
        before = found.cameras[name].covariance
        if camera.covariance is not None and before is not None and camera.covariance is not before:
            beside = beside + along_with(solution, lens_variable(name), camera.covariance - before)
    if not np.any(beside):
        return reviewed
    held = solution.with_beside(beside if solution.beside is None else solution.beside + beside)
    transforms = _transforms(cell, held)
    said = {c.name: c for c in _position_checks(cell, transforms)}
    return replace(
        reviewed,
        cameras=fitted_cameras(cell, held),
        transforms=transforms,
        joint_covariance=_covariance_of_all(cell, held),
        checks=tuple(said.get(c.name, c) for c in reviewed.checks),
    )


def _asked(cell: Cell, asked: Mapping[str, Any]) -> dict[str, Any]:
    """What was asked; the setup of a single list in a word, else by camera; a rig has but one."""
    pictures = cell.layout.pictures
    if cell.layout.rig:
        return {"reference": cell.layout.root, **asked}
    named = {p.camera: p.setup for p in pictures if p.handheld} | {
        p.camera: p.setup for p in pictures if not p.handheld
    }
    setup = pictures[0].setup if len(pictures) == 1 else {c: named[c] for c in cell.layout.cameras}
    return {"setup": setup, **asked}


def _decided(cell: Cell) -> dict[str, str]:
    """Where each camera comes from."""
    cameras = cell.layout.cameras
    words = dict.fromkeys(cameras, "none: target poses were given")
    words |= {c: role.words for c, role in cell.roles.items()}
    return {"camera" if len(cameras) == 1 else f"camera {c}": text for c, text in words.items()}


def _checks(
    cell: Cell,
    start: CellStart,
    noise: NoiseEstimate,
    certainty: Certainty,
    held: LoopDeviations | None,
    views: Sequence[ViewResult],
    transforms: Sequence[TransformEstimate],
    sizes: Sizes,
    numbering: Sequence[Check],
) -> tuple[Check, ...]:
    """Everything that is asked of the result; questions to a list carry its name where there are several."""
    solution = noise.solution
    loop = loop_deviations(cell, solution.value, [d.use for d in cell.data])
    several = len(cell.roles) > 1
    return (
        *_start_checks(cell, start, numbering),
        questions.views_check(views),
        *_loop_checks(cell, start, solution),
        *(together(cell, noise, name) for name in cell.roles if several),
        *rig_checks(cell, start, noise),
        *touch_checks(cell, noise),
        *_held_out_checks(cell, solution, held, loop),
        *_size_checks(cell, sizes, loop),
        *_image_checks(cell, noise, sizes),
        *certainty_checks(cell, solution, certainty),
        *_position_checks(cell, transforms),
        *(_joints(cell, solution, robot) for robot in cell.free),
        questions.convergence_check(solution, noise.settled, noise.rounds),
    )


def _start_checks(cell: Cell, start: CellStart, numbering: Sequence[Check]) -> Iterable[Check]:
    """What was asked before the fit: the motions, the boards' numbering, the setups."""
    label = cell.layout.label
    for i, alone in sorted(start.alone.items()):
        yield from (named(c, label(i)) for c in questions.motion_checks(alone.report))
    yield from (named(questions.through_others_check(start.refused[i]), label(i)) for i in sorted(start.refused))
    yield from numbering
    yield from (named(alone.setup, label(i)) for i, alone in sorted(start.alone.items()))


def _loop_checks(cell: Cell, start: CellStart, solution: Solution) -> Iterable[Check]:
    """The loop of every list with a robot between camera and target."""
    for i, p, data in cell.lists:
        if not p.movers or not data.use.any():
            continue
        loop = loop_of_list(cell, solution.value, i)
        alone, score = start.alone.get(i), questions.loop_score(loop, data.B[data.use])
        if alone is not None and len(cell.data) == 1:
            # The start refuses a list that contradicts itself. What agrees by its medians may be too little to fit.
            score = max(alone.seed.loop.score, questions.LOOP_FAIL if score > questions.LOOP_FAIL else 0.0)
        elif alone is not None:
            # What a list says by itself does not show that it contradicts the others.
            score = max(alone.seed.loop.score, score)
        yield named(questions.loop_check(loop, score), cell.layout.label(i))


def _joints(cell: Cell, solution: Solution, robot: str) -> Check:
    found = cell.free[robot].parameters(solution, geometry_variable(robot))
    return named(questions.joints_check(found), robot if len(cell.free) > 1 else "")


def _size_checks(cell: Cell, sizes: Sizes, loop: LoopDeviations) -> Iterable[Check]:
    if cell.layout.rig:  # images alone have no size of their own
        return
    targets = cell.layout.target_names
    at_size = next(iter(sizes.loops.values())).rms if len(cell.data) == 1 and sizes.loops else None
    for target in targets:
        loose = all(p.handheld for p in cell.layout.pictures if p.target == target)
        if loose and target not in sizes.targets:  # the cameras that see it stand by nothing that has a size
            continue
        yield named(questions.scale_check(sizes.targets.get(target), at_size, loop), target if len(targets) > 1 else "")


def _held_out_checks(
    cell: Cell, solution: Solution, held: LoopDeviations | None, loop: LoopDeviations
) -> Iterable[Check]:
    if held is None or not len(held.mm):
        return
    ratio = questions.held_out_ratio(held, loop)
    chance = held_out_chance(cell, solution, ratio) if ratio > questions.HELD_OUT_FACTOR else None
    yield questions.held_out_check(held, loop, chance)


def with_images_judged(result: CalibrationResult, cell: Cell, noise: NoiseEstimate, sizes: Sizes) -> CalibrationResult:
    """The reviewed result, images that err as a whole judged by what the review found of their causes."""
    if not no_cause_repeats(result, [name for name, role in cell.roles.items() if role.prior is not None]):
        return result
    judged = {c.name: c for c in _image_checks(cell, noise, sizes, repeats=False)}
    checks = tuple(judged.get(c.name, c) for c in result.checks)
    return replace(result, checks=checks, verdict=verdict_of(checks))


def _image_checks(cell: Cell, noise: NoiseEstimate, sizes: Sizes, *, repeats: bool = True) -> Iterable[Check]:
    for i, found in sorted(sizes.images.items()):
        robot = sigma_robot(cell, noise, cell.layout.pictures[i].robot)
        role = cell.roles.get(cell.layout.pictures[i].camera)
        given = role is not None and (role.exact or role.prior is not None)
        checks = questions.image_poses_check(found, robot, repeats=repeats, given=given)
        yield from (named(c, cell.layout.label(i)) for c in checks)


def _position_checks(cell: Cell, transforms: Sequence[TransformEstimate]) -> Iterable[Check]:
    """How certain each camera's position is."""
    layout = cell.layout
    cameras = [t for t in transforms if t.child in layout.cameras and (t.parent, t.child) in layout.unknown]
    yield from (named(questions.certainty_check(t), t.child if len(cameras) > 1 else "") for t in cameras)


def _transforms(cell: Cell, solution: Solution) -> tuple[TransformEstimate, ...]:
    """All unknown transforms, then T_a_b of every two cameras on one body, with the covariance that both share."""
    out = [
        as_transform(*frame, T, solution.covariance(variable(frame)))
        for frame, T in fitted_transforms(cell, solution).items()
    ]
    cameras = [f for f in cell.layout.unknown if f[1] in cell.layout.cameras]
    return (*out, *(_between(solution, a, b) for a, b in combinations(cameras, 2) if a[0] == b[0]))


def _between(solution: Solution, a: Frame, b: Frame) -> TransformEstimate:
    """T_a_b = T_parent_a^-1 T_parent_b with its covariance."""
    once = np.zeros(1, dtype=np.int64)
    links = [Link(variable(a), once, inverted=True), Link(variable(b), once)]
    values = [solution.value(k.variable) for k in links]
    J = np.concatenate([M[0] for M in link_maps(links, values)], axis=1)
    C = J @ solution.joint_covariance([(k.variable, 0) for k in links]) @ J.T
    return as_transform(a[1], b[1], product(links, values)[0], C)


def _covariance_of_all(cell: Cell, solution: Solution) -> JointCovariance:
    """All transforms; with several cameras, all lenses too: what one sees of the other's error in stereo."""
    frames = cell.layout.unknown
    there = {v.name for v in solution.problem.variables}
    names = tuple(name for name in cell.roles if lens_variable(name) in there) if len(cell.roles) > 1 else ()
    C = solution.joint_covariance([(variable(f), 0) for f in frames] + [(lens_variable(n), 0) for n in names])
    k = 6 * len(frames)
    if not names:
        return JointCovariance(frames, C)
    return JointCovariance(frames, C[:k, :k], names, C[:k, k:], C[k:, k:])


def _seen(cell: Cell, solution: Solution, i: int) -> list[tuple[Array, Array]]:
    """Squared residuals of list i's used views and where the target was when each was taken."""
    found, p = seen_in_fit(solution, pictures_factor(i)), cell.layout.pictures[i]
    if cell.clocks is None or not cell.clocks.displaces(p.camera):
        return found
    moved = cell.clocks.lateness(p.camera, cell.layout.carrier(p), cell.layout.target(p), cell.used_ids(i))
    return [(squares, T @ D) for (squares, T), D in zip(found, moved)]


def _cell_views(cell: Cell, solution: Solution) -> tuple[list[ViewResult], Array]:
    """Every view with its residual in the fit, and the squared residual norms (N,) of all points, px^2."""
    out: list[ViewResult] = []
    every = [np.zeros(0)]
    for i, p, data in cell.lists:
        if p.seen is None:
            out += [
                ViewResult(name, bool(use), 0, reason=reason, camera=p.camera, T_camera_target=B)
                for name, use, reason, B in zip(data.ids, data.use, data.reasons, data.B)
            ]
            continue
        found = _seen(cell, solution, i) if data.use.any() else []
        far = max((float(np.sqrt(squares.max())) for squares, _ in found), default=0.0)
        fitted = iter(found)
        total = {v.id: len(v) for v in p.seen.views}
        for view, use, reason, B in zip(data.views or (), data.use, data.reasons, data.B):
            if not use:
                out.append(unused_view(view, reason, B))
                continue
            squares, T = next(fitted)
            every.append(squares)
            out.append(fitted_view(view, squares, T, total=total.get(view.id, len(view)), limit_px=far, remark=reason))
    return out, np.concatenate(every)


def _observations(layout: Layout) -> Observations | None:
    """All cameras' views; their moments are the ids of the result's robot poses."""
    lists = [(p, p.seen) for p in layout.pictures if p.seen is not None]
    if len(lists) <= 1:
        return lists[0][1] if lists else None
    views = [v for p, seen in lists for v in _as_moments(layout, p.robot, seen).views]
    sizes = {c: s for _, seen in lists for c, s in seen.image_sizes.items()}
    missed = tuple(m for _, seen in lists for m in seen.missed)
    specs = {seen.target for _, seen in lists}
    notes = tuple(dict.fromkeys(n for _, seen in lists for n in seen.notes))
    return Observations(tuple(views), sizes, specs.pop() if len(specs) == 1 else None, missed, notes)


def _as_moments(layout: Layout, robot: str, observations: Observations) -> Observations:
    """The views with moments that no other robot's poses, and no other hand's moments, are called by."""
    if layout.rig or (len(layout.robots) == 1 and robot):
        return observations
    by = robot or HANDHELD
    return replace(observations, views=tuple(replace(v, moment=f"{by}/{v.moment}") for v in observations.views))


def _poses(cell: Cell, solution: Solution) -> RobotPoses | None:
    """The poses that the fit rests on, joint offsets applied; with several robots, each in its own base; None for a
    rig."""
    robots = cell.layout.robots
    if not robots:
        return None
    if len(robots) == 1 and not cell.free:
        return next(iter(robots.values()))
    ids = [i if len(robots) == 1 else f"{r}/{i}" for r, poses in robots.items() for i in poses.ids]
    T = np.concatenate([said_poses(cell, solution.value, r) for r in robots])
    source = "joint offsets applied" if cell.free else "; ".join(p.source for p in robots.values() if p.source)
    return RobotPoses(tuple(ids), T, source)
