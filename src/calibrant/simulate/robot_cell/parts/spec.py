"""What a cell is made of, before a seed is drawn: arm, cameras, things on the table, noise."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError
from calibrant.geometry import se3, so3
from calibrant.simulate.robot_cell.parts.noise import (
    NO_CAMERA_NOISE,
    NO_LATENCY,
    NO_ROBOT_NOISE,
    NO_SPREAD,
    CameraNoise,
    CellSpread,
    DepthNoise,
    Latency,
    RobotNoise,
)

LARGE_BOARD = "charuco:9x14:40mm:31mm:DICT_5X5_1000"
SMALL_BOARD = "charuco:7x10:12mm:8mm:DICT_4X4_50"
MEDIUM_BOARD = "charuco:18x29:10mm:8mm:DICT_5X5_1000"
PADDLE_BOARD = "charuco:5x7:50mm:35mm:DICT_4X4_50"
"""The stick's board for fixed cameras of 640x480 pixels a metre away: a marker's tiles are 2.2 px there, and the white
between it and a corner 3 px, enough to measure the corner by its edges. Those of the
thesis' small board would be half a pixel; it needs 57 cm of stick and a camera of 1280 px to come near enough."""
HELD_BOARD = "held board"
"""A second copy of the stick's board, away at first, for a person to hold before a camera."""
MARKER = "marker:100mm:DICT_5X5_50:7"
"""10 cm across, of 7 x 7 tiles of 1.43 cm (thesis, section 5.4)."""

COLOURS: dict[str, tuple[float, float, float]] = {
    "red": (0.80, 0.08, 0.08),
    "green": (0.10, 0.60, 0.15),
    "blue": (0.08, 0.20, 0.75),
    "yellow": (0.90, 0.75, 0.05),
    "orange": (0.95, 0.42, 0.03),
    "purple": (0.45, 0.10, 0.60),
    "cyan": (0.05, 0.65, 0.75),
    "grey": (0.55, 0.55, 0.55),
}


@dataclass(frozen=True, eq=False)
class CellObject:
    """A thing in the cell: a box that falls, is gripped and pushed, or a flat sheet with a target's artwork, held.

    size: (3,) metres of a box, along its own axes, which start in its middle; target: a spec whose artwork the sheet
    bears, its frame the target's (z into the sheet). T_base_object: where it is at first; None: a place on the table
    drawn by the seed. present: whether it is in the cell at first (`RobotCell.place` brings it).
    """

    name: str
    colour: str = "red"
    size: tuple[float, float, float] | None = None
    target: str | None = None
    T_base_object: Array | None = None
    present: bool = True

    def __post_init__(self) -> None:
        if (self.size is None) == (self.target is None):
            raise InputError(f"object {self.name}: give the size of a box, or the target of a sheet, one of them")
        if self.colour not in COLOURS:
            raise InputError(f"object {self.name}: unknown colour {self.colour!r}; known: {', '.join(COLOURS)}")


def cube(name: str, colour: str, *, T_base_object: Array | None = None) -> CellObject:
    """A coloured cube of 4 cm (thesis, section 5.5)."""
    return CellObject(name, colour, size=(0.04, 0.04, 0.04), T_base_object=T_base_object)


def cuboid(name: str = "cuboid", *, T_base_object: Array | None = None) -> CellObject:
    """The paper's workpiece, 54 x 37 x 5 mm."""
    return CellObject(name, "orange", size=(0.054, 0.037, 0.005), T_base_object=T_base_object)


def sheet(name: str, target: str, *, T_base_object: Array | None = None, present: bool = True) -> CellObject:
    """A flat board or marker."""
    return CellObject(name, "grey", target=target, T_base_object=T_base_object, present=present)


@dataclass(frozen=True, eq=False)
class CellCamera:
    """An RGB-D camera: where it is, what its maker says of it, and its noise.

    parent: "gripper" (the flange) or "base"; T_parent_camera: of the colour camera; colour, depth: as stated by the
    device; T_colour_depth (4, 4); the truth differs from all of these by the seed (`CellSpread`). samples: points a
    pixel of the rendered things, 1, 2 or 4 (boards always have 64).
    """

    name: str
    parent: Literal["gripper", "base"]
    T_parent_camera: Array
    colour: Camera
    depth: Camera
    T_colour_depth: Array
    noise: CameraNoise = field(default_factory=CameraNoise)
    depth_noise: DepthNoise = field(default_factory=lambda: DepthNoise(0.05))
    latency: Latency = field(default_factory=Latency)
    samples: int = 1


