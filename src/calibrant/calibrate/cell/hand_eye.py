"""Hand-eye and robot-world calibration from robot poses and photos, or from pose pairs.

views and poses -> what can the motions determine? -> closed forms -> joint refinement with the noise levels -> views
that do not belong are left out, and again -> target scale, held-out error, checks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrant.calibrate.cell import checks as questions
from calibrant.calibrate.cell.boards.turned import agreeing
from calibrant.calibrate.cell.by_method import JOINT, answered_by, require_method
from calibrant.calibrate.cell.consistency import inconsistent_views
from calibrant.calibrate.cell.held_out import leave_out
from calibrant.calibrate.cell.loop.image_poses import ImagePoses, image_poses
from calibrant.calibrate.cell.loop.noise import LoopNoise
from calibrant.calibrate.cell.loop.target_size import target_size
from calibrant.calibrate.cell.problem.camera_role import (
    FLOORS,
    PIXEL,
    ROBOT_ROTATION,
    ROBOT_TRANSLATION,
    CameraRole,
    image_problem,
)
from calibrant.calibrate.cell.problem.pose_pairs import TARGET_ROTATION, TARGET_TRANSLATION, pose_pair_problem
from calibrant.calibrate.cell.starts.seed import (
    Seed,
    best_seed,
    compare_methods,
    mean_of_methods,
    method_result,
    seed_of_all,
)
from calibrant.calibrate.cell.views import HandEyeViews, from_target_poses
from calibrant.calibrate.reprojection.outliers import mark, points_reason
from calibrant.calibrate.solvers.loop_errors import loop_errors
from calibrant.calibrate.solvers.motion import MotionReport, motion_report
from calibrant.calibrate.solvers.setup import SETUPS, Setup, get_setup
from calibrant.cameras import Camera
from calibrant.data import (
    CalibrationResult,
    Check,
    Observations,
    RobotPoses,
    SigmaRobot,
    View,
    ViewResult,
    as_transform,
    verdict_of,
)
from calibrant.data.verdicts import refuse_if_failed, stamp
from calibrant.errors import RefusedError
from calibrant.geometry import se3
from calibrant.optimize.noise import NoiseEstimate, estimate_noise
from calibrant.optimize.problem import Problem
from calibrant.optimize.solution import Solution

Array = NDArray[np.float64]

MAX_CLEANING_ROUNDS = 3
LEAST_SIGMA_START = 1e-6
"""Start of a noise level when the closed form fits exactly: radians and metres."""


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint fit: the noise estimate with its solution, and the views and camera it rests on."""

    noise: NoiseEstimate
    data: HandEyeViews
    views: tuple[View, ...] | None
    role: CameraRole


def calibrate_hand_eye(
    T_base_gripper: RobotPoses | ArrayLike,
    target: Observations | ArrayLike,
    *,
    setup: str,
    camera: Camera | None = None,
    model: str = "brown",
    fix: Sequence[str] = (),
    method: str = JOINT,
) -> CalibrationResult:
    """Calibrate where the camera is: on the gripper (eye-in-hand) or beside the robot (eye-to-hand).

    T_base_gripper: robot poses, RobotPoses or (n, 4, 4), metres. target: T_camera_target (n, 4, 4), or Observations of
    one camera whose views carry the poses' ids. camera: known intrinsics, with their covariance where it is known;
    without it the same images calibrate the camera (`model`, `fix`). method: "joint", the weighted refinement, or a
    closed form, whose transforms come without covariance (`by_method.METHODS`).
    Returns a CalibrationResult of kind "hand-eye". Raises: InputError for unusable input; RefusedError when the poses
    cannot determine the result or contradict it, naming why.
    """
    chosen = get_setup(setup)
    require_method(method)
    poses = T_base_gripper if isinstance(T_base_gripper, RobotPoses) else RobotPoses.from_matrices(T_base_gripper)
    if isinstance(target, Observations):
        from calibrant.calibrate.cell.photos import named_by_poses, prepare_photos  # not needed for pose pairs

        observations = named_by_poses(target, poses, given_ids=isinstance(T_base_gripper, RobotPoses))
        photos = prepare_photos(poses, observations, camera, model, fix)
        role, sigma_px = photos.role, photos.sigma_px
        data, observations, numbering = agreeing(chosen, photos.data, observations)
    else:
        observations, numbering = None, ()
        B = se3.check(target, name="T_camera_target")
        data, role, sigma_px = from_target_poses(poses, B.reshape(-1, 4, 4)), None, 1.0
    _require_poses(data)
    report = motion_report(*_pairs(chosen, data), frame=chosen.camera_parent)
    report.require_determined()
    data, seed = _seed(chosen, data)
    setup_answer = questions.setup_check(chosen, seed, _other_seed(chosen, data))
    if setup_answer.status == "fail":
        raise RefusedError(f"{setup_answer.name}: {setup_answer.message}")
    joint = _refine(chosen, data, seed, role, sigma_px)
    size, of_images = _loop(chosen, data, joint, None if role is None else role.camera)
    result = _result(
        chosen, poses, observations, joint, seed, report, setup_answer, size, of_images,
        fix=fix, camera_given=camera is not None, numbering=numbering,
    )  # fmt: skip
    return result if method == JOINT else answered_by(result, method, *_pairs(chosen, joint.data))


