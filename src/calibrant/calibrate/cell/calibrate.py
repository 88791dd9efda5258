"""Hand-eye calibration of several cameras and robots in one weighted problem, with the covariance between them.

views of every camera -> a closed-form start by lists of pictures -> joint refinement with all noise levels -> views
that do not belong left out, and again -> held-out error, checks. With joint readings, a robot's own errors (joint
offsets) are found in the same problem.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrant.calibrate.cell.boards.alike import numbered_alike
from calibrant.calibrate.cell.photos import judge
from calibrant.calibrate.cell.problem.camera_role import CameraRole, prior_camera
from calibrant.calibrate.cell.problem.joint_offsets import FreeJoints, JointReadings, free_joints
from calibrant.calibrate.cell.problem.layout import ONLY_ROBOT, STANDING, Frame, Layout, Pictures, id_prefix, layout
from calibrant.calibrate.cell.problem.problem import (
    Several,
    fitted_cameras,
    fitted_transforms,
    floors,
    geometry_variable,
    inconsistent,
    joint_group,
    pixel_group,
    robot_groups,
    several_problem,
)
from calibrant.calibrate.cell.result import several_result
from calibrant.calibrate.cell.starts.cell import several_start
from calibrant.calibrate.cell.views import HandEyeViews, from_observations, match_views
from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Observations, RobotPoses, View, ViewResult, verdict_of
from calibrant.data.verdicts import refuse_if_failed, stamp
from calibrant.errors import InputError, RefusedError
from calibrant.optimize.noise import NoiseEstimate, estimate_noise

Array = NDArray[np.float64]

MAX_CLEANING_ROUNDS = 3
MOST_LEFT_OUT = 1 / 3
"""Where more of a camera's views disagree, the fault is not in single views."""
LEAST_SIGMA_START = 1e-6
"""Start of a noise level when the closed form fits exactly: radians and metres."""


@dataclass(frozen=True, eq=False)
class _Seen:
    """A camera's part: its role, for each of its lists the views that its own calibration kept, and those left out."""

    role: CameraRole
    views: tuple[tuple[View, ...], ...]
    left_out: tuple[ViewResult, ...]


def calibrate_several(
    robots: Mapping[str, RobotPoses] | RobotPoses,
    pictures: Sequence[Pictures],
    *,
    cameras: Mapping[str, Camera] | None = None,
    joints: Mapping[str, JointReadings] | JointReadings | None = None,
    identify: Sequence[str] = ("offsets",),
    model: str = "brown",
    fix: Sequence[str] = (),
) -> CalibrationResult:
    """Find where all cameras, targets and robots are, from one weighted problem.

    Args: robots, poses by robot, or of the only one; pictures, a list of views for each camera, robot and setup;
    cameras, known intrinsics by name, with their covariance where it is known; the others are calibrated from their
    pictures (`model`, `fix`). joints, what the joints read at the poses' ids: then `identify` (offsets, gear, coupling,
    geometry) is found too. Returns a result of kind "hand-eye" with a transform a camera, its `joint_covariance` over
    all transforms, and T_a_b of every two cameras on the same body.
    Raises: InputError for unusable input; RefusedError naming what the pictures do not determine.
    """
    where = layout(robots, _with_own_ids(pictures))
    known = dict(cameras or {})
    stray = [name for name in known if name not in where.cameras]
    if stray:
        raise InputError(
            f"intrinsics of camera {stray[0]!r}, which has no pictures; there are {', '.join(where.cameras)}"
        )
    seen = {name: _seen(where, name, known.get(name), model, fix) for name in where.cameras}
    where, data, numbering = numbered_alike(where, _matched(where, seen))
    free = {name: free_joints(r, identify) for name, r in _readings(where, joints).items()}
    start = several_start(where, data)
    roles = {name: s.role for name, s in seen.items()}
    noise, several = _refine(Several(where, start.data, roles, free), start.transforms, start.spread)
    left_out = tuple(v for s in seen.values() for v in s.left_out)
    options = {
        "setup": {p.camera: p.setup for p in pictures},
        **({"identify": list(identify)} if free else {}),
    }
    decided = {
        f"camera {name}": "given" if name in known else "calibrated from the same images" for name in where.cameras
    }
    result = replace(several_result(several, noise, left_out, options), decided=decided)
    checks = (*numbering, *result.checks)
    result = stamp(replace(result, checks=checks, verdict=verdict_of(checks)))
    refuse_if_failed(result)
    return result


def _with_own_ids(pictures: Sequence[Pictures]) -> list[Pictures]:
    """Views of a camera that stands in several lists get the robot's name in front: ids are unique in a camera."""
    lists = [(p.camera, p.robot) for p in pictures]
    out = []
    for i, p in enumerate(pictures):
        prefix = id_prefix(lists, i)
        rename = [replace(v, id=f"{prefix}{v.id}", camera=p.camera) for v in p.observations.views]
        missed = [replace(m, id=f"{prefix}{m.id}", camera=p.camera) for m in p.observations.missed]
        size = next(iter(p.observations.image_sizes.values()))
        seen = replace(p.observations, views=tuple(rename), image_sizes={p.camera: size}, missed=tuple(missed))
        out.append(replace(p, observations=seen))
    return out