def looking_at(eye: tuple[float, float, float], at: tuple[float, float, float], *, up: Array | None = None) -> Array:
    """T_base_camera of a camera at a point that looks at another: z forward, y down."""
    forward = np.subtract(at, eye)
    forward = forward / np.linalg.norm(forward)
    upward = np.array([0.0, 0.0, 1.0]) if up is None else np.asarray(up, dtype=np.float64)
    right = np.cross(forward, upward)
    right = right / np.linalg.norm(right)
    return se3.make(np.column_stack([right, np.cross(forward, right), forward]), np.array(eye))


def _pinhole(fx: float, fy: float, cx: float, cy: float, size: tuple[int, int]) -> Camera:
    return Camera.create("brown", {"fx": fx, "fy": fy, "cx": cx, "cy": cy}, image_size=size)


_SIZE = (640, 480)

WRIST = CellCamera(
    "wrist",
    "gripper",
    # Thesis, table 5.3 and section 4.2: (31.8, -36.2, 63.2) mm, q = (0, 0, 0.7071, 0.7071): a quarter turn about z.
    se3.make(so3.exp([0, 0, np.pi / 2]), [0.0318, -0.0362, 0.0632]),
    _pinhole(616.68, 617.031, 314.182, 249.473, _SIZE),  # thesis, table 4.1
    _pinhole(385.0, 385.0, 319.5, 239.5, _SIZE),  # data sheet: 87 x 58 degrees on 16:9, cropped to 4:3
    se3.make(np.eye(3), [0.0148, 0.0, 0.0]),
    depth_noise=DepthNoise(0.050),  # D435: baseline of 50 mm (data sheet of the D400 series)
)
FRONT = CellCamera(
    "front",
    "base",
    looking_at((1.557, 0.008, 0.793), (0.45, 0.0, 0.05)),  # thesis, table 5.6
    _pinhole(384.0, 384.0, 319.5, 239.5, _SIZE),  # data sheet: 90 degrees on 1280 px, cropped to 4:3 and scaled by 0.6
    _pinhole(386.0, 386.0, 319.5, 239.5, _SIZE),
    se3.make(np.eye(3), [-0.059, 0.0, 0.0]),
    depth_noise=DepthNoise(0.095),  # D455: baseline of 95 mm
)
TOP = replace(
    FRONT,
    name="top",
    # The thesis gives no place: above the middle of the table, as high as it sees all of what the arm reaches.
    T_parent_camera=looking_at((0.50, 0.0, 1.35), (0.50, 0.0, 0.0), up=np.array([1.0, 0.0, 0.0])),
)


@dataclass(frozen=True)
class Conveyor:
    """A belt along y in front of the arm: its middle's x, width and speed (towards +y), metres and m/s."""

    x_m: float = 0.62
    width_m: float = 0.16
    height_m: float = 0.02
    speed_m_s: float = 0.0


def _default_objects() -> tuple[CellObject, ...]:
    return (
        cube("red cube", "red"),
        cube("blue cube", "blue"),
        sheet("marker", MARKER),
        sheet("board", LARGE_BOARD, present=False),
    )


@dataclass(frozen=True, eq=False)
class RobotCellSpec:
    """A cell before its seed. The base's frame is the world's; the table's top is z = 0.

    arm: panda, ur5e, ur3e, ur10e, or a file of MJCF or URDF; objects; cameras; tool: what is in the gripper at first,
    None, "pen" or "stick" (`stick_board` on a stick of `stick_m` beyond the fingers; the thesis has SMALL_BOARD on
    0.57 m); conveyor: None for none; noise of the robot;
    spread of cells over seeds; shadows: of things on each other, slower.
    """

    arm: str = "panda"
    objects: tuple[CellObject, ...] = field(default_factory=_default_objects)
    cameras: tuple[CellCamera, ...] = (WRIST, FRONT, TOP)
    tool: Literal["pen", "stick"] | None = None
    stick_board: str = PADDLE_BOARD
    stick_m: float = 0.10
    conveyor: Conveyor | None = None
    robot_noise: RobotNoise = field(default_factory=RobotNoise)
    spread: CellSpread = field(default_factory=CellSpread)
    shadows: bool = False

    def __post_init__(self) -> None:
        names = [o.name for o in self.objects] + [c.name for c in self.cameras]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise InputError(f"two things of the cell are called {', '.join(twice)}; names are unique")

    def without_noise(self) -> RobotCellSpec:
        """The same cell with perfect devices at their nominal places; depth cameras lose nothing and add nothing."""
        return replace(
            self,
            robot_noise=NO_ROBOT_NOISE,
            spread=replace(NO_SPREAD, objects_m=self.spread.objects_m),
            cameras=tuple(_perfect(c) for c in self.cameras),
        )


def _perfect(camera: CellCamera) -> CellCamera:
    depth = DepthNoise(camera.depth_noise.baseline_m, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return replace(camera, noise=NO_CAMERA_NOISE, depth_noise=depth, latency=NO_LATENCY)
