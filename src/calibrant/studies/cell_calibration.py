"""Calibrating the cameras of a simulated cell as a user would: drive, photograph, detect, calibrate.

Nothing of the truth is used: where the arm is sent follows from where a person would say that the cameras are (the
spec), and the result from pictures, the controller's poses and the boards alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.cell.hand_eye import calibrate_hand_eye
from calibrant.calibrate.intrinsics.calibrate import calibrate_intrinsics
from calibrant.data import CalibrationResult, Missed, Observations, Picture, RobotPoses, View
from calibrant.data.renamed import with_camera_name
from calibrant.detection.registry import detector_for
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.opencv import cv2
from calibrant.robots.inverse import solve_inverse
from calibrant.simulate.robot_cell.parts.spec import HELD_BOARD, LARGE_BOARD, CellCamera
from calibrant.targets.registry import parse_target
from calibrant.targets.target import Target

if TYPE_CHECKING:
    from calibrant.simulate.robot_cell.cell import RobotCell

VIEWS = {"gripper": 18, "base": 26}
"""Pictures with the arm by what the camera is mounted on; the thesis takes 20 for a wrist camera, 10 to 20 for fixed
ones, which are farther from their board: here more of them."""
HELD_VIEWS = 10
"""Pictures of the board held before a fixed camera, for its lens: the thesis finds a plateau from 5 to 10."""
ROBOT_ACCURACY = "0.2mm,0.03deg"
"""What is told of the arm: rms of its flange over the workspace, as its maker's calibration left it (`RobotNoise`'s
default comes to 0.21 mm and 0.03 degrees). Untold, errors of its geometry would be in the answer, not in its sigma."""
_BOARD_AT = (0.52, 0.0)
_DRAWN = 12
"""Candidates drawn a pose wanted: most are out of reach or out of the picture."""


@dataclass(frozen=True, eq=False)
class CellCalibration:
    """What a user has after calibrating one camera: its hand-eye result, and that of the lens where it was made apart.

    name: the camera's, which is what both results call it. hand_eye: transforms gripper -> NAME for a wrist camera,
    base -> NAME for a fixed one.
    """

    name: str
    hand_eye: CalibrationResult
    intrinsics: CalibrationResult | None


def calibrate_cell_cameras(
    cell: RobotCell,
    views: Sequence[str] = ("wrist",),
    *,
    pictures: int | None = None,
    robot_accuracy: str | None = ROBOT_ACCURACY,
) -> dict[str, CellCalibration]:
    """Calibrate cameras of a cell by the project's own functions; things on the table go away meanwhile and come back.

    A wrist camera looks at the large board on the table from several places; lens and mounting come from these. A
    fixed camera first has the stick's board held before it (a person does that), then sees it in the gripper.

    Args: views: names of the cell's cameras; pictures: with the arm, `VIEWS` unless given; robot_accuracy: as
    of `calibrate_hand_eye`, None where the arm is perfect but for scatter. Returns a calibration each. Raises:
    InputError for an unknown camera; RefusedError when too few places can be reached, or as `calibrate_hand_eye`.

        >>> from calibrant.simulate.robot_cell import make_robot_cell
        >>> from calibrant.studies.cell_calibration import calibrate_cell_cameras
        >>> with make_robot_cell(0) as cell:                                                   # doctest: +SKIP
        ...     found = calibrate_cell_cameras(cell, ("wrist", "front"))
        ...     found["front"].hand_eye.transform("base", "front").matrix
    """
    away = {n: cell.truth.T_base_object(n) for n in cell.objects if cell.present(n)}
    tool = cell.tool
    for name in away:
        cell.remove(name)
    try:
        return {name: _calibrated(cell, name, pictures, robot_accuracy) for name in views}
    finally:
        cell.carry(tool)  # type: ignore[arg-type]
        for name, T in away.items():
            cell.place(name, T)
        cell.robot.move_joints(cell.robot.home)


def _calibrated(cell: RobotCell, name: str, asked: int | None, accuracy: str | None) -> CellCalibration:
    camera = next(c for c in cell.spec.cameras if c.name == cell.camera(name).name)
    pictures = VIEWS[camera.parent] if asked is None else asked
    rng = np.random.default_rng([cell.seed, *f"calibrate {name}".encode()])
    if camera.parent == "gripper":
        observations, poses = _from_the_wrist(cell, camera, pictures, rng)
        hand_eye = calibrate_hand_eye(poses, observations, setup="eye-in-hand", robot_accuracy=accuracy)
        return CellCalibration(name, with_camera_name(hand_eye, name), None)
    held = calibrate_intrinsics(_held_before(cell, camera, HELD_VIEWS, rng))
    observations, poses = _from_the_stick(cell, camera, pictures, rng)
    hand_eye = calibrate_hand_eye(poses, observations, setup="eye-to-hand", camera=held.camera, robot_accuracy=accuracy)
    return CellCalibration(name, with_camera_name(hand_eye, name), with_camera_name(held, name))


def _from_the_wrist(
    cell: RobotCell, camera: CellCamera, count: int, rng: np.random.Generator
) -> tuple[Observations, RobotPoses]:
    """Pictures of the large board on the table."""
    board, target = _board(cell)
    cell.carry(None)
    T_base_board = cell.lay(board, *_BOARD_AT)
    x0, y0, x1, y1 = target.artwork().bounds
    drawn = _DRAWN * count
    spots = rng.uniform((0.25, 0.25), (0.75, 0.75), (drawn, 2)) * [x1 - x0, y1 - y0] + [x0, y0]
    B = _looks(spots, rng, distance=(0.30, 0.55), tilt_deg=(10, 38))
    T_base_gripper = T_base_board @ se3.inverse(B) @ se3.inverse(camera.T_parent_camera)
    taken = _drive(cell, camera.name, _reachable(cell, T_base_gripper, count))
    cell.remove(board)
    return _detected(taken, target, camera), _poses(taken)


def _from_the_stick(
    cell: RobotCell, camera: CellCamera, count: int, rng: np.random.Generator
) -> tuple[Observations, RobotPoses]:
    """Pictures of the board in the gripper."""
    target = parse_target(cell.spec.stick_board)
    cell.carry("stick")
    drawn = 4 * _DRAWN * count
    R = _facing(drawn, rng, tilt_deg=(8, 40), roll_deg=180)
    middle = _middle(target)
    places = rng.uniform((0.30, -0.35, 0.25), (0.70, 0.35, 0.75), (drawn, 3))
    in_camera = se3.apply(se3.inverse(camera.T_parent_camera), places)
    B = se3.make(R, in_camera - np.einsum("nij,j->ni", R, middle))
    B = B[_in_view(camera, target, B)]
    T_base_gripper = camera.T_parent_camera @ B @ se3.inverse(cell.truth.T_gripper_stick_board)
    taken = _drive(cell, camera.name, _reachable(cell, T_base_gripper, count))
    cell.carry(None)
    return _detected(taken, target, camera), _poses(taken)


def _held_before(cell: RobotCell, camera: CellCamera, count: int, rng: np.random.Generator) -> Observations:
    """Pictures of the stick's board, held before a fixed camera by hand."""
    board, target = HELD_BOARD, parse_target(cell.spec.stick_board)
    x0, y0, x1, y1 = target.artwork().bounds
    spots = rng.uniform((0.4, 0.4), (0.6, 0.6), (count, 2)) * [x1 - x0, y1 - y0] + [x0, y0]
    # Metres at which its longer side fills the picture's width.
    fills = camera.colour.parameters["fx"] * max(x1 - x0, y1 - y0) / camera.colour.image_size[0]
    B = _looks(spots, rng, distance=(0.9 * fills, 1.6 * fills), tilt_deg=(12, 40))
    taken = []
    for T in B:
        cell.place(board, camera.T_parent_camera @ T)
        taken.append((cell.cameras[camera.name].take_colour(), np.eye(4)))
    cell.remove(board)
    return _detected(taken, target, camera)


