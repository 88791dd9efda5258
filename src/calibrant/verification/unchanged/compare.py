"""Photos of the result's target against the result: the models of nothing changed, by what there is to compare with.

    at robot poses   T_camera_target,i = X^-1 A_i^-1 Z   (eye-in-hand)     X^-1 A_i Z   (eye-to-hand)
    standing         T_camera_target,i = T_camera_target,then: camera and target both stand, one photo of then is known
    lens             T_camera_target,i of its own: only the lens can be asked about

A camera that moved enters as T_before_after^-1 in front of the chain, a target that moved as T_before_after behind it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.pose.both_solutions import FEWEST_POINTS, view_poses
from calibrant.calibrate.reprojection.factor import stack
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.verification.unchanged.decide import (
    BOTH,
    CAMERA,
    CAMERA_MOVED,
    LENS_CHANGED,
    TARGET,
    TARGET_MOVED,
    Decision,
    Question,
    decide,
)
from calibrant.verification.unchanged.model import LENS, Known, Model, Photo, square_root
from calibrant.verification.unchanged.robot_noise import RobotSide
from calibrant.verification.unchanged.spread import Spread

THEN = "then"


@dataclass(frozen=True, eq=False)
class Seen:
    """Photos of now: their views without points that do not belong, sigma (n,) of each point, pixels, and
    T_camera_target (m, 4, 4) as each photo alone has it."""

    views: tuple[View, ...]
    sigmas: tuple[Array, ...]
    T_camera_target: Array


def seen_now(camera: Camera, views: Sequence[View]) -> Seen:
    """The photos' poses and noise, by the calibration's camera. Raises: InputError for no view with four points."""
    usable = [v for v in views if len(v) >= FEWEST_POINTS]
    if not usable:
        raise InputError(
            f"no photo shows {FEWEST_POINTS} points of the target or more; take it nearer, or whole in the picture"
        )
    found = view_poses(replace(camera, covariance=None), usable)
    kept = tuple(p.view for p in found.views)
    stacked = stack(kept)
    sigmas = np.split(found.sigma_px * stacked.sigma, stacked.offsets[1:-1])
    # The detector's own word: what the residuals show beyond it is asked where the lens is free too.
    words = [v.subset(np.isin(v.point_ids, p.view.point_ids)) for v, p in zip(usable, found.views)]
    kept = tuple(replace(v, sigma_px=word.sigma_px, covariance_px=word.covariance_px) for v, word in zip(kept, words))
    return Seen(kept, tuple(sigmas), np.stack([p.best.T_camera_target for p in found.views]))


@dataclass(frozen=True, eq=False)
class Compared:
    """A comparison: by which way, the decision, the camera of then, the photos, and T_camera_target (m, 4, 4) as they
    should be. T_frame_target (4, 4) and the words for its frame: what the target was fixed to, where that is known."""

    way: Literal["robot", "standing", "lens"]
    decision: Decision
    camera: Camera
    seen: Seen
    expected: Array
    T_frame_target: Array | None = None
    frame: str = ""

    @property
    def middle(self) -> Array:
        """The middle (3,) of the points that the photos show, target frame."""
        points = np.concatenate([v.points for v in self.seen.views])
        middle: Array = 0.5 * (points.min(axis=0) + points.max(axis=0))
        return middle


def on_robot(camera: Camera, side: RobotSide, seen: Seen, T_base_gripper: Array, spread: Spread) -> Compared:
    """Photos taken at robot poses (m, 4, 4) against a hand-eye calibration."""
    n = len(seen.views)
    carried = side.in_hand
    photos, base = [], {"camera": side.X, "target": side.Z, CAMERA_MOVED: np.eye(4), TARGET_MOVED: np.eye(4)}
    for i, (view, sigma) in enumerate(zip(seen.views, seen.sigmas)):
        arm = f"robot {i}"
        base[arm] = T_base_gripper[i]
        chain = ((CAMERA_MOVED, True), ("camera", True), (arm, carried), ("target", False), (TARGET_MOVED, False))
        photos.append(Photo(view, chain, sigma))
    arms = [f"robot {i}" for i in range(n)]
    own, shared = side.roots(n)
    known = [Known(("camera", "target", LENS), square_root(side.covariance))]
    known += [Known((arm,), own) for arm in arms]
    known += [Known(tuple(arms), np.tile(shared, (n, 1)))] if n > 1 else []
    if side.arm is not None:
        of_places, of_poses = side.arm.roots(T_base_gripper)
        root = np.concatenate([of_places, of_poses.reshape(6 * n, -1)])
        known.append(Known(("camera", "target", *arms), _slim(root)))
    nothing = Model(camera, tuple(photos), base, tuple(known))
    A = np.stack([se3.inverse(T) if carried else T for T in T_base_gripper])
    # Where the camera, or the target, would be by the first photo alone: the fit goes on from there.
    moved_camera = side.X_inverse @ A[0] @ side.Z @ se3.inverse(seen.T_camera_target[0])
    moved_target = se3.inverse(side.X_inverse @ A[0] @ side.Z) @ seen.T_camera_target[0]
    questions = [
        Question(CAMERA, (CAMERA_MOVED,), {CAMERA_MOVED: moved_camera}),
        Question(TARGET, (TARGET_MOVED,), {TARGET_MOVED: moved_target}),
        Question(LENS_CHANGED, lens=True),
    ]
    if n > 1:
        questions.append(Question(BOTH, (CAMERA_MOVED, TARGET_MOVED), {CAMERA_MOVED: moved_camera}))
    lens = Known((LENS,), known[0].root[-len(camera.values) :])
    free = _each_free(camera, photos, seen, (lens,))
    found = decide(nothing, free, questions, spread, below=side.freedom)
    frame = "base" if carried else "gripper"
    return Compared("robot", found, camera, seen, side.predicted(T_base_gripper), side.Z, frame)


def _slim(root: Array) -> Array:
    """The same covariance by no more columns than rows."""
    return np.linalg.qr(root.T)[1].T if root.shape[1] > len(root) else root


def standing(camera: Camera, then: View, sigma_then: Array, T_then: Array, seen: Seen, spread: Spread) -> Compared:
    """Photos of a target and by a camera that both stand still, against one of then. Args: T_then (4, 4)."""
    base = {THEN: T_then, CAMERA_MOVED: np.eye(4)}
    known = _lens_known(camera)
    before = Photo(then, ((THEN, False),), sigma_then, now=False)
    now = [Photo(v, ((CAMERA_MOVED, True), (THEN, False)), s) for v, s in zip(seen.views, seen.sigmas)]
    nothing = Model(camera, (before, *now), base, known, (THEN,))
    moved = T_then @ se3.inverse(seen.T_camera_target[0])
    questions = [Question(CAMERA, (CAMERA_MOVED,), {CAMERA_MOVED: moved}), Question(LENS_CHANGED, lens=True)]
    free = _each_free(camera, now, seen, known)
    free = replace(free, photos=(before, *free.photos), base={**free.base, THEN: T_then}, free=(THEN, *free.free))
    found = decide(nothing, free, questions, spread)
    return Compared("standing", found, camera, seen, np.tile(T_then, (len(now), 1, 1)))


def lens_alone(camera: Camera, seen: Seen, spread: Spread) -> Compared:
    """Photos of a target that may be anywhere: is the lens what it was?"""
    blank = [Photo(v, (), s) for v, s in zip(seen.views, seen.sigmas)]
    free = _each_free(camera, blank, seen, _lens_known(camera))
    found = decide(free, free, [Question(LENS_CHANGED, lens=True)], spread)
    return Compared("lens", found, camera, seen, np.stack([found.free.pose(i) for i in range(len(blank))]))


def _lens_known(camera: Camera) -> tuple[Known, ...]:
    return () if camera.covariance is None else (Known((LENS,), square_root(camera.covariance)),)


def _each_free(camera: Camera, photos: Sequence[Photo], seen: Seen, known: tuple[Known, ...]) -> Model:
    """Every photo at a pose of its own; known: of the lens."""
    names = [f"view {i}" for i in range(len(photos))]
    own = tuple(replace(p, chain=((name, False),)) for p, name in zip(photos, names))
    return Model(camera, own, dict(zip(names, seen.T_camera_target)), known, tuple(names))