def _require_poses(data: HandEyeViews) -> None:
    used = int(data.use.sum())
    if used < 3:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in data.missing)
        raise RefusedError(
            f"poses: {used} usable poses of {len(data) + len(data.left_out)}, at least 3 are needed, better 10 to 20"
            + (f" ({reasons})" if reasons else "")
        )


def _pairs(setup: Setup, data: HandEyeViews) -> tuple[Array, Array]:
    return setup.normal_form(data.T_base_gripper[data.use]), data.B[data.use]


def _seed(setup: Setup, data: HandEyeViews) -> tuple[HandEyeViews, Seed]:
    """Closed-form start; views far from where the others put the target are left out."""
    seed = best_seed(*_pairs(setup, data), certainty=data.certainty[data.use])
    dropped = np.zeros(len(data), dtype=bool)
    dropped[np.flatnonzero(data.use)[~seed.keep]] = True
    if not dropped.any():
        return data, seed
    A = setup.normal_form(data.T_base_gripper)
    delta = se3.local(seed.Z, A @ seed.X @ data.B)
    reasons = [
        f"it puts the target {1e3 * np.linalg.norm(d[3:]):.3g} mm and {np.rad2deg(np.linalg.norm(d[:3])):.3g} deg "
        f"from where the others do ({seed.loop.median_mm:.2g} mm, {seed.loop.median_deg:.2g} deg typically); "
        "wrong pose, wrong image, or a misread board"
        for d in delta
    ]
    return data.without(dropped, reasons), seed  # type: ignore[arg-type]


def _other_seed(setup: Setup, data: HandEyeViews) -> Seed | None:
    other = next(s for s in SETUPS.values() if s.name != setup.name)
    try:
        return seed_of_all(*_pairs(other, data))
    except RefusedError:
        return None


def _problem(
    setup: Setup,
    data: HandEyeViews,
    views: Sequence[View] | None,
    role: CameraRole | None,
    X: Array,
    Z: Array,
    sigmas: dict[str, float],
) -> Problem:
    robot = data.T_base_gripper[data.use]
    if views is None or role is None:
        return pose_pair_problem(setup, robot, data.B[data.use], X=X, Z=Z, sigmas=sigmas)
    return image_problem(setup, views, robot, role, X=X, Z=Z, sigmas=sigmas)


def _refine(setup: Setup, data: HandEyeViews, seed: Seed, role: CameraRole | None, sigma_px: float) -> Joint:
    """Joint fit, then without the points and views that do not belong, until nothing more goes."""
    X, Z = seed.X, seed.Z
    rotation = max(np.deg2rad(seed.loop.median_deg), LEAST_SIGMA_START)
    translation = max(1e-3 * seed.loop.median_mm, LEAST_SIGMA_START)
    sigmas = (
        {TARGET_ROTATION: rotation, TARGET_TRANSLATION: translation}
        if role is None
        else {PIXEL: sigma_px, ROBOT_ROTATION: rotation / 2, ROBOT_TRANSLATION: translation / 2}
    )
    views = None if data.views is None else [v for v, use in zip(data.views, data.use) if use]
    for _ in range(MAX_CLEANING_ROUNDS):
        problem = _problem(setup, data, views, role, X, Z, sigmas)
        noise = estimate_noise(problem, floors=FLOORS)
        if role is not None:
            data = data.seen_by(_camera(role, noise.solution))
        cleaned, kept = _clean(setup, data, views, noise)
        if cleaned is data and kept is views:
            break
        data, views = cleaned, kept
        _require_poses(data)
        solution = noise.solution
        X, Z = solution.value(setup.camera_transform)[0], solution.value(setup.target_transform)[0]
        sigmas = dict(solution.sigmas)
    else:
        noise = estimate_noise(_problem(setup, data, views, role, X, Z, sigmas), floors=FLOORS)
    final = role if role is not None else CameraRole(_no_camera(), ())
    return Joint(noise, data, None if views is None else tuple(views), final)


