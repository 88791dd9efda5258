"""Cubes picked and placed in simulated cells, by this project's way and beside it by the thesis's two."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.data import CalibrationResult
from calibrant.data.details import TaskRun
from calibrant.errors import CalibrantError, InputError
from calibrant.tasks.listener import Listener
from calibrant.tasks.options.cell import CellOptions
from calibrant.tasks.verify.in_cell.pinpoint import FAST, over

if TYPE_CHECKING:
    from calibrant.simulate.robot_cell.cell import RobotCell
    from calibrant.verification.pick_place.run import Seen, Task

PICK, PLACE = "red cube", "blue cube"
COLOURS = {PICK: "h:340-20 s:50-100 v:15-100", PLACE: "h:200-250 s:50-100 v:10-100"}
CUBE_M = 0.04
APART_M = (0.11, 0.22)
"""Between the cubes: fingers need room, and a wrist camera sees both."""
MIDDLE = ((0.46, -0.06), (0.56, 0.06))
LOOK_M = 0.45
PADS_M = 0.011
"""From the fingers' ends back to the middle of their pads."""
LINE = 0.5
DISPARITY_PX, DEVICE_PX = 0.08, 0.03
"""Of a disparity: its noise, by which the cameras' figures are stated, and what a device's own calibration errs by."""
TABLE_M = {"wrist": 0.45, "front": 1.35, "top": 1.35}
"""From each camera to the table."""
THESIS_OFF_M = {"wrist": (0.002, 0.0, 0.0), "front": (-0.014, 0.0, 0.0), "top": (0.021, -0.007, 0.0)}
"""What the thesis's cameras were off by at its marker (its pinpoint table); its two ways run with that."""


@dataclass(frozen=True)
class Counts:
    """Of one way: how many of how many cubes were set on the other, and why not."""

    done: int
    of: int
    reasons: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """ "9 of 10 (no depth on the cube: 1)"."""
        kinds = Counter(r.partition(":")[0] for r in self.reasons)
        told = ", ".join(f"{name}: {count}" for name, count in kinds.most_common(4))
        return f"{self.done} of {self.of}" + (f" ({told})" if told else "")


def pick_place_series(
    options: CellOptions, *, cubes: int, ways: tuple[str, ...], yes: bool, listener: Listener
) -> CalibrationResult:
    """The result of kind "pick-place" over all seeds; a run a cube."""
    from calibrant.verification.pick_place.result import pick_place_result
    from calibrant.verification.pick_place.run import WAYS

    runs: list[TaskRun] = []
    beside: dict[str, list[str]] = {way: [] for way in WAYS[1:] if way in ways}
    with listener.progress("Picking and placing") as step:
        for i, seed in enumerate(options.runs):
            own, others = _in_one_cell(options, seed, cubes, tuple(beside), yes=yes)
            runs += own
            for way, reasons in others.items():
                beside[way] += reasons
            step(i + 1, len(options.runs), f"seed {seed}")
    counts = {
        way: Counts(reasons.count(""), len(reasons), tuple(filter(None, reasons))) for way, reasons in beside.items()
    }
    return pick_place_result(
        runs, view=options.view, beside={f"{way}, camera off as the thesis's was": c.words for way, c in counts.items()}
    )


def _in_one_cell(
    options: CellOptions, seed: int, cubes: int, ways: tuple[str, ...], *, yes: bool
) -> tuple[list[TaskRun], dict[str, list[str]]]:
    from calibrant.studies.cell_calibration import calibrate_cell_cameras

    with options.opened(seed) as cell:
        try:
            known = calibrate_cell_cameras(cell, (options.view,))[options.view].hand_eye
        except InputError:
            raise
        except CalibrantError as error:
            failed = TaskRun(f"seed {seed}", False, seed=seed, reason=f"not calibrated: {error}")
            return [failed], {way: ["not calibrated"] for way in ways}
        task = _task(cell, options.view, known, yes=yes)
        for name in list(cell.objects):
            if name not in COLOURS and cell.present(name):
                cell.remove(name)
        rng = np.random.default_rng([seed, *b"pick-place"])
        own, others = [], {way: [] for way in ways}  # type: tuple[list[TaskRun], dict[str, list[str]]]
        for k in range(cubes):
            places = _places(cell, rng)
            seen = _seen(cell, task, places, np.array(THESIS_OFF_M[options.view]))
            own.append(_own_run(cell, task, places, seen, f"seed {seed}, cube {k + 1}", seed))
            for way in ways:
                others[way].append(_tried(cell, task, places, seen[way])[0])
        return own, others