def _seen(where: Layout, name: str, camera: Camera | None, model: str, fix: Sequence[str]) -> _Seen:
    """A camera that is given, or that all its pictures calibrate."""
    lists = [p for p in where.pictures if p.camera == name]
    every = tuple(v for p in lists for v in p.observations.views)
    if camera is not None:
        judged = judge(every, camera)
        role, views, left_out = prior_camera(camera), judged.views, judged.left_out
    else:
        try:
            kept = calibrate_keeping(Observations(every, lists[0].observations.image_sizes), model=model, fix=fix)
        except RefusedError as error:
            raise RefusedError(f"camera {name}: {error}") from error
        held = tuple(n for n, s in kept.result.camera.sigma.items() if s == 0)
        role, views = CameraRole(kept.result.camera, held), kept.views
        left_out = tuple(v for v in kept.result.views if not v.used)
    by_id = {v.id: v for v in views}
    parts = tuple(tuple(by_id[v.id] for v in p.observations.views if v.id in by_id) for p in lists)
    return _Seen(role, parts, tuple(replace(v, camera=name) for v in left_out))


def _matched(where: Layout, seen: Mapping[str, _Seen]) -> tuple[HandEyeViews, ...]:
    """The views of every list with their robot poses and target poses."""
    parts = {name: iter(s.views) for name, s in seen.items()}
    out = []
    for p in where.pictures:
        views = next(parts[p.camera])
        if not views:
            raise RefusedError(f"{p.words}: no picture can be used")
        camera = seen[p.camera].role.camera
        poses = where.robots[p.robot]
        if p.setup == STANDING:
            # No robot stands between camera and target: any pose serves.
            ids = tuple(dict.fromkeys(v.moment for v in views))
            poses = RobotPoses.from_matrices(np.tile(np.eye(4), (len(ids), 1, 1)), ids=ids)
        kept = replace(p.observations, views=views)
        if p.other:
            match_views(where.robots[p.other], kept)
        out.append(from_observations(poses, kept, camera))
    return tuple(out)


def _readings(where: Layout, joints: Mapping[str, JointReadings] | JointReadings | None) -> dict[str, JointReadings]:
    if joints is None:
        return {}
    named = {ONLY_ROBOT: joints} if isinstance(joints, JointReadings) else dict(joints)
    out = {}
    for robot, readings in named.items():
        if robot not in where.robots:
            raise InputError(
                f"joint values of robot {robot!r}, which has no poses; there are {', '.join(where.robots)}"
            )
        out[robot] = readings.only(where.robots[robot].ids)
    return out


def _levels(several: Several, spread: tuple[float, float]) -> dict[str, float]:
    """Noise levels to start from."""
    out = {}
    for p, d in zip(several.layout.pictures, several.data):
        out[pixel_group(p.camera)] = d.sigma_px
    for robot in several.layout.robots:
        out |= dict(zip(robot_groups(robot), (max(s / 2, LEAST_SIGMA_START) for s in spread)))
    # A joint turns the pose as the pose's own noise does.
    out |= {joint_group(robot): max(spread[0] / 2, LEAST_SIGMA_START) for robot in several.free}
    return out


def _refine(
    several: Several, transforms: Mapping[Frame, Array], spread: tuple[float, float]
) -> tuple[NoiseEstimate, Several]:
    """Joint fit, then without the views and parameters that do not belong, until nothing more goes."""
    sigmas = _levels(several, spread)
    rounds = MAX_CLEANING_ROUNDS + sum(int(f.keep.sum()) for f in several.free.values())
    for k in range(rounds + 1):
        noise = estimate_noise(several_problem(several, transforms, sigmas), floors=floors(several))
        solution = noise.solution
        if solution.unobservable:
            raise RefusedError("; ".join(u.message for u in solution.unobservable[:3]))
        several = several.seen_by(fitted_cameras(several, solution))
        cleaned = several if k == rounds else _cleaned(several, noise)
        if cleaned is several:
            return noise, several
        several, transforms, sigmas = cleaned, fitted_transforms(several, solution), dict(solution.sigmas)
    return noise, several


def _cleaned(several: Several, noise: NoiseEstimate) -> Several:
    """Without the views that do not fit the others, then without the joint parameters that are hardly known."""
    data, changed = [], False
    for i, d in enumerate(several.data):
        odd = inconsistent(several, noise.solution, i)
        if odd.any() and odd.sum() <= MOST_LEFT_OUT * d.use.sum():
            reason = "its robot pose and its image disagree by more than the noise of the others explains"
            d, changed = d.without(odd, [reason] * len(d)), True
        data.append(d)
    if changed:
        return replace(several, data=tuple(data))
    free: dict[str, FreeJoints] = {}
    for robot, f in several.free.items():
        free[robot] = f.without_weak(noise.solution, geometry_variable(robot))
        changed |= free[robot] is not f
    return replace(several, free=free) if changed else several