def _board(cell: RobotCell) -> tuple[str, Target]:
    """The large board among the cell's things. Raises: RefusedError when there is none."""
    for item in cell.objects.values():
        if item.target is not None and parse_target(item.target).kind == "charuco":
            return item.name, parse_target(item.target)
    raise RefusedError(f"the cell has no ChArUco board to calibrate with; add sheet('board', '{LARGE_BOARD}')")


def _looks(
    spots: Array, rng: np.random.Generator, *, distance: tuple[float, float], tilt_deg: tuple[float, float]
) -> Array:
    """T_camera_board (n, 4, 4): spots (n, 2) of the board near the middle of the picture, tilted, at a distance."""
    count = len(spots)
    R = _facing(count, rng, tilt_deg=tilt_deg, roll_deg=180)
    away = rng.uniform(*distance, count)
    centre = np.column_stack([away[:, None] * rng.uniform(-0.12, 0.12, (count, 2)), away])
    points = np.column_stack([spots, np.zeros(count)])
    return se3.make(R, centre - np.einsum("nij,nj->ni", R, points))


def _facing(count: int, rng: np.random.Generator, *, tilt_deg: tuple[float, float], roll_deg: float) -> Array:
    """Rotations R_camera_board (n, 3, 3) of boards that face a camera, tilted about any axis of its picture."""
    along = rng.uniform(0, 2 * np.pi, count)
    tilt = np.deg2rad(rng.uniform(*tilt_deg, count))
    axis = np.column_stack([np.cos(along), np.sin(along), np.zeros(count)])
    roll = np.deg2rad(roll_deg) * rng.uniform(-1, 1, count)
    return so3.exp(tilt[:, None] * axis) @ so3.exp(roll[:, None] * [0.0, 0.0, 1.0])