def _no_camera() -> Camera:
    """Stands where pose pairs have no camera; its values are never read."""
    return Camera.create("pinhole", {"fx": 1.0, "fy": 1.0, "cx": 0.0, "cy": 0.0}, image_size=(1, 1))


def _clean(
    setup: Setup, data: HandEyeViews, views: list[View] | None, noise: NoiseEstimate
) -> tuple[HandEyeViews, list[View] | None]:
    """Leave out views whose loop does not fit the others, and points beyond the noise."""
    odd = inconsistent_views(setup, data, noise)
    if odd.any() and data.use.sum() - odd.sum() >= 3 and odd.mean() <= 1 / 3:
        dropped = np.zeros(len(data), dtype=bool)
        dropped[np.flatnonzero(data.use)[odd]] = True
        reason = "its robot pose and its image disagree by more than the noise of the others explains"
        kept = None if views is None else [v for v, o in zip(views, odd) if not o]
        return data.without(dropped, [reason] * len(data)), kept
    points = None if views is None else _clean_points(views, noise)
    if points is not None and views is not None and any(len(a) != len(b) for a, b in zip(points, views)):
        return data, points
    return data, views


def _clean_points(views: list[View], noise: NoiseEstimate) -> list[View]:
    norms = np.linalg.norm(noise.solution.residuals("reprojection"), axis=1)
    offsets = np.concatenate([[0], np.cumsum([len(v) for v in views])])
    marked = mark(norms, offsets)
    out = []
    for i, view in enumerate(views):
        keep = marked.keep[offsets[i] : offsets[i + 1]]
        # A view that does not fit as a whole is judged by its pose, not point by point.
        out.append(view if marked.drop_view[i] or keep.all() or keep.sum() < 6 else view.subset(keep))
    return out


def _loop(
    setup: Setup, data: HandEyeViews, joint: Joint, camera: Camera | None
) -> tuple[LoopNoise | None, ImagePoses | None]:
    """The target's size and the images' share of the noise, from the target poses that each view gave by itself."""
    X = joint.noise.solution.value(setup.camera_transform)[0]
    alone = replace(data, use=joint.data.use)
    size = target_size(setup, alone, X, used=joint.data.use, camera=camera)
    return size, image_poses(setup, alone, size, camera=camera)


