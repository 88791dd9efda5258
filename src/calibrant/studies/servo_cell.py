"""Servoing in simulated cells: teach a pose, start elsewhere, and see by the truth how near the arm comes.

Each seed is a cell whose wrist camera is calibrated by this project from rendered pictures first. What is wrong on
purpose (focal length, mounting) is wrong for teaching and running alike, as it would be for a user.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.data.records.servoing import ServoTrace
from calibrant.errors import DeviceError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.robots.inverse import solve_inverse
from calibrant.servoing.laws.law import Law
from calibrant.servoing.laws.registry import law_of
from calibrant.servoing.loop import ServoOptions, servo
from calibrant.servoing.result import trace_of
from calibrant.servoing.sight.eye import Depth, Eye, Model, finder
from calibrant.servoing.sight.mounting import Mounting
from calibrant.servoing.stability import loop_eigenvalues, turned
from calibrant.servoing.teach import PICTURES, taught_by
from calibrant.targets.registry import parse_target

if TYPE_CHECKING:
    from calibrant.simulate.robot_cell.cell import RobotCell

BOARD = "charuco:7x5:30mm:22mm:DICT_4X4_50"
"""What the arm is led by: 21 x 15 cm, whole in the wrist camera's picture from 30 cm."""
NAME = "servo board"
DISTANCE = 0.34
"""Metres of the taught pose from the board."""
CLEAR_PX = 12.0
ROOM_RAD = np.deg2rad(5.0)
DRAWN = 400
CENTRE = (0.5, 0.0)


@dataclass(frozen=True)
class ServoCase:
    """What is tried: the control law by name, how far and turned the starts are, what is wrong with the calibration."""

    control: str = "image"
    metres: float = 0.20
    degrees: float = 30.0
    starts: int = 1
    focal_error: float = 0.0
    hand_eye_deg: float = 0.0
    depth: Depth = "estimated"
    options: ServoOptions = field(default_factory=ServoOptions)


@dataclass(frozen=True, eq=False)
class Arrival:
    """One run: the gripper's true error at the end (NaN where it did not arrive), what was predicted (99 %), and why it
    failed."""

    seed: int
    start: int
    error_mm: float
    error_deg: float
    predicted_mm: float
    predicted_deg: float
    pictures: int
    seconds: float
    passed: bool
    reason: str
    trace: ServoTrace | None = None


@dataclass(frozen=True, eq=False)
class ServoStudy:
    """All runs, the predicted margin of the first cell's loop, and what was asked."""

    case: ServoCase
    runs: tuple[Arrival, ...]
    margin: float

    @property
    def share(self) -> float:
        """Of the runs that ended within the tolerance, by the truth."""
        return sum(r.passed for r in self.runs) / len(self.runs)


Step = Callable[[int, int, str], None]


def servo_study(seeds: Sequence[int], case: ServoCase, *, step: Step = lambda done, total, name: None) -> ServoStudy:
    """The runs of all seeds. Raises: MissingExtraError without MuJoCo; InputError for an unknown control."""
    runs: list[Arrival] = []
    margins = []
    total = len(seeds) * case.starts
    for seed in seeds:
        for arrival, margin in _cell_runs(seed, case):
            runs.append(arrival)
            margins.append(margin)
            step(len(runs), total, f"seed {seed}")
    return ServoStudy(case, tuple(runs), float(np.min(margins)))


def _cell_runs(seed: int, case: ServoCase) -> list[tuple[Arrival, float]]:
    from calibrant.simulate.robot_cell import RobotCellSpec, make_robot_cell, sheet
    from calibrant.simulate.robot_cell.parts.spec import LARGE_BOARD
    from calibrant.studies.cell_calibration import calibrate_cell_cameras

    law = law_of(case.control)
    objects = (sheet(NAME, BOARD, present=False), sheet("board", LARGE_BOARD, present=False))
    with make_robot_cell(seed, spec=RobotCellSpec(objects=objects)) as cell:
        known = calibrate_cell_cameras(cell, ("wrist",))["wrist"].hand_eye
        rng = np.random.default_rng([seed, 7])
        eye = _eye(cell, known, case, rng)
        out = []
        cell.lay(NAME, *CENTRE, yaw=float(rng.uniform(-np.pi, np.pi)))
        _go(cell, _taught_pose(cell, rng), cell.robot.home)
        ready = cell.robot.joints()
        wanted = taught_by(eye, PICTURES)
        taught = cell.truth.T_base_gripper()
        margin = _margin(wanted, eye, case, law, cell.robot.pose())
        for k in range(case.starts):
            cell.robot.move_joints(ready, speed=1.0)
            _go(cell, _start(cell, taught, ready, case, law, rng), ready)
            out.append((_run(cell, eye, wanted, law, taught, case, seed, k), margin))
        return out


