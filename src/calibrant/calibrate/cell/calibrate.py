"""Calibration of a cell in one weighted problem: cameras, targets and robots, with the covariance between them.

what the cameras saw, list by list -> what can the motions determine? -> closed forms, list by list, joined -> weighted
fit with all noise levels -> views that do not belong left out, and again -> target sizes, held-out error, checks. With
joint readings, a robot's own errors (joint offsets) are found in the same problem.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from calibrant.calibrate.cell.boards.alike import numbered_alike
from calibrant.calibrate.cell.certainty.accuracy import RobotAccuracy
from calibrant.calibrate.cell.certainty.accuracy import robot_accuracy as as_accuracy
from calibrant.calibrate.cell.certainty.whole import Certainty, certain
from calibrant.calibrate.cell.clocks import clocks_asked, refined_with_clocks
from calibrant.calibrate.cell.fitted import fitted_cameras
from calibrant.calibrate.cell.lens_choice import MODEL, FixForEach, ForEach, LensChoice, lens_choices, lenses_asked
from calibrant.calibrate.cell.lit.checks import with_projector_checks
from calibrant.calibrate.cell.lit.told import Fixed, fit_told, lit_start, projectors
from calibrant.calibrate.cell.loose import cause_first, late_words
from calibrant.calibrate.cell.moments.at_once import seen_at_once
from calibrant.calibrate.cell.moments.numbering import numbered_at_once
from calibrant.calibrate.cell.problem.camera_role import CameraRole
from calibrant.calibrate.cell.problem.clocks import Times
from calibrant.calibrate.cell.problem.joint_offsets import JointReadings, free_joints
from calibrant.calibrate.cell.problem.layout import (
    HANDHELD,
    ONLY_ROBOT,
    STANDING,
    Layout,
    Pictures,
    TargetPoses,
    id_prefix,
    layout,
)
from calibrant.calibrate.cell.problem.problem import Cell
from calibrant.calibrate.cell.problem.touches import Touches
from calibrant.calibrate.cell.problem.unused import with_unused
from calibrant.calibrate.cell.problem.views import (
    FEWEST_POINTS,
    MINIMUM_POINTS,
    HandEyeViews,
    from_handheld,
    from_observations,
    from_target_poses,
    match_views,
    unsharp_views,
)
from calibrant.calibrate.cell.refine import refined
from calibrant.calibrate.cell.result import along_with_lenses, cell_result, with_images_judged
from calibrant.calibrate.cell.rig_checks import better_start
from calibrant.calibrate.cell.sizes import Sizes, target_sizes, with_lens_free, with_sizes_free
from calibrant.calibrate.cell.starts.cell import CellStart, cell_start
from calibrant.calibrate.intrinsics.fit import ORDINARY, Stopping
from calibrant.calibrate.review.review import review
from calibrant.calibrate.solvers.setup import get_setup
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, Check, Observations, RobotPoses, ViewResult
from calibrant.data.verdicts import refuse_if_failed, stamp
from calibrant.errors import InputError, RefusedError, causes
from calibrant.expected import expect, names_of
from calibrant.optimize.noise import NoiseEstimate

if TYPE_CHECKING:
    from calibrant.calibrate.cell.photos import Photographed


Accuracy = RobotAccuracy | float | str
"""Of a robot: metres, 0.3mm, or 0.3mm,0.02deg."""


@dataclass(frozen=True, eq=False)
class CellFit:
    """A cell's fit: its noise estimate with the solution, what is left of the cell, and the start that led there.

    left_out: views that their camera's own calibration ruled out; numbering: what was asked of symmetric boards,
    and of views of one moment;
    sizes: of the targets, by the robots' motion; certainty: what the covariance holds beside the noise levels.
    """

    noise: NoiseEstimate
    cell: Cell
    start: CellStart
    left_out: tuple[ViewResult, ...]
    numbering: tuple[Check, ...]
    sizes: Sizes
    certainty: Certainty


def calibrate_cell(
    robots: Mapping[str, RobotPoses] | RobotPoses,
    pictures: Sequence[Pictures],
    *,
    cameras: Mapping[str, Camera] | None = None,
    joints: Mapping[str, JointReadings] | JointReadings | None = None,
    identify: Sequence[str] = ("offsets",),
    initial: Mapping[str, Camera] | None = None,
    model: ForEach = MODEL,
    fix: FixForEach = (),
    robot_accuracy: Mapping[str, Accuracy] | Accuracy | None = None,
    rigid: Sequence[Sequence[str]] = (),
    touches: Sequence[Touches] = (),
) -> CalibrationResult:
    """Find where all cameras, targets and robots are, from one weighted problem.

    A cell without robots ({}) is a rig: its pictures are `handheld`, its root the first camera, its kind "rig".

    Args: robots, poses by robot, or of the only one; pictures, a list of views (or of measured target poses) for each
    camera, robot and setup; cameras, known intrinsics by name, with their covariance where it is known; the others are
    calibrated from their pictures, with one `model` and `fix` for all or by name, starting where `initial` has them (by
    name). joints, what the joints read at the poses' ids: then `identify` (offsets, gear, coupling, geometry) is found
    too. robot_accuracy: how far the flange is off, rms, of the robot or by robot: metres, "0.3mm", or "0.3mm,0.02deg";
    errors of its geometry are then in every sigma. rigid: names of handheld targets that are fixed to each other, group
    by group: cameras that never see the same one at once are tied through them, and one camera measures how they stand.
    touches: poses at which the tips of tools are on points of targets, or on points that nobody knows: each tip, and
    what it touches, is found with the rest.
    Returns a result of kind "hand-eye" with a transform a camera, its
    `joint_covariance` over all transforms, and T_a_b of every two cameras on the same body.
    Raises: InputError for unusable input; RefusedError naming what the pictures do not determine, or contradict.

    Example::

        left = cb.Pictures("left", "eye-in-hand", observations_of_left)
        right = cb.Pictures("right", "eye-in-hand", observations_of_right)
        result = cb.calibrate_cell(robot_poses, [left, right])
        result.transform("left", "right").matrix
    """
    told = told_accuracies(robot_accuracy)
    lists = _listed(pictures)
    sources = projectors(lists)
    attempt = partial(fit_cell, robots, lists, joints=joints, identify=identify, accuracies=told, rigid=rigid)
    attempt = partial(attempt, cameras=cameras, model=model, touches=touches)
    fit, left_out = fit_with_projectors(
        attempt, lists, sources, cameras=cameras or {}, initial=initial, model=model, fix=fix
    )
    asked = lenses_asked(fix, initial) | accuracies_asked(told)
    asked |= {"identify": list(identify)} if fit.cell.free else {}
    asked |= {"rigid": [list(group) for group in rigid]} if rigid else {}
    asked |= {"touches": [repr(t) for t in touches]} if touches else {}
    return with_projector_checks(judged_cell(fit, asked), sources, left_out)


calibrate_several = calibrate_cell
"""Another name of it."""


def fit_with_projectors(
    attempt: Callable[..., CellFit],
    pictures: Sequence[Pictures],
    sources: Mapping[str, str],
    *,
    cameras: Mapping[str, Camera],
    initial: Mapping[str, Camera] | None,
    model: ForEach,
    fix: FixForEach,
) -> tuple[CellFit, dict[str, tuple[str, ...]]]:
    """The fit with projectors, which are found in the whole with their cameras (`lit`), and terms that nothing tells.

    attempt: takes initial, fix and together, as `fit_cell` has them; sources: by projector, its camera. Errors are
    those of `fit_cell`, and of `lit_start`.
    """
    if not sources:
        return attempt(initial=initial, fix=fix), {}
    names = dict.fromkeys(p.camera for p in pictures if p.seen is not None)
    models = dict.fromkeys(names, MODEL) | (dict(model) if isinstance(model, Mapping) else dict.fromkeys(names, model))
    said = fix if isinstance(fix, Mapping) else dict.fromkeys(names, fix)
    fixed = {n: tuple(names_of(said.get(n, ()), "fix", "a list of names")) for n in (*names, *said)}
    start = lit_start(pictures, sources, cameras=cameras, initial=initial or {}, models=models, fixed=fixed)

    def lenses_of(lenses: dict[str, Camera], more: Fixed) -> tuple[CellFit, Mapping[str, Camera]]:
        held = {n: (*fixed[n], *more.get(n, ())) for n in fixed}
        fit = attempt(initial={**(initial or {}), **lenses}, fix=held, together=tuple(lenses))
        return fit, fitted_cameras(fit.cell, fit.noise.solution)

    return fit_told(lenses_of, start)


def judged_cell(fit: CellFit, asked: Mapping[str, object]) -> CalibrationResult:
    """The result of a fit, stamped. Raises: RefusedError, which holds the result, where a check failed."""
    result = reviewed_cell(fit, asked)
    refuse_if_failed(result)
    return result


def reviewed_cell(fit: CellFit, asked: Mapping[str, object]) -> CalibrationResult:
    """The result of a fit, stamped, whatever its checks say: for who has more to ask of it."""
    with _by_its_cause(fit.start):
        found = cell_result(
            fit.cell, fit.start, fit.noise, fit.sizes, fit.certainty, fit.left_out, fit.numbering, asked
        )
        reviewed = along_with_lenses(review(found), found, fit.cell, fit.noise.solution)
        judged = with_images_judged(reviewed, fit.cell, fit.noise, fit.sizes)
        return stamp(cause_first(judged) if fit.cell.layout.rig else judged)


def fit_cell(
    robots: Mapping[str, RobotPoses] | RobotPoses,
    pictures: Sequence[Pictures],
    *,
    cameras: Mapping[str, Camera] | None = None,
    joints: Mapping[str, JointReadings] | JointReadings | None = None,
    identify: Sequence[str] = ("offsets",),
    initial: Mapping[str, Camera] | None = None,
    model: ForEach = MODEL,
    fix: FixForEach = (),
    reference: str = "",
    accuracies: Mapping[str, RobotAccuracy] | None = None,
    together: Collection[str] = (),
    times: Mapping[str, float] | Mapping[str, Mapping[str, float]] | None = None,
    time_offsets: bool = False,
    readout: bool = False,
    rigid: Sequence[Sequence[str]] = (),
    same_focal: tuple[()] | tuple[str, str] = (),
    touches: Sequence[Touches] = (),
    stop: Stopping = ORDINARY,
) -> CellFit:
    """The fit behind `calibrate_cell`; arguments and errors as there. reference: the root camera of a rig; together:
    cameras that their own views need not determine (`LensChoice`); times, time_offsets, readout: as `calibrate_rig` has
    them; same_focal: two cameras, both calibrated from their pictures, of one focal length; stop: every solver."""
    where = layout(robots, _with_own_ids(_listed(pictures)), reference, rigid, touches)
    for name in accuracies or {}:
        if name not in where.robots:
            there = ", ".join(where.robots)
            raise InputError(f"the accuracy of robot {name!r}, which has no poses; there are {there or 'none'}")
    lenses = lens_choices(
        where.cameras_with_images, cameras=cameras, initial=initial, model=model, fix=fix, together=together, stop=stop
    )
    if any(lenses[name].given is not None for name in same_focal):
        raise InputError("same focal lengths are found from the pictures of both cameras: give neither (cameras)")
    taken = Times.told(times)
    data, roles, left_out = _matched(where, lenses)
    where, data, numbering = numbered_alike(where, data)
    where, data, by_hand = numbered_at_once(where, data)
    data, roles, at_once = seen_at_once(where, data, roles, taken.moments, clocks=time_offsets)
    free = {name: free_joints(r, identify) for name, r in _readings(where, joints).items()}
    start = cell_start(where, data, {v.id: v.reason or "" for v in left_out})
    late = partial(late_words, where, data, taken.moments)
    with _by_its_cause(start, late if where.rig and not time_offsets else None):
        whole = Cell(where, start.data, roles, free, taken, same_focal=same_focal)
        if time_offsets or readout or taken.apart:
            clocks = clocks_asked(whole, offsets=time_offsets, readout=readout)
            noise, cell = refined_with_clocks(whole, start.transforms, start.spread, clocks)
        else:
            noise, cell, elsewhere = better_start(whole, *refined(whole, start.transforms, start.spread, stop), stop)
            numbering = (*numbering, *elsewhere)
        sizes = target_sizes(cell, start.data, noise.solution)
        freed = with_sizes_free(cell, noise.solution, sizes.targets)
        held = [name for name, role in cell.roles.items() if role.exact]
        loose = {name: found for name in held if (found := with_lens_free(cell, noise.solution, name)) is not None}
        noise, certainty = certain(cell, noise, freed, accuracies or {}, loose)
    return CellFit(noise, cell, start, left_out, (*numbering, *by_hand, *at_once), sizes, certainty)


def _listed(pictures: Sequence[Pictures] | Pictures) -> Sequence[Pictures]:
    """Raises: InputError for what is no list of pictures."""
    pictures = [pictures] if isinstance(pictures, Pictures) else pictures
    expect(pictures, (list, tuple), "pictures", "a list of Pictures, one for each camera, robot and setup")
    for one in pictures:
        expect(one, Pictures, "one of pictures", "Pictures")
    return pictures


@contextmanager
def _by_its_cause(start: CellStart, late: Callable[[], str] | None = None) -> Iterator[None]:
    """Data that the start found wrong drive a fit to where it has no answer, a lens out of its field.

    late: what views that were not taken at once say, or nothing. Raises: RefusedError by what the start found, in the
    place of what came of it.
    """
    try:
        yield
    except (InputError, RefusedError) as error:
        findings = [f for alone in start.alone.values() for f in alone.report.findings]
        failed = [f"{f.name}: {f.message}" for f in findings if f.status == "fail"]
        failed += [words] if late is not None and (words := late()) else []
        if not failed:
            raise
        raise RefusedError(causes(failed)) from error


def told_accuracies(given: Mapping[str, Accuracy] | Accuracy | None) -> dict[str, RobotAccuracy]:
    """By robot. Raises: InputError for what is no accuracy."""
    if given is None:
        return {}
    named = given if isinstance(given, Mapping) else {ONLY_ROBOT: given}
    return {robot: as_accuracy(value) for robot, value in named.items()}


def accuracies_asked(told: Mapping[str, RobotAccuracy]) -> dict[str, object]:
    """The option as results hold it."""
    if not told:
        return {}
    texts = {robot: accuracy.text for robot, accuracy in told.items()}
    return {"robot_accuracy": texts[ONLY_ROBOT] if list(texts) == [ONLY_ROBOT] else texts}


def _with_own_ids(pictures: Sequence[Pictures]) -> list[Pictures]:
    """Views of a camera that stands in several lists get the robot's name in front, or a handheld target's: ids are
    unique in a camera."""
    lists = [(p.camera, p.target if p.handheld else p.robot) for p in pictures]
    out = []
    for i, p in enumerate(pictures):
        if p.seen is None:
            out.append(p)
            continue
        prefix = id_prefix(lists, i)
        rename = [
            v if not prefix and v.camera == p.camera else replace(v, id=f"{prefix}{v.id}", camera=p.camera)
            for v in p.seen.views
        ]
        missed = [replace(m, id=f"{prefix}{m.id}", camera=p.camera) for m in p.seen.missed]
        size = next(iter(p.seen.image_sizes.values()))
        seen = replace(p.seen, views=tuple(rename), image_sizes={p.camera: size}, missed=tuple(missed))
        out.append(replace(p, observations=seen))
    return out


def _matched(
    where: Layout, lenses: Mapping[str, LensChoice]
) -> tuple[tuple[HandEyeViews, ...], dict[str, CameraRole], tuple[ViewResult, ...]]:
    """What every list saw with its robot poses, the cameras' roles, and views that their own calibration ruled out."""
    data: dict[int, HandEyeViews] = {}
    roles: dict[str, CameraRole] = {}
    left_out: list[ViewResult] = []
    for i, p in enumerate(where.pictures):
        if isinstance(p.observations, TargetPoses):
            given = p.observations
            data[i] = from_target_poses(where.robots[p.robot].only(given.ids), given.T_camera_target)
    if where.cameras_with_images:
        from calibrant.calibrate.cell.photos import photographed  # not needed for pose pairs
    for name in where.cameras_with_images:
        lists = {i: p.seen for i, p in enumerate(where.pictures) if p.camera == name and p.seen is not None}
        try:
            camera = photographed(tuple(lists.values()), lenses[name])
        except RefusedError as error:
            prefix = f"camera {name}: " if len(where.cameras_with_images) > 1 else ""
            raise RefusedError(f"{prefix}{error}") from error
        for (i, seen), views in zip(lists.items(), camera.views):
            found = _list_views(where, where.pictures[i], replace(seen, views=views), camera)
            data[i] = found.noted(unsharp_views(seen.views))
        calibrated = lenses[name].given is None
        roles[name] = with_unused(camera.role, [data[i] for i in lists]) if calibrated else camera.role
        left_out += camera.left_out
    return tuple(data[i] for i in sorted(data)), roles, tuple(left_out)


