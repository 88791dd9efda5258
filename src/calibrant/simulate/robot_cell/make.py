"""Making a cell from a seed."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.robots.arms import ARMS
from calibrant.simulate.robot_cell.arm.arms import CellArm, named_arm
from calibrant.simulate.robot_cell.arm.gripper import T_gripper_stick_board
from calibrant.simulate.robot_cell.arm.robot import SimulatedRobot
from calibrant.simulate.robot_cell.arm.user_arms import PACKAGED, file_arm, packaged_file
from calibrant.simulate.robot_cell.cell import RobotCell
from calibrant.simulate.robot_cell.draw import drawn_camera, drawn_light, drawn_places, stream
from calibrant.simulate.robot_cell.film import Recorder, film_camera
from calibrant.simulate.robot_cell.model import build_world
from calibrant.simulate.robot_cell.parts.spec import HELD_BOARD, RobotCellSpec, sheet
from calibrant.simulate.robot_cell.pictures.camera import SimulatedCamera
from calibrant.simulate.robot_cell.pictures.drawing import choose_renderer
from calibrant.simulate.robot_cell.pictures.lens import lens_map
from calibrant.simulate.robot_cell.pictures.sheets import Eye, Sheet, draw_sheet
from calibrant.simulate.robot_cell.truth import CellTruth
from calibrant.simulate.robot_cell.world.light import Light
from calibrant.simulate.robot_cell.world.physics import World
from calibrant.targets.registry import parse_target

_SETTLE_S = 0.1
"""Things that were laid sink by some hundredths of a millimetre into their contact."""


def make_robot_cell(seed: int, *, spec: RobotCellSpec | None = None, record: Path | None = None) -> RobotCell:
    """Draw a cell and set it up, the arm at rest above the table.

    Two cells of one seed have the same mountings, lenses, places, light and noise as far as their specs are alike, so
    that two ways of doing a thing are compared on the same cells.

    Args: record: a folder for every picture taken and a film. Raises: MissingExtraError without MuJoCo; InputError for
    a spec that cannot be.

        >>> from calibrant.simulate.robot_cell import make_robot_cell
        >>> with make_robot_cell(3) as cell:                # doctest: +SKIP
        ...     cell.robot.move_to(cell.robot.pose())
        ...     picture = cell.cameras["front"].take()
        ...     T = cell.truth.T_base_object("red cube")
    """
    chosen = _with_held_board(spec or RobotCellSpec())
    if seed < 0:
        raise InputError(f"a seed is 0 or more, got {seed}")
    arm = _arm(chosen.arm)
    arm, chain = arm.built(chosen.robot_noise, stream(seed, "arm"))
    light = drawn_light(chosen.spread, stream(seed, "light"))
    world = World(build_world(chosen, arm, chain, light))
    renderer, drawn_by = choose_renderer(world, light, shadows=chosen.shadows)
    robot = SimulatedRobot(world, arm, chosen.robot_noise, stream(seed, "robot"))
    sheets = _Sheets(chosen, world, robot)
    cameras = {}
    for camera in chosen.cameras:
        true, T = drawn_camera(camera, chosen.spread, stream(seed, f"camera {camera.name}"))
        cameras[camera.name] = SimulatedCamera(
            camera, true, T,
            world=world, renderer=renderer, sheets=sheets.seen, light=light,
            rng=stream(seed, f"pictures {camera.name}"),
        )  # fmt: skip
    board = T_gripper_stick_board(parse_target(chosen.stick_board), chosen.stick_m)
    truth = CellTruth(world, cameras, robot, chain, board)
    _lay_out(chosen, world, seed)
    cell = RobotCell(
        seed, chosen,
        world=world, robot=robot, cameras=cameras, truth=truth,
        renderer=renderer, drawn_by=drawn_by, random=stream(seed, "run"),
    )  # fmt: skip
    cell.carry(chosen.tool)
    if chosen.conveyor is not None:
        cell.run_conveyor(chosen.conveyor.speed_m_s)
    world.wait(_SETTLE_S)
    if record is not None:
        finished = partial(_finished, sheets=sheets, world=world, light=light)
        cell.record(Recorder(Path(record), renderer, finished))
    return cell


class _Sheets:
    """The printed things that can be seen now."""

    def __init__(self, spec: RobotCellSpec, world: World, robot: SimulatedRobot) -> None:
        self._world, self._robot = world, robot
        self._on_table = [Sheet(o.name, parse_target(o.target).artwork()) for o in spec.objects if o.target is not None]
        self._on_stick = Sheet("stick board", parse_target(spec.stick_board).artwork())

    def seen(self) -> list[Sheet]:
        there = [s for s in self._on_table if self._world.is_present(s.body)]
        return [*there, self._on_stick] if self._robot.carried == "stick" else there


def _arm(name: str) -> CellArm:
    """An arm by name, or of a file."""
    if name in ARMS:
        return named_arm(name)
    return file_arm(packaged_file(name) if name in PACKAGED else name)


def _with_held_board(spec: RobotCellSpec) -> RobotCellSpec:
    """The spec with a copy of the stick's board that stands in the cell only when it is placed."""
    if any(o.name == HELD_BOARD for o in spec.objects):
        return spec
    return replace(spec, objects=(*spec.objects, sheet(HELD_BOARD, spec.stick_board, present=False)))


def _lay_out(spec: RobotCellSpec, world: World, seed: int) -> None:
    places = drawn_places(spec, stream(seed, "places"))
    for item in spec.objects:
        if item.name in places:
            world.put(item.name, places[item.name])
        else:
            world.take_away(item.name)


def _finished(
    colour: NDArray, depth: NDArray, T_base_camera: Array, *, sheets: _Sheets, world: World, light: Light
) -> NDArray:
    """A picture of the film's camera with its sheets."""
    K, size = film_camera()
    values = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
    camera = Camera.create("pinhole", values, image_size=size)
    eye = Eye(camera, lens_map(camera), T_base_camera, light)
    for printed in sheets.seen():
        draw_sheet(colour, depth, printed, world.pose(printed.body), eye)
    return colour
