"""Grasps from a conveyor in simulated cells: a cube that the belt carries and that turns, seen by the wrist camera.

Each seed is a cell whose wrist camera is calibrated by this project from rendered pictures. The cube's pose comes from
the outline of its colour; a turntable under the cube, which no belt has, turns it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import DeviceError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.perceive.colour.ranges import ColourRange
from calibrant.robots.inverse import solve_inverse
from calibrant.servoing.conveyor.box_outline import BoxOutline
from calibrant.servoing.conveyor.grasp import Grasp, GraspOptions, grasp_moving
from calibrant.servoing.sight.mounting import Mounting
from calibrant.studies.servo_cell import WristColour

if TYPE_CHECKING:
    from calibrant.simulate.robot_cell.cell import RobotCell

BELT_X = 0.50
CUBE, SIDE = "red cube", 0.04
RED = ColourRange.parse("h:340-20 s:45-100 v:15-100")
PADS_M = 0.1034
"""From the flange to the middle of the fingers' pads."""
WAITS = np.array([0.48, -0.22, 0.42])
"""Metres in the base of the flange that waits for the cube, looking down."""
DOWN = so3.exp([np.pi, 0.0, 0.0])
BELT_WAY_M = 0.12
"""How far before the camera's view the cube starts, at most."""
REACH = ((0.30, 0.68), (-0.55, 0.45), (0.10, 0.70))


@dataclass(frozen=True, eq=False)
class Passed:
    """One grasp: the belt's speed and the cube's turn; held at the end, by the truth; why not; off_mm: the gripper from
    the cube's middle when the fingers had closed, by the truth."""

    seed: int
    trial: int
    speed_m_s: float
    turn_deg_s: float
    held: bool
    reason: str
    off_mm: float
    sights: int
    seconds: float


def conveyor_study(
    seeds: Sequence[int],
    *,
    trials: int = 1,
    fastest: float = 0.2,
    turns_deg_s: float = 30.0,
    step: Callable[[int, int, str], None] = lambda done, total, name: None,
) -> tuple[Passed, ...]:
    """Grasps of all seeds, at speeds drawn up to `fastest` m/s and turns up to `turns_deg_s` to either side.

    Raises: MissingExtraError without MuJoCo.
    """
    out: list[Passed] = []
    for seed in seeds:
        for passed in _cell(seed, trials, fastest, turns_deg_s):
            out.append(passed)
            step(len(out), len(seeds) * trials, f"seed {seed}")
    return tuple(out)


def _cell(seed: int, trials: int, fastest: float, turns_deg_s: float) -> list[Passed]:
    from calibrant.simulate.robot_cell import Conveyor, RobotCellSpec, cube, make_robot_cell, sheet
    from calibrant.simulate.robot_cell.parts.spec import LARGE_BOARD
    from calibrant.studies.cell_calibration import calibrate_cell_cameras

    objects = (cube(CUBE, "red"), sheet("board", LARGE_BOARD, present=False))
    rng = np.random.default_rng([seed, 13])
    with make_robot_cell(seed, spec=RobotCellSpec(objects=objects, conveyor=Conveyor(x_m=BELT_X))) as cell:
        known = calibrate_cell_cameras(cell, ("wrist",))["wrist"].hand_eye
        camera, mounting = known.cameras["wrist"], Mounting.of(known, "wrist")
        turntable = _Turntable(cell)
        cell.at_every_step(turntable.step)
        out = []
        for k in range(trials):
            speed, turn = float(rng.uniform(0, fastest)), float(np.deg2rad(rng.uniform(-1, 1) * turns_deg_s))
            out.append(_trial(cell, camera, mounting, turntable, seed, k, speed, turn, rng))
        return out


class _Turntable:
    """Keeps the cube turning about the vertical until the fingers hold it."""

    def __init__(self, cell: RobotCell) -> None:
        self.cell, self.rate = cell, 0.0

    def step(self, time_s: float) -> None:
        if self.rate and self.cell.present(CUBE):
            self.cell.spin(CUBE, self.rate)


def _trial(
    cell: RobotCell, camera: Camera, mounting: Mounting, turntable: _Turntable, seed: int, trial: int, speed: float,
    turn: float, rng: np.random.Generator,
) -> Passed:  # fmt: skip
    robot = cell.robot
    turntable.rate = 0.0
    cell.run_conveyor(0.0)
    cell.remove(CUBE)
    robot.grip(0.078)
    ready = solve_inverse(robot.chain, se3.make(DOWN, WAITS), robot.home)
    robot.move_joints(ready.q, speed=1.0)
    seen = cell.truth.T_base_camera("wrist")[:3, 3]
    before = rng.uniform(0.0, min(BELT_WAY_M, 0.5 * speed + 0.03))
    height = 0.02 if cell.spec.conveyor is None else cell.spec.conveyor.height_m
    cell.lay(CUBE, BELT_X + rng.uniform(-0.02, 0.02), seen[1] - before, yaw=float(rng.uniform(-np.pi, np.pi)), z=height)
    cell.run_conveyor(speed)
    turntable.rate = turn
    began = cell.time_s
    find = BoxOutline(camera, RED, (SIDE, SIDE, SIDE), height)

    def within(T: Array) -> bool:
        return all(low <= v <= high for v, (low, high) in zip(T[:3, 3], REACH))

    try:
        done = grasp_moving(
            robot, WristColour(cell), mounting, find, se3.make(DOWN, [0.0, 0.0, PADS_M]),
            normal=np.array([0.0, 0.0, 1.0]), symmetry=4, options=GraspOptions(stand_off_m=0.14), within=within,
        )  # fmt: skip
    except (RefusedError, DeviceError) as error:
        return _passed(seed, trial, speed, turn, False, str(error), float("nan"), 0, cell.time_s - began)
    turntable.rate = 0.0
    return _judged(cell, done, seed, trial, speed, turn, cell.time_s - began)


def _judged(cell: RobotCell, done: Grasp, seed: int, trial: int, speed: float, turn: float, seconds: float) -> Passed:
    """Held is what hangs between the fingers, above the belt, after a moment."""
    cell.wait(0.3)
    T = se3.inverse(cell.truth.T_base_gripper()) @ cell.truth.T_base_object(CUBE)
    off = 1e3 * float(np.linalg.norm(T[:3, 3] - [0.0, 0.0, PADS_M]))
    held = done.held and off < 1e3 * SIDE / 2
    reason = "" if held else done.reason or f"the cube is {off:.0f} mm from the pads"
    return _passed(seed, trial, speed, turn, held, reason, off, done.sights, seconds)


def _passed(
    seed: int, trial: int, speed: float, turn: float, held: bool, reason: str, off: float, sights: int, seconds: float
) -> Passed:
    return Passed(seed, trial, speed, float(np.rad2deg(turn)), held, reason, off, sights, seconds)


def conveyor_json(runs: Sequence[Passed]) -> str:
    """The table as data."""
    rows = [
        {
            "seed": r.seed, "trial": r.trial, "speed_m_s": round(r.speed_m_s, 4), "turn_deg_s": round(r.turn_deg_s, 2),
            "held": r.held, "off_mm": round(r.off_mm, 2) if np.isfinite(r.off_mm) else None, "sights": r.sights,
            "seconds": round(r.seconds, 2), **({"reason": r.reason} if r.reason else {}),
        }
        for r in runs
    ]  # fmt: skip
    held = sum(r.held for r in runs)
    return json.dumps({"runs": rows, "held": held, "of": len(runs), "passed": held == len(runs)}, indent=1)
