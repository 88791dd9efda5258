"""Where a calibrated camera says that a target is in the robot's base, from photos of now."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from calibrant.errors import InputError
from calibrant.tasks.inputs import session
from calibrant.tasks.listener import Listener
from calibrant.tasks.verify.photos import every_photo, target_seen
from calibrant.tasks.verify.sides import Compare, Placed, check_size

if TYPE_CHECKING:
    from calibrant.arrays import Array
    from calibrant.data import View
    from calibrant.formats.poses.raw import RawPoses
    from calibrant.targets.target import Target
    from calibrant.tasks.options.images import NamedPhotoOptions, SearchOptions
    from calibrant.verification.touch.placing import Placing
    from calibrant.verification.touch.table import Table
    from calibrant.verification.unchanged.robot_noise import RobotSide


class Asked(Placed, Protocol):
    """What is needed of a request that places a target."""

    @property
    def photos(self) -> NamedPhotoOptions:
        """The photos and the target."""
        ...

    @property
    def search(self) -> SearchOptions:
        """Which photos are searched, and how."""
        ...

    @property
    def name(self) -> str | None:
        """Which camera of the result."""
        ...


@dataclass(frozen=True, eq=False)
class PlacedTargets:
    """The side of the camera, its name and the frame it is fixed to, the target, and a placing for every photo that
    shows it, with the robot's pose then (None for a camera beside the robot)."""

    compare: Compare
    side: RobotSide
    target: Target
    placings: tuple[Placing, ...]
    T_base_gripper: tuple[Array | None, ...]

    @property
    def parent(self) -> str:
        """The frame that the camera is fixed to."""
        return "gripper" if self.side.in_hand else "base"

    @property
    def middle(self) -> Array:
        """The target's middle (3,), its own frame."""
        import numpy as np

        points = self.target.points
        return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def placed_targets(result: Path, request: Asked, table: Table | None, listener: Listener) -> PlacedTargets:
    """Every photo's target in the base.

    Raises: InputError for a result that is no hand-eye, no target, a hand camera without poses, no photo of it;
    RefusedError for a height that contradicts the table.
    """
    from calibrant.data.result_file import read_result
    from calibrant.targets.registry import parse_target
    from calibrant.verification.unchanged.robot_noise import robot_side

    known = read_result(result)
    if known.kind != "hand-eye":
        raise InputError(
            f"{result} is of kind {known.kind!r}: to say where something is for the robot, the camera's place on it or "
            "beside it is needed; give a result of `calibrant hand-eye`"
        )
    compare = Compare.of(known, request.name, request.photos.target)
    if compare.target is None:
        raise InputError("say what the photos show: --target, such as marker:100mm:DICT_5X5_50:7")
    side = robot_side(known, compare.name)
    if side.in_hand and not request.poses:
        raise InputError("the camera is in the robot's hand: give the robot's poses of the photos (--poses FILE)")
    photos = every_photo(request.photos, request.search)
    files = [file for file, keep in photos if keep]
    seen = target_seen(compare, files, request.search, listener, optional=False)
    views = [] if seen is None else [v for v in seen.views if len(v) >= 4]
    if seen is None or not views:
        reasons = "" if seen is None else "; ".join(f"{m.id}: {m.reason}" for m in seen.missed[:3])
        raise InputError(f"no photo shows the target {compare.target}: {reasons or 'too few of its points'}")
    check_size(compare, seen)
    session.load_solver(listener)
    poses = _poses(compare, views, request, photos) if side.in_hand else [None] * len(views)
    target = parse_target(compare.target)
    placings = tuple(_placing(compare, side, v, T, target, table) for v, T in zip(views, poses))
    return PlacedTargets(compare, side, target, placings, tuple(poses))


def _placing(
    compare: Compare, side: RobotSide, view: View, T_base_gripper: Array | None, target: Target, table: Table | None
) -> Placing:
    from calibrant.verification.pinpoint.look import marker_pose
    from calibrant.verification.touch.placing import placed_in_base
    from calibrant.verification.touch.table import check_height, lying_on

    R = side.X[:3, :3] if T_base_gripper is None else T_base_gripper[:3, :3] @ side.X[:3, :3]
    placing = placed_in_base(compare.camera, side, marker_pose(compare.camera, view, R), T_base_gripper)
    if table is None:
        return placing
    middle = 0.5 * (target.points.min(axis=0) + target.points.max(axis=0))
    check_height(placing, middle, table, camera=compare.name)
    return lying_on(placing, table)


def _poses(compare: Compare, views: list[View], request: Placed, photos: list[tuple[Path, bool]]) -> list[Array]:
    """T_base_gripper of every view, read as the calibration's poses were."""
    from calibrant.data.file_names import distinct_names
    from calibrant.formats.poses.pairing import match_kept

    raw = request.form.read(request.poses, request.arm)
    names, files = distinct_names([f for f, _ in photos]), [f for f, keep in photos if keep]
    pairing = match_kept(raw, list(names.values()), [keep for _, keep in photos])
    row = {str(files[v]): p for v, p in zip(pairing.view_index, pairing.pose_index)}
    rows = [row[v.file or v.id] for v in views]
    return list(as_calibrated(compare, raw, rows, [v.id for v in views]))


def as_calibrated(compare: Compare, raw: RawPoses, rows: list[int], ids: list[str]) -> Array:
    """T_base_gripper (n, 4, 4) of rows of the poses, read as the calibration's were. Raises: InputError where several
    readings are possible and none of them is the calibration's."""
    from calibrant.formats.poses.notations import notations

    ways = notations(raw)
    known = compare.known.decided.get("pose_reading")
    same = [way for way in ways if way.description == known] or (ways if len(ways) == 1 else [])
    if not same:
        said = "; ".join(way.description for way in ways[:3])
        raise InputError(
            f"the poses can be read in {len(ways)} ways ({said} …), and none is the calibration's "
            f"({known or 'unknown'}): "
            "say how they are written (--pose-units, --pose-rotation, --pose-angle, --pose-direction)"
        )
    return same[0].take(rows, ids).T_base_gripper
