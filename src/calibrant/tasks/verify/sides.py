"""What a result says of the camera that is verified, and the photos of now beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from calibrant.errors import DetectionError, InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import Listener

if TYPE_CHECKING:
    from calibrant.arrays import Array
    from calibrant.cameras import Camera
    from calibrant.data import CalibrationResult, Observations, View
    from calibrant.formats.poses.notations import PoseNotation
    from calibrant.tasks.options.images import SearchOptions
    from calibrant.tasks.options.poses import PoseOptions
    from calibrant.tasks.options.robots import RobotOptions
    from calibrant.verification.unchanged.compare import Compared, Seen
    from calibrant.verification.unchanged.robot_noise import RobotSide
    from calibrant.verification.unchanged.spread import Spread


class Placed(Protocol):
    """What is needed of a request whose photos were taken at robot poses."""

    @property
    def poses(self) -> tuple[str, ...]:
        """Files of robot poses."""
        ...

    @property
    def form(self) -> PoseOptions:
        """How poses are written."""
        ...

    @property
    def arm(self) -> RobotOptions:
        """The robot of joint values."""
        ...


class Asked(Placed, Protocol):
    """What is needed of a request that compares."""

    @property
    def reference(self) -> Path | None:
        """A photo of then."""
        ...

    @property
    def search(self) -> SearchOptions:
        """Which photos are searched, and how."""
        ...


@dataclass(frozen=True, eq=False)
class Compare:
    """The calibration's side: the camera and its name, the target's spec, and what was seen then.

    on_robot: whether a robot stands between camera and target; distance of the target's middle, metres.
    """

    known: CalibrationResult
    name: str
    camera: Camera
    target: str | None
    on_robot: bool
    distance: float | None
    sigma_px: float | None

    @classmethod
    def of(cls, known: CalibrationResult, name: str | None, target: str | None) -> Compare:
        """Raises: InputError for a result without a camera, or with several and none named."""
        if not known.cameras:
            raise InputError(
                f"the result is of kind {known.kind!r} and holds no camera to compare photos with; give one of "
                "hand-eye (from photos), pose, intrinsics or rig"
            )
        if name is None and len(known.cameras) > 1:
            raise InputError(
                f"the result has the cameras {', '.join(known.cameras)}: say which took the photos (--name)"
            )
        if name is not None and name not in known.cameras:
            raise InputError(f"--name {name}: the result has no such camera; it has {', '.join(known.cameras)}")
        own = name or next(iter(known.cameras))
        spec = target or _spec_of(known)
        level = known.sigma_px if known.cell is None else known.cell.sigma_px.get(own, known.sigma_px)
        on_robot = known.kind == "hand-eye"
        return cls(known, own, known.cameras[own], spec, on_robot, _distance(known, own), level)

    @property
    def kind(self) -> str:
        """What kind of result it is."""
        return self.known.kind

    @property
    def placed_then(self) -> bool:
        """Whether the result itself says what a photo of now should show, without poses and without a reference."""
        return not self.on_robot and self.target is not None

    @property
    def spread(self) -> Spread:
        """How the calibration's own views differ."""
        from calibrant.verification.unchanged.spread import spread_of

        return spread_of(self.known, self.name, self.camera)

    @property
    def then_outline(self) -> Array | None:
        """Where the target was in the picture of then, (k, 2), for a result of kind pose of one view."""
        views = () if self.known.observations is None else self.known.observations.views
        return views[0].uv if self.kind == "pose" and len(views) == 1 else None


def _spec_of(known: CalibrationResult) -> str | None:
    spec = None if known.observations is None else known.observations.target
    asked = known.options.get("target")
    return spec or (asked if isinstance(asked, str) else None)


def _distance(known: CalibrationResult, name: str) -> float | None:
    """Median depth of the target's middle in the views of a camera, metres."""
    seen = {} if known.observations is None else {v.id: v for v in known.observations.views if v.camera == name}
    depths = []
    for view in known.views:
        T, own = view.T_camera_target, seen.get(view.id)
        if T is not None and own is not None and view.used:
            depths.append(float((T[:3, :3] @ own.points.mean(axis=0) + T[:3, 3])[2]))
    return float(np.median(depths)) if depths else None


def now_compared(
    compare: Compare,
    observations: Observations | None,
    request: Asked,
    photos: Sequence[tuple[Path, bool]],
    listener: Listener,
) -> Compared | None:
    """The photos of the target against the result; None where no target is asked for, or a reference picture stands in
    for one that was not found. Args: photos: all that are named, and whether each is kept. Raises: InputError where
    nothing can be compared."""
    if observations is None:
        return None
    views = [v for v in observations.views if len(v) >= 4]
    if not views:
        if request.reference is not None or not (request.poses or compare.placed_then):
            return None
        reasons = "; ".join(f"{m.id}: {m.reason}" for m in observations.missed[:3])
        raise InputError(f"no photo shows the target {compare.target}: {reasons or 'too few of its points'}")
    check_size(compare, observations)
    session.load_solver(listener)

    from calibrant.verification.unchanged.compare import lens_alone, seen_now

    with listener.status("Comparing with the calibration …"):
        if request.poses:
            return _at_poses(compare, views, request, photos)
        seen = seen_now(compare.camera, views)
        then = _view_of_then(compare, seen, request, listener)
        if then is not None:
            return _as_then(compare, *then, seen)
        return None if compare.on_robot else lens_alone(compare.camera, seen, compare.spread)