def _eye(cell: RobotCell, known: CalibrationResult, case: ServoCase, rng: np.random.Generator) -> Eye:
    camera, mounting = known.cameras["wrist"], Mounting.of(known, "wrist")
    sign = float(rng.choice([-1.0, 1.0]))
    if case.focal_error:
        values = camera.parameters | {n: camera.parameters[n] * (1 + sign * case.focal_error) for n in ("fx", "fy")}
        camera = Camera.create(camera.model.name, values, image_size=camera.image_size)
    if case.hand_eye_deg:
        mounting = turned(mounting, case.hand_eye_deg, rng.standard_normal(3))
    target = parse_target(BOARD)
    return Eye(
        camera, mounting, WristColour(cell), finder(target), Model.target(target), case.depth, known.sigma_px or 0.1
    )


class WristColour:
    """The wrist camera without its depth, in half the time."""

    def __init__(self, cell: RobotCell) -> None:
        self._camera = cell.cameras["wrist"]
        self.name = self._camera.name
        self.stated = self._camera.stated
        self.take = self._camera.take_colour

    def close(self) -> None:
        """The cell closes it."""


def _taught_pose(cell: RobotCell, rng: np.random.Generator) -> Array:
    """T_base_gripper from which the wrist camera looks at the board, somewhat tilted."""
    for _ in range(DRAWN):
        tilt = so3.exp(np.deg2rad(rng.uniform(-10, 10, 3) * [1, 1, 9]))
        T = _looking(cell, tilt, DISTANCE)
        if _possible(cell, T, cell.robot.home):
            return T
    raise RefusedError("the arm reaches no pose from which it sees the board; move the board nearer")


def _off(law: Law, taught: Array, there: Array) -> tuple[float, float]:
    """Millimetres and degrees from the taught pose: of the planar case across the approach axis and about it, since the
    other three are the arm's own, which that control leaves as they are."""
    off = se3.local(np.eye(4), se3.inverse(taught) @ there)
    if law.name == "planar":
        off = off * [0, 0, 1, 1, 1, 0]
    mm, deg = se3.mm_and_deg(off)
    return float(mm), float(deg)


def _looking(cell: RobotCell, tilt: Array, distance: float) -> Array:
    middle = parse_target(BOARD).points.mean(axis=0)
    T_camera_board = se3.make(tilt, np.array([0, 0, distance]) - tilt @ middle)
    return (
        cell.truth.T_base_object(NAME) @ se3.inverse(T_camera_board) @ se3.inverse(cell.truth.T_gripper_camera("wrist"))
    )


def _start(cell: RobotCell, taught: Array, ready: Array, case: ServoCase, law: Law, rng: np.random.Generator) -> Array:
    """T_base_gripper exactly that far and turned from the taught one, from which all of the board is seen."""
    for _ in range(50 * DRAWN):
        turn, shift = rng.standard_normal(3), rng.standard_normal(3)
        if law.name == "planar":
            turn, shift = np.array([0, 0, turn[2]]), shift * [1, 1, 0]
        turn *= np.deg2rad(case.degrees) / np.linalg.norm(turn)
        shift *= case.metres / np.linalg.norm(shift)
        T = taught @ se3.make(so3.exp(turn), shift)
        if _possible(cell, T, ready):
            return T
        if law.name == "planar":  # in its plane the arm has no other way to keep all of the board in view
            case = replace(case, metres=0.99 * case.metres, degrees=0.99 * case.degrees)
    raise RefusedError(
        f"no start {1e3 * case.metres:g} mm and {case.degrees:g} deg away from which the arm sees the board"
    )