def _list_views(where: Layout, p: Pictures, seen: Observations, camera: Photographed) -> HandEyeViews:
    """The views of a list that its camera's own calibration kept, with their poses."""
    found, sigma = camera.T_camera_target, camera.sigma_px
    if p.handheld and found is not None and sigma is not None:
        return from_handheld(seen.views, np.array([found[v.id] for v in seen.views]).reshape(-1, 4, 4), sigma)
    least = FEWEST_POINTS if sigma is None else MINIMUM_POINTS
    data = from_observations(_poses_of_list(where, p), seen, camera.role.camera, sigma, least=least)
    return data.with_branches([get_setup(p.setup).normal_form(data.T_base_gripper)]) if p.alone else data


def _poses_of_list(where: Layout, p: Pictures) -> RobotPoses:
    """The poses that a list's views are matched with."""
    seen = p.observations
    if p.other and isinstance(seen, Observations):
        match_views(where.robots[p.other], seen)
    if p.setup not in (STANDING, HANDHELD) or not isinstance(seen, Observations):
        return where.robots[p.robot]
    # No robot stands between camera and target: any pose serves.
    ids = tuple(dict.fromkeys(v.moment for v in seen.views))
    return RobotPoses.from_matrices(np.tile(np.eye(4), (len(ids), 1, 1)), ids=ids)


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
        if any(t.robot == robot for t in where.touches):
            raise InputError(
                f"robot {robot!r} has joint values and touches: a touch rests on the pose that the robot reports, "
                "which joints found anew would change; find the joints from the pictures, then give the poses by them"
            )
        out[robot] = readings.only(where.robots[robot].ids)
    return out