def check_size(compare: Compare, observations: Observations) -> None:
    """Raises: InputError for photos of another resolution than the calibration's."""
    size = next(iter(observations.image_sizes.values()))
    if size != compare.camera.image_size:
        raise InputError(
            f"the calibration is of pictures of {compare.camera.image_size[0]}x{compare.camera.image_size[1]} px, the "
            f"photos are {size[0]}x{size[1]} px: take them in the resolution of the calibration"
        )


def _at_poses(compare: Compare, views: list[View], request: Asked, photos: Sequence[tuple[Path, bool]]) -> Compared:
    from calibrant.verification.unchanged.compare import on_robot

    side, seen, T = seen_at_poses(compare, views, request, photos)
    return on_robot(compare.camera, side, seen, T, compare.spread)


def seen_at_poses(
    compare: Compare, views: list[View], request: Placed, photos: Sequence[tuple[Path, bool]]
) -> tuple[RobotSide, Seen, Array]:
    """The robot's side, the photos, and T_base_gripper (n, 4, 4) of each; poses are read as the calibration's were, or
    as fits best. Raises: InputError for a result without what is needed, or poses that do not belong."""
    from calibrant.data.file_names import distinct_names
    from calibrant.formats.poses.notations import notations
    from calibrant.formats.poses.pairing import match_kept
    from calibrant.verification.unchanged.compare import seen_now
    from calibrant.verification.unchanged.robot_noise import robot_side

    raw = request.form.read(request.poses, request.arm)
    names, files = distinct_names([f for f, _ in photos]), [f for f, keep in photos if keep]
    pairing = match_kept(raw, list(names.values()), [keep for _, keep in photos])
    row = {str(files[v]): p for v, p in zip(pairing.view_index, pairing.pose_index)}
    rows = [row[v.file or v.id] for v in views]
    side = robot_side(compare.known, compare.name)
    known = compare.known.decided.get("pose_reading")
    ways = notations(raw)
    same = [way for way in ways if way.description == known]
    seen = seen_now(compare.camera, views)
    kept = [next(i for i, v in enumerate(views) if v.id == s.id) for s in seen.views]
    best = min(same or ways, key=lambda way: _misfit(side, seen, _poses(way, rows, kept, views)))
    T = _poses(best, rows, kept, views)
    return side, _numbered(compare, side, seen, T), T


def _poses(way: PoseNotation, rows: list[int], kept: list[int], views: list[View]) -> Array:
    return way.take([rows[i] for i in kept], [views[i].id for i in kept]).T_base_gripper


def _misfit(side: RobotSide, seen: Seen, T_base_gripper: Array) -> float:
    """How far the target's origin is from where the robot puts it, metres, over the photos."""
    off = side.predicted(T_base_gripper)[:, :3, 3] - seen.T_camera_target[:, :3, 3]
    return float(np.median(np.linalg.norm(off, axis=1)))


def _numbered(compare: Compare, side: RobotSide, seen: Seen, T_base_gripper: Array) -> Seen:
    """Photos of a board that looks the same turned, numbered from the end that the calibration's views start at."""
    from calibrant.calibrate.cell.boards.turned import board_turns, turned_views

    turns = board_turns(compare.target)
    if turns is None:
        return seen
    wanted = side.predicted(T_base_gripper)[:, None, :3, :3]
    R = seen.T_camera_target[:, None, :3, :3] @ turns.F[None, :, :3, :3]
    ends = np.argmax(np.sum(wanted * R, axis=(2, 3)), axis=1)
    F = turns.F[ends]
    views = turned_views(seen.views, range(len(seen.views)), F)
    return replace(seen, views=views, T_camera_target=seen.T_camera_target @ F)


def _view_of_then(compare: Compare, seen: Seen, request: Asked, listener: Listener) -> tuple[View, Array, Array] | None:
    """A view of the target where it stood then, sigma (n,) of its points and T_camera_target: of the reference photo,
    else of a pose result the one nearest to the photos of now."""
    from calibrant.verification.unchanged.compare import seen_now

    if request.reference is not None and compare.target is not None:
        views = _in_reference(request.reference, compare.target, request.search.mirror_x, listener)
    elif compare.kind == "pose" and compare.known.observations is not None:
        used = {v.id for v in compare.known.views if v.used}
        views = [v for v in compare.known.observations.views if v.id in used and len(v) >= 4]
    else:
        return None
    if not views:
        return None
    then = seen_now(compare.camera, views)
    off = np.linalg.norm(then.T_camera_target[:, :3, 3] - seen.T_camera_target[0, :3, 3], axis=1)
    k = int(np.argmin(off))
    return then.views[k], then.sigmas[k], then.T_camera_target[k]


def _in_reference(photo: Path, target: str, mirror_x: bool, listener: Listener) -> list[View]:
    """The target in the reference photo; none where it does not show it."""
    try:
        found = session.detect_boards([photo], target, mirror_x=mirror_x, workers=1, cache="none", listener=listener)
    except DetectionError:
        return []
    return [v for v in found.views if len(v) >= 4]


def _as_then(compare: Compare, then: View, sigma: Array, T: Array, seen: Seen) -> Compared:
    from calibrant.verification.unchanged.compare import standing

    return standing(compare.camera, then, sigma, T, seen, compare.spread)
