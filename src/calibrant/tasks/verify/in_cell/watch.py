"""Watching cameras of simulated cells that are pushed at a picture: named in time, by how much, and not before."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult, View
from calibrant.data.details import TaskRun
from calibrant.errors import CalibrantError, InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.tasks.listener import Listener
from calibrant.tasks.options.cell import CellOptions
from calibrant.tasks.verify.in_cell.pinpoint import FAST

if TYPE_CHECKING:
    from calibrant.simulate.robot_cell.cell import RobotCell
    from calibrant.targets.target import Target
    from calibrant.verification.watch.sequential import Sight, Watch

BEFORE, WITHIN = 12, 10
"""Pictures before the push, and after it until it must be named."""
PUSH_M, TURN_DEG = 1e-3, 0.1
"""Even seeds push the camera, odd ones turn it, in a direction drawn at random."""
BOARD = "watched board"
SPEC = "charuco:4x5:100mm:75mm:DICT_4X4_50"
"""Large enough for cameras 1.3 m away with 380 px of focal length: its markers are 22 px there."""
BOARD_AT = (0.52, 0.0)
AWAY_M, TILT = (0.38, 0.52), 0.45
"""Of a wrist camera from the board, metres, and its tilt, radians."""


def watch_series(options: CellOptions, *, run: float, listener: Listener) -> CalibrationResult:
    """The result of kind "watch" over all seeds."""
    from calibrant.verification.watch.result import watch_series_result

    runs = []
    with listener.progress("Watching") as step:
        for i, seed in enumerate(options.runs):
            try:
                runs.append(watch_run(options, seed, run))
            except InputError:
                raise
            except CalibrantError as error:
                runs.append(TaskRun(f"seed {seed}", False, seed=seed, reason=str(error)))
            step(i + 1, len(options.runs), f"seed {seed}")
    return watch_series_result(runs, view=options.view, rate=run)


def watch_run(options: CellOptions, seed: int, run: float) -> TaskRun:
    """One cell: calibrated, watched, pushed, named or not."""
    from calibrant.simulate.robot_cell import RobotCellSpec, sheet
    from calibrant.studies.cell_calibration import calibrate_cell_cameras
    from calibrant.targets.registry import parse_target
    from calibrant.verification.watch.placed import shared_while_still
    from calibrant.verification.watch.sequential import Rule, Watch

    plain = RobotCellSpec()
    spec = replace(plain, objects=(*plain.objects, sheet(BOARD, SPEC, present=False)))
    with options.opened(seed, spec=spec) as cell:
        known = calibrate_cell_cameras(cell, (options.view,))[options.view].hand_eye
        for name in list(cell.objects):
            if cell.present(name):
                cell.remove(name)
        rng = np.random.default_rng([seed, *b"watch"])
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        push = np.concatenate([np.zeros(3), PUSH_M * axis]) if seed % 2 == 0 else np.concatenate(
            [np.deg2rad(TURN_DEG) * axis, np.zeros(3)]
        )  # fmt: skip
        cell.lay(BOARD, *BOARD_AT)
        before, in_hand = _mounted(cell, options.view), cell.cameras[options.view].parent == "gripper"
        views, poses = _pictures(cell, options.view, parse_target(SPEC), known, push, rng)
        moved = se3.local(np.eye(4), se3.inverse(before) @ _mounted(cell, options.view))
        freedom, sights = _sights(known, options.view, views, poses)
    state = Watch(Rule(run=run, freedom=freedom))
    for sight in sights:
        state = state.after(sight)
    still = np.zeros((6, 6)) if in_hand else shared_while_still(sights[-1])
    return _judged(state, moved, seed, still)


def _mounted(cell: RobotCell, view: str) -> Array:
    """The camera in what carries it, truly."""
    in_hand = cell.cameras[view].parent == "gripper"
    return cell.truth.T_gripper_camera(view) if in_hand else cell.truth.T_base_camera(view)


def _pictures(
    cell: RobotCell, view: str, target: Target, known: CalibrationResult, push: Array, rng: np.random.Generator
) -> tuple[list[View], Array]:
    """Views of the board and the controller's poses, the camera pushed after some of them."""
    from calibrant.verification.pinpoint.look import seen_in
    from calibrant.verification.unchanged.robot_noise import robot_side

    side, views, poses = robot_side(known, view), [], []
    for k in range(BEFORE + WITHIN):
        if k == BEFORE:
            cell.push(view, push)
        if side.in_hand:
            _move(cell, side.X, rng)
        elif k == 0:
            cell.robot.move_joints(cell.robot.home, speed=FAST)
        found = seen_in(cell.cameras[view].take(), target)
        if isinstance(found, str):
            raise RefusedError(f"picture {k} does not show the board: {found}")
        views.append(found)
        poses.append(cell.robot.pose())
    return views, np.stack(poses)