def _possible(cell: RobotCell, T_base_gripper: Array, near: Array) -> bool:
    """Whether the arm gets there from joints near by, with room in every range, and all of the board is seen."""
    robot = cell.robot
    if robot.workspace.below_table(T_base_gripper) is not None:
        return False
    T = se3.inverse(T_base_gripper @ cell.truth.T_gripper_camera("wrist")) @ cell.truth.T_base_object(NAME)
    camera, points = cell.truth.camera("wrist"), _outline()
    uv = camera.project(se3.apply(T, points))
    size = np.array(camera.image_size)
    if not np.isfinite(uv).all() or np.any(uv < CLEAR_PX) or np.any(uv > size - 1 - CLEAR_PX):
        return False
    found = solve_inverse(robot.chain, T_base_gripper, near, iterations=60)
    margin = np.minimum(found.q - robot.chain.lower, robot.chain.upper - found.q).min()
    return bool(found.reached) and float(margin) > ROOM_RAD


def _outline() -> Array:
    x0, y0, x1, y1 = parse_target(BOARD).artwork().bounds
    return np.array([[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]])


def _go(cell: RobotCell, T_base_gripper: Array, near: Array) -> None:
    robot = cell.robot
    found = solve_inverse(robot.chain, T_base_gripper, near, iterations=60)
    robot.move_joints(found.q, speed=1.0)


def _margin(wanted, eye: Eye, case: ServoCase, law: Law, T_base_gripper: Array) -> float:  # type: ignore[no-untyped-def]
    """Of the loop with the errors made on purpose: the worst of both signs and of turns about the camera's axes."""
    T = eye.mounting.T_base_camera(T_base_gripper)
    S = law.subspace(T[:3, :3].T @ T_base_gripper[:3, :3])
    steps = [np.r_[np.deg2rad(s * case.hand_eye_deg) * a, 0, 0, 0] for a in np.eye(3) for s in (-1, 1)]
    return min(
        float(
            loop_eigenvalues(
                wanted, eye.mounting, T_base_gripper, focal=1 + s * case.focal_error, hand_eye=step, subspace=S
            ).real.min()
        )
        for s in (-1, 1)
        for step in steps
    )


def _run(  # type: ignore[no-untyped-def]
    cell: RobotCell, eye: Eye, wanted, law: Law, taught: Array, case: ServoCase, seed: int, start: int
) -> Arrival:
    began = cell.time_s
    try:
        run = servo(cell.robot, eye, wanted, law, options=case.options)
    except (RefusedError, DeviceError) as error:
        nan = float("nan")
        return Arrival(seed, start, nan, nan, nan, nan, 0, cell.time_s - began, False, str(error))
    cell.robot.wait(0.3)
    mm, deg = _off(law, taught, cell.truth.T_base_gripper())
    passed = mm <= case.options.tolerance_mm and deg <= case.options.tolerance_deg
    return Arrival(
        seed, start, mm, deg, run.last.within_99_mm, run.last.within_99_deg, run.pictures, run.seconds, passed,
        "" if passed else "arrived elsewhere", trace_of(run, law.name),
    )  # fmt: skip


def study_json(study: ServoStudy) -> str:
    """The table as data."""
    good = [r for r in study.runs if np.isfinite(r.error_mm)]
    runs = [
        {
            "seed": r.seed, "start": r.start, "error_mm": _number(r.error_mm), "error_deg": _number(r.error_deg),
            "predicted_99_mm": _number(r.predicted_mm), "predicted_99_deg": _number(r.predicted_deg),
            "pictures": r.pictures, "seconds": round(r.seconds, 2), "passed": r.passed,
            **({"reason": r.reason} if r.reason else {}),
        }
        for r in study.runs
    ]  # fmt: skip
    return json.dumps(
        {
            "control": study.case.control, "runs": runs,
            "median_mm": _number(float(np.median([r.error_mm for r in good])) if good else float("nan")),
            "median_deg": _number(float(np.median([r.error_deg for r in good])) if good else float("nan")),
            "inside_99": sum(r.error_mm <= r.predicted_mm for r in good), "margin": round(study.margin, 4),
            "passed": all(r.passed for r in study.runs), "passed_share": round(study.share, 4),
        },
        indent=1,
    )  # fmt: skip


def _number(value: float) -> float | None:
    return round(value, 5) if np.isfinite(value) else None
