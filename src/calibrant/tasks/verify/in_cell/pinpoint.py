"""Pinpoints in simulated cells, each calibrated from its own pictures: measured by the truth, corrected by touches."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult
from calibrant.data.details import TaskRun
from calibrant.data.devices import Robot
from calibrant.errors import CalibrantError, InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.tasks.listener import Listener
from calibrant.tasks.options.cell import CellOptions

if TYPE_CHECKING:
    from calibrant.simulate.robot_cell.cell import RobotCell
    from calibrant.verification.pinpoint.run import Pinpoint
    from calibrant.verification.touch.errors import Correction, Touch
    from calibrant.verification.unchanged.robot_noise import RobotSide

TOUCHES = 4
"""Pinpoints that the correction is made from, at places apart; the one after it is at another."""
PLACES = ((0.42, -0.12), (0.60, 0.12))
"""Metres of the table that arm and all three cameras reach."""
LOOK_M = 0.34
"""Of a wrist camera above the marker: the marker fills a third of its picture's height."""
PLACED_M = 0.015
"""How far off the middle a person holds a hand camera over a marker, 1 sigma."""
FAST, SLOW = 1.0, 0.3
"""Shares of the simulated arm's speed: nobody stands beside it."""
MARKER = "marker"


def pinpoint_series(
    options: CellOptions, *, tolerance_mm: float | None, hover: float, yes: bool, listener: Listener
) -> CalibrationResult:
    """The result of kind "pinpoint" over all seeds."""
    from calibrant.verification.pinpoint.result import series_result

    runs = []
    with listener.progress("Pinpointing") as step:
        for i, seed in enumerate(options.runs):
            runs.append(pinpoint_run(options, seed, tolerance_mm=tolerance_mm, hover=hover, yes=yes))
            step(i + 1, len(options.runs), f"seed {seed}")
    return series_result(runs, view=options.view, tolerance_mm=tolerance_mm)


def pinpoint_run(options: CellOptions, seed: int, *, tolerance_mm: float | None, hover: float, yes: bool) -> TaskRun:
    """One cell: calibrated, pinpointed, corrected by touches, pinpointed again at a new place."""
    from calibrant.studies.cell_calibration import calibrate_cell_cameras
    from calibrant.verification.touch.errors import correction_of
    from calibrant.verification.touch.result import touch_run
    from calibrant.verification.unchanged.robot_noise import robot_side

    name = f"seed {seed}"
    with options.opened(seed) as cell:
        try:
            known = calibrate_cell_cameras(cell, (options.view,))[options.view].hand_eye
            side = robot_side(known, options.view)
            _clear(cell)
            cell.carry("pen")
            task = _task(cell, options.view, known, side, hover=hover, yes=yes)
            rng = np.random.default_rng([seed, *b"pinpoint"])
            places = rng.uniform(*PLACES, (TOUCHES + 1, 2))
            turns = rng.uniform(-np.pi, np.pi, TOUCHES + 1)
            touches = [_at(cell, task, p, t, rng) for p, t in zip(places[:-1], turns)]
            last = _at(cell, task, places[-1], turns[-1], rng)
            better = replace(task, side=corrected_side(side, correction_of(touches)))
            after = _at(cell, better, places[-1], turns[-1], rng)
        except (RefusedError, CalibrantError) as error:
            if isinstance(error, InputError):
                raise
            return TaskRun(name, False, seed=seed, reason=str(error))
    run = touch_run(replace(last, name=name), tolerance_mm=tolerance_mm, after=after, seed=seed)
    return run


def corrected_side(side: RobotSide, found: Correction) -> RobotSide:
    """The side with the camera corrected: what is not known of it any more is what the touches left."""
    C = np.zeros_like(side.covariance)
    C[:6, :6] = found.covariance
    return replace(side, X=se3.retract(side.X, -found.error), covariance=C)


def _clear(cell: RobotCell) -> None:
    for name in list(cell.objects):
        if name != MARKER and cell.present(name):
            cell.remove(name)


def _task(
    cell: RobotCell, view: str, known: CalibrationResult, side: RobotSide, *, hover: float, yes: bool
) -> Pinpoint:
    from calibrant.targets.registry import parse_target
    from calibrant.verification.pinpoint.run import Pinpoint
    from calibrant.verification.touch.table import Table

    spec = cell.objects[MARKER].target
    if spec is None:
        raise InputError("the cell's marker has no target spec")
    robot: Robot = cell.robot
    return Pinpoint(
        robot,
        cell.cameras[view],
        known.cameras[view],
        side,
        parse_target(spec),
        cell.truth.T_gripper_tip,
        lambda words: yes or not robot.moves_matter,
        Table(),
        hover=hover,
        speeds=(FAST, SLOW),
    )


def _at(cell: RobotCell, task: Pinpoint, place: Array, turn: float, rng: np.random.Generator) -> Touch:
    """A pinpoint with the marker at a place (x, y) of the table."""
    from calibrant.verification.pinpoint.run import pinpoint

    cell.robot.move_joints(cell.robot.home, speed=FAST)
    cell.lay(MARKER, float(place[0]), float(place[1]), yaw=float(turn))
    if task.side.in_hand:
        x, y = place + PLACED_M * rng.normal(size=2)
        cell.robot.move_to(over(task.side.X, np.array([x, y, LOOK_M]), cell.robot.pose()), speed=FAST)

    def measure() -> Array:
        return se3.inverse(cell.truth.T_base_object(MARKER)) @ cell.truth.T_base_tip()

    return pinpoint(task, MARKER, measure)[0]


def over(T_gripper_camera: Array, place: Array, T_base_gripper: Array) -> Array:
    """T_base_gripper (4, 4) that puts a hand camera at a place (3,), looking down, the hand turned as it is now."""
    down = so3.exp([np.pi, 0, 0])
    ahead = T_base_gripper[:3, :3] @ T_gripper_camera[:3, 0]
    yaw = float(np.arctan2(ahead[1], ahead[0]))
    T_base_camera = se3.make(so3.exp([0, 0, yaw]) @ down, place)
    return np.asarray(T_base_camera @ se3.inverse(T_gripper_camera))