def _result(
    setup: Setup,
    poses: RobotPoses,
    observations: Observations | None,
    joint: Joint,
    seed: Seed,
    report: MotionReport,
    setup_answer: Check,
    size: LoopNoise | None,
    of_images: ImagePoses | None,
    *,
    fix: Sequence[str],
    camera_given: bool,
    numbering: tuple[Check, ...],
) -> CalibrationResult:
    data, solution = joint.data, joint.noise.solution
    role = joint.role if joint.views is not None else None
    X, Z = solution.value(setup.camera_transform)[0], solution.value(setup.target_transform)[0]
    A, B = _pairs(setup, data)
    loop = loop_errors(A, B, X)
    errors = leave_out(setup, data.T_base_gripper[data.use], B, joint.views, joint.role, solution, solution.sigmas)
    methods = compare_methods(A, B)
    methods["mean"] = mean_of_methods(A, B, methods)
    methods["joint"] = method_result(A, B, X)
    transforms = (
        as_transform(setup.camera_parent, "camera", X, solution.covariance(setup.camera_transform)),
        as_transform(setup.target_parent, "target", Z, solution.covariance(setup.target_transform)),
    )
    answers = (
        *questions.motion_checks(report),
        *numbering,
        setup_answer,
        questions.views_check(data),
        questions.loop_check(seed, loop),
        questions.held_out_check(errors.rms, loop),
        questions.scale_check(size, loop),
        *questions.image_poses_check(of_images, _robot_noise(joint)),
        questions.sigma_check(np.asarray(transforms[0].sigma_translation_mm), setup.camera_parent),
        questions.convergence_check(solution, joint.noise.settled, joint.noise.rounds),
    )
    views, rms_px = _view_results(setup, joint, observations)
    levels = joint.noise.levels
    result = CalibrationResult(
        kind="hand-eye",
        verdict=verdict_of(answers),
        checks=answers,
        cameras={} if role is None else {_camera_name(observations): _camera(role, solution)},
        transforms=transforms,
        rms_px=rms_px,
        sigma_px=levels[PIXEL].sigma if PIXEL in levels else None,
        sigma_robot=_robot_noise(joint),
        views=views,
        methods=methods,
        target_scale=None if size is None else size.size,
        held_out=errors.rms,
        options={"setup": setup.name, **({"fix": list(fix)} if fix else {})},
        decided={"camera": _camera_words(role, camera_given)},
        observations=observations,
        robot_poses=poses,
        T_camera_target=None if observations is not None else data.B,
    )
    result = stamp(result)
    refuse_if_failed(result)
    return result


def _camera_name(observations: Observations | None) -> str:
    return next(iter(observations.image_sizes)) if observations is not None else "camera"


def _camera_words(role: CameraRole | None, given: bool) -> str:
    if role is None:
        return "none: target poses were given"
    if not given:
        return "calibrated from the same images, refined jointly"
    return "given with its covariance, refined jointly" if role.prior is not None else "given, held"


def _camera(role: CameraRole, solution: Solution) -> Camera:
    covariance = (
        None if role.prior is None and len(role.held) == len(role.camera.values) else solution.covariance("camera")
    )
    return Camera(role.camera.model, role.camera.image_size, solution.value("camera")[0], covariance)


def _robot_noise(joint: Joint) -> SigmaRobot | None:
    levels = joint.noise.levels
    if ROBOT_ROTATION not in levels:
        return None
    rotation, translation = levels[ROBOT_ROTATION], levels[ROBOT_TRANSLATION]
    return SigmaRobot(
        1e3 * translation.sigma,
        float(np.rad2deg(rotation.sigma)),
        1e3 * translation.deviation if np.isfinite(translation.deviation) else None,
        float(np.rad2deg(rotation.deviation)) if np.isfinite(rotation.deviation) else None,
    )


def _view_results(
    setup: Setup, joint: Joint, observations: Observations | None
) -> tuple[tuple[ViewResult, ...], float | None]:
    """Every pose with its figures: reprojection of the joint fit for images, nothing but its use for pose pairs."""
    data = joint.data
    if joint.views is None:
        return tuple(
            ViewResult(i, bool(u), 0, reason=r, T_camera_target=B)
            for i, u, r, B in zip(data.ids, data.use, data.reasons, data.B)
        ), None
    solution = joint.noise.solution
    squares = np.sum(solution.residuals("reprojection") ** 2, axis=1)
    offsets = np.concatenate([[0], np.cumsum([len(v) for v in joint.views])])
    factor = solution.problem.factors[0]
    T = factor.T_camera_target(*solution.problem.gather(0, solution.values))  # type: ignore[attr-defined]
    place = {i: k for k, i in enumerate(np.flatnonzero(data.use).tolist())}
    total = {v.id: len(v) for v in observations.views} if observations is not None else {}
    out = []
    for i, (name, view, reason) in enumerate(zip(data.ids, data.views or (), data.reasons)):
        k = place.get(i)
        if k is None:
            out.append(ViewResult(name, False, len(view), None, reason, view.camera, 0, data.B[i]))
            continue
        n = len(joint.views[k])
        seen = total.get(view.id, len(view))
        lost = seen - n
        words = reason or (points_reason(lost, seen, float(np.sqrt(squares.max()))) if lost else None)
        rms = float(np.sqrt(squares[offsets[k] : offsets[k + 1]].mean()))
        out.append(ViewResult(name, True, n, rms, words, view.camera, lost, T[k]))
    return (*out, *data.left_out), float(np.sqrt(squares.mean()))