def _task(cell: RobotCell, view: str, known: CalibrationResult, *, yes: bool) -> Task:
    from calibrant.perceive.colour.ranges import ColourRange
    from calibrant.perceive.registered_depth.noise import D435, D455
    from calibrant.perceive.registered_depth.register import DepthRig
    from calibrant.verification.pick_place.run import Task
    from calibrant.verification.touch.table import Table
    from calibrant.verification.unchanged.robot_noise import robot_side

    source, camera = cell.cameras[view], known.cameras[view]
    stated = source.stated
    if stated.depth is None or stated.T_colour_depth is None:
        raise InputError(f"camera {view} states no depth camera")
    grasp = cell.truth.T_gripper_tip.copy()
    grasp[2, 3] -= PADS_M
    robot = cell.robot
    noise = D435 if view == "wrist" else D455
    away = 1.0 / (noise.inverse_sigma / DISPARITY_PX * TABLE_M[view])  # f b / z, the disparity
    return Task(
        robot,
        source,
        camera,
        DepthRig(camera, stated.depth, stated.T_colour_depth),
        replace(noise, scale_sigma=DEVICE_PX / away),
        robot_side(known, view),
        CUBE_M,
        ColourRange.parse(COLOURS[PICK]),
        ColourRange.parse(COLOURS[PLACE]),
        grasp,
        lambda words: yes or not robot.moves_matter,
        Table(sigma_z=2e-3),
        (FAST, LINE),
    )


def _places(cell: RobotCell, rng: np.random.Generator) -> dict[str, Array]:
    """T_base_object of both cubes."""
    middle, along = rng.uniform(*MIDDLE), rng.uniform(0, 2 * np.pi)
    half = 0.5 * rng.uniform(*APART_M) * np.array([np.cos(along), np.sin(along)])
    yaws = rng.uniform(-np.pi / 4, np.pi / 4, 2)
    spots = {PICK: (*(middle + half), yaws[0]), PLACE: (*(middle - half), yaws[1])}
    return {name: cell.lay(name, float(x), float(y), yaw=float(yaw)) for name, (x, y, yaw) in spots.items()}


def _seen(cell: RobotCell, task: Task, places: dict[str, Array], off: Array) -> dict[str, Seen]:
    """Both cubes by every way, from one picture."""
    from calibrant.verification.pick_place.run import look

    cell.robot.move_joints(cell.robot.home, speed=FAST)
    if task.side.in_hand:
        middle = np.mean([T[:2, 3] for T in places.values()], axis=0)
        cell.robot.move_to(over(task.side.X, np.array([*middle, LOOK_M]), cell.robot.pose()), speed=FAST)
    return look(task, off=off)


def _tried(cell: RobotCell, task: Task, places: dict[str, Array], seen: Seen) -> tuple[str, Array]:
    """Why it failed, empty for none; and how far off the cube lies then."""
    from calibrant.verification.pick_place.run import judged, pick_and_place

    for name, T in places.items():
        cell.place(name, T)
    reason = pick_and_place(task, seen)
    cell.wait(0.3)
    lower = cell.truth.T_base_object(PLACE)
    off = cell.truth.T_base_object(PICK)[:3, 3] - lower[:3, 3] - [0.0, 0.0, CUBE_M]
    return judged(reason, off, CUBE_M), off


def _own_run(
    cell: RobotCell, task: Task, places: dict[str, Array], every: dict[str, Seen], name: str, seed: int
) -> TaskRun:
    """A run by this project's way: the error is that of where the cube was said to be."""
    from calibrant.verification.pick_place.run import WAYS
    from calibrant.verification.touch.errors import CHI2_3_95

    seen = every[WAYS[0]]
    reason, off = _tried(cell, task, places, seen)
    run = TaskRun(name, not reason, seed=seed, reason=reason)
    cube = seen.pick
    if cube is None or cube.covariance is None or cube.predicted_95 is None:
        return run
    error = cube.centre - places[PICK][:3, 3]
    x, y, z = (float(1e3 * v) for v in error)
    sx, sy, sz = (float(1e3 * v) for v in np.sqrt(np.diag(cube.covariance)))
    return replace(
        run,
        error_mm=float(1e3 * np.linalg.norm(error)),
        predicted_95_mm=1e3 * cube.predicted_95,
        inside=bool(error @ np.linalg.solve(cube.covariance, error) <= CHI2_3_95),
        offset_mm=(x, y, z),
        sigma_mm=(sx, sy, sz),
        after_mm=None if reason else float(1e3 * np.hypot(off[0], off[1])),
    )
