"""The dynamic method live in a simulated cell: the front camera by the wrist's, then led to another place.

Wrist and front camera are calibrated by this project from rendered pictures; a board stands tilted between them; the
arm goes to some places; then somebody, who does what the words say, moves the front camera to where it is wanted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.dynamic.problem import WristCamera
from calibrant.calibrate.dynamic.track import DynamicCalibration, DynamicNoise
from calibrant.data import CalibrationResult
from calibrant.errors import RefusedError
from calibrant.geometry import se3, so3
from calibrant.robots.inverse import solve_inverse
from calibrant.servoing.located_live import Located, located_live
from calibrant.servoing.sight.eye import Model, finder
from calibrant.targets.registry import parse_target

if TYPE_CHECKING:
    from calibrant.simulate.robot_cell.cell import RobotCell

BOARD = "charuco:5x7:60mm:48mm:DICT_4X4_50"
"""A marker's tiles are 8 mm: 2.5 px of the front camera, 1.2 m away."""
PLACES = 5
"""Of the arm, as the thesis averages over."""
MIDDLE, FACES = np.array([0.55, 0.0, 0.12]), np.array([0.45, 0.0, 0.89])
"""Metres in the base of the board's middle, and where its face looks: up, and to the front camera."""
DRAWN = 200
ASKED = se3.make(so3.exp([0.0, np.deg2rad(1.5), np.deg2rad(2.0)]), [0.02, -0.012, 0.0])
"""Where the camera is to go, along its own axes: some centimetres and degrees."""
LookedAt = Callable[[Located], None]


@dataclass(frozen=True, eq=False)
class LiveRun:
    """What was said after every picture; by the cell's truth the errors of the front camera's place, mm and deg, where
    it was found and where it was led to, and how far the person's moves left it from the wanted place."""

    said: tuple[Located, ...]
    error_mm: float
    error_deg: float
    led_mm: float
    led_deg: float
    left_mm: float
    left_deg: float


def live_run(
    seed: int,
    wrist_of: Callable[[CalibrationResult], tuple[WristCamera, DynamicNoise]],
    *,
    heard: LookedAt = lambda located: None,
) -> LiveRun:
    """One cell. wrist_of: the wrist camera and the noise that a hand-eye result states. heard: after every picture.

    Raises: MissingExtraError without MuJoCo; RefusedError where the arm reaches too few places.
    """
    from calibrant.simulate.robot_cell import RobotCellSpec, make_robot_cell, sheet
    from calibrant.simulate.robot_cell.parts.spec import LARGE_BOARD
    from calibrant.studies.cell_calibration import calibrate_cell_cameras

    target = parse_target(BOARD)
    boards = (sheet("tilted", BOARD, present=False), sheet("board", LARGE_BOARD, present=False))
    spec = RobotCellSpec(objects=boards)
    with make_robot_cell(seed, spec=spec) as cell:
        found = calibrate_cell_cameras(cell, ("wrist", "front"))
        lens = found["front"].intrinsics
        if lens is None:
            raise RefusedError("the front camera's lens was not calibrated")
        wrist, noise = wrist_of(found["wrist"].hand_eye)
        known = DynamicCalibration(wrist, lens.camera, noise)
        cell.place("tilted", _tilted(target.points.mean(axis=0)))
        wanted = cell.truth.T_base_camera("front") @ ASKED
        run = located_live(
            cell.robot, cell.cameras["wrist"], cell.cameras["front"], known, finder(target), Model.target(target),
            wanted=wanted,
        )  # fmt: skip
        said: list[Located] = []
        for q in _places(cell, np.random.default_rng([seed, 11])):
            cell.robot.move_joints(q, speed=1.0)
            for located in islice(run, 2):
                said.append(located)
                heard(located)
        first = _off(said[-1], cell)
        for _ in range(2):
            _person(cell, said[-1])
            located = next(run)
            said.append(located)
            heard(located)
        led = _off(said[-1], cell)
        left = se3.deviation(wanted, cell.truth.T_base_camera("front"))
        return LiveRun(tuple(said), *first, *led, float(left[0]), float(left[1]))


def _tilted(middle: Array) -> Array:
    """T_base_board of a board whose face looks along FACES; its z points into it."""
    z = -FACES / np.linalg.norm(FACES)
    x = np.array([0.0, 1.0, 0.0])
    R = np.column_stack([x, np.cross(z, x), z])
    return se3.make(R, MIDDLE - R @ middle)


def _places(cell: RobotCell, rng: np.random.Generator) -> list[Array]:
    """Joints of places from which the wrist camera looks at the board's middle."""
    T, hand = cell.truth.T_base_object("tilted"), cell.spec.cameras[0].T_parent_camera
    middle = se3.apply(se3.inverse(T), MIDDLE)
    robot, kept = cell.robot, []
    for _ in range(DRAWN):
        R = so3.exp(np.deg2rad(rng.uniform(-22, 22, 3) * [1, 1, 3]))
        B = se3.make(R, np.array([0, 0, rng.uniform(0.32, 0.45)]) - R @ middle)
        wanted = T @ se3.inverse(B) @ se3.inverse(hand)
        found = solve_inverse(robot.chain, wanted, robot.home, iterations=60)
        margin = float(np.minimum(found.q - robot.chain.lower, robot.chain.upper - found.q).min())
        if bool(found.reached) and margin > np.deg2rad(3) and robot.workspace.below_table(wanted) is None:
            kept.append(found.q)
        if len(kept) == PLACES:
            return kept
    raise RefusedError(f"the arm reaches {len(kept)} of {PLACES} places from which it sees the board")


def _person(cell: RobotCell, located: Located) -> None:
    """Moves the front camera as the words say."""
    if located.to_go is None:
        return
    camera = cell.camera("front")
    step = se3.make(so3.exp(np.deg2rad(located.to_go.deg)), 1e-3 * located.to_go.mm)
    camera.T_parent_camera = camera.T_parent_camera @ step


def _off(located: Located, cell: RobotCell) -> tuple[float, float]:
    if located.T_base_external is None:
        raise RefusedError(f"the front camera was not located: {located.words}")
    mm, deg = se3.deviation(cell.truth.T_base_camera("front"), located.T_base_external.matrix)
    return float(mm), float(deg)