def _in_view(camera: CellCamera, target: Target, B: Array) -> Array:
    uv = camera.colour.project(se3.apply(B[:, None], target.points))
    margin = 12
    with np.errstate(invalid="ignore"):
        return np.all((uv > margin) & (uv < np.array(camera.colour.image_size) - 1 - margin), axis=(1, 2))


def _middle(target: Target) -> Array:
    return 0.5 * (target.points.min(axis=0) + target.points.max(axis=0))


def _reachable(cell: RobotCell, T_base_gripper: Array, count: int) -> list[Array]:
    """Joints of the first `count` of the poses that the arm reaches clear of its limits and of the table.

    Raises: RefusedError when there are fewer than half of them.
    """
    robot = cell.robot
    found = solve_inverse(robot.chain, T_base_gripper, robot.home, iterations=60)
    clear = np.minimum(found.q - robot.chain.lower, robot.chain.upper - found.q).min(axis=1) > np.deg2rad(3)
    kept: list[Array] = []
    for q, T in zip(found.q[found.reached & clear], T_base_gripper[found.reached & clear]):
        if robot.workspace.below_table(T) is None and T[2, 3] > 0.1:
            kept.append(q)
        if len(kept) == count:
            return kept
    if 2 * len(kept) < count:
        raise RefusedError(
            f"the arm reaches only {len(kept)} of the {count} calibration poses; stand the camera or the board nearer"
        )
    return kept


def _drive(cell: RobotCell, camera: str, joints: Sequence[Array]) -> list[tuple[Picture, Array]]:
    """A picture and the controller's pose at each of the places, in an order of short ways; places behind the table are
    left out."""
    taken = []
    for q in _in_short_order(joints, cell.robot.joints()):
        try:
            cell.robot.move_joints(q, speed=1.0)
        except RefusedError:
            continue
        pose = cell.robot.pose()
        taken.append((cell.cameras[camera].take_colour(), pose))
    return taken


def _in_short_order(joints: Sequence[Array], start: Array) -> list[Array]:
    left, at, order = list(joints), start, []
    while left:
        k = int(np.argmin([np.abs(q - at).max() for q in left]))
        at = left.pop(k)
        order.append(at)
    return order


def _poses(taken: Sequence[tuple[Picture, Array]]) -> RobotPoses:
    return RobotPoses.from_matrices([T for _, T in taken], ids=[picture.name for picture, _ in taken])


def _detected(taken: Sequence[tuple[Picture, Array]], target: Target, camera: CellCamera) -> Observations:
    """The board in every picture; pictures without it are listed as missed."""
    detector = detector_for(target.kind)
    row_of = {int(label): row for row, label in enumerate(target.point_ids)}
    seen, missed = [], []
    for picture, _ in taken:
        grey = np.asarray(cv2.cvtColor(picture.colour, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        found = detector.detect(grey, target)
        if not found.found:
            missed.append(Missed(picture.name, found.reason or "", "camera", ""))
            continue
        rows = np.array([row_of[int(label)] for label in found.point_ids])
        seen.append(View(picture.name, target.points[rows], found.uv, found.point_ids, sigma_px=found.sigma_px))
    if not seen:
        raise RefusedError(f"camera {camera.name} sees the board in none of {len(taken)} pictures; move it nearer")
    return Observations(tuple(seen), {"camera": camera.colour.image_size}, target.spec, tuple(missed))