def _move(cell: RobotCell, X: Array, rng: np.random.Generator) -> None:
    """A wrist camera to another place over the board; places that the arm does not reach are drawn again."""
    for _ in range(20):
        R = so3.exp([0, 0, rng.uniform(-1, 1)]) @ so3.exp([np.pi, 0, 0])
        R = R @ so3.exp([*(TILT * rng.uniform(-1, 1, 2)), 0.0])
        R = _as_the_hand(cell, X, R)
        eye = np.array([*BOARD_AT, 0.0]) - rng.uniform(*AWAY_M) * R[:, 2]
        try:
            cell.robot.move_to(se3.make(R, eye) @ se3.inverse(X), speed=FAST)
        except RefusedError:
            continue
        return
    raise RefusedError("the arm reaches none of 20 places over the board")


def _as_the_hand(cell: RobotCell, X: Array, R: Array) -> Array:
    """The rotation turned about the line of sight by quarter turns, to where the hand is turned least."""
    now = cell.robot.forward(cell.robot.home)[:3, :3] @ X[:3, :3]
    ways = [R @ so3.exp([0, 0, k * np.pi / 2]) for k in range(4)]
    return min(ways, key=lambda way: float(np.linalg.norm(so3.log(now.T @ way))))


def _sights(known: CalibrationResult, view: str, views: list[View], poses: Array) -> tuple[float, tuple[Sight, ...]]:
    """The degrees of freedom of the stated noise, and the sights."""
    from calibrant.verification.unchanged.compare import seen_now
    from calibrant.verification.unchanged.robot_noise import robot_side
    from calibrant.verification.watch.placed import at_robot_poses, placed_views, standing_still, with_target_at

    camera, side = known.cameras[view], robot_side(known, view)
    first = seen_now(camera, views[:1]).T_camera_target[0]
    if not side.in_hand:
        placed = placed_views(camera, views, np.tile(first, (len(views), 1, 1)), stated_px=None)
        return float("inf"), standing_still(placed, None)
    near = with_target_at(side, poses[0] @ side.X @ first)
    placed = placed_views(camera, views, near.predicted(poses), stated_px=known.sigma_px)
    return side.freedom, at_robot_poses(camera, near, placed, poses)


def _judged(state: Watch, moved: Array, seed: int, still: Array) -> TaskRun:
    """Whether the push was named in time, and how far what was said of it is from the truth. Args: still (6, 6), what
    no number of pictures lowers."""
    from calibrant.verification.touch.errors import CHI2_3_95, radius_95

    kind = "pushed by 1 mm" if seed % 2 == 0 else "turned by 0.1 deg"
    name, alarm = f"seed {seed}, {kind}", state.alarm
    if alarm is None:
        return TaskRun(name, False, seed=seed, reason=f"not named within {WITHIN} pictures")
    if alarm.at < BEFORE:
        return TaskRun(name, False, seed=seed, reason=f"a false alarm at picture {alarm.at}")
    move, C = state.move, state.covariance
    if move is None or C is None:
        return TaskRun(name, True, seed=seed)
    C = C + still
    off, S = (move - moved)[3:], C[3:, 3:]
    return TaskRun(
        name,
        True,
        float(1e3 * np.linalg.norm(off)),
        1e3 * radius_95(S),
        float(off @ np.linalg.solve(S, off)) <= CHI2_3_95,
        seed,
        turned_deg=float(np.rad2deg(np.linalg.norm((move - moved)[:3]))),
        predicted_95_deg=float(np.rad2deg(radius_95(C[:3, :3]))),
        reason=f"named by picture {alarm.at - BEFORE + 1} after it",
    )
