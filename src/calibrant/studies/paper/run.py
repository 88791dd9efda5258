"""The paper's two series in a simulated cell whose wrist camera was calibrated from its own pictures.

The cuboid's places and the camera's follow from the paper's table 1: P is where the cuboid, at A, is seen where the
paper saw it; B and C are where it is then seen at the other rows' places; Q and R are from where it is seen at theirs.
The arm is sent there by what the calibration says; truth is only compared with.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.calibrate.reprojection.links import Link, link_maps, product
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.perceive.colour.ranges import ColourRange
from calibrant.perceive.colour.segments import find_segments, the_one
from calibrant.perceive.object_pose.locate import locate
from calibrant.perceive.object_pose.poses import ObjectPose
from calibrant.perceive.object_pose.seen import Scene
from calibrant.perceive.object_pose.shapes import box
from calibrant.perceive.registered_depth.noise import DepthNoise
from calibrant.perceive.registered_depth.register import DepthRig
from calibrant.studies.paper import published
from calibrant.verification.touch.errors import radius_95
from calibrant.verification.unchanged.robot_noise import RobotSide, robot_side

if TYPE_CHECKING:
    from calibrant.simulate.robot_cell.cell import RobotCell
    from calibrant.simulate.robot_cell.parts.spec import RobotCellSpec

CAMERA, NAME = "wrist", "cuboid"
READINGS = 6
COLOUR = ColourRange((10.0, 45.0), (60.0, 100.0), (15.0, 100.0))
"""Of the cuboid, orange, in any of the cell's lights; the table is grey."""
BASELINE_M = 0.05
TURNED, SHIFTED = 1e-3, 2e-4
"""Radians and metres, 1 sigma: how well a device's own figures tell where its depth camera stands to its colour one."""
SAMPLES = 4
"""A pixel of a real camera sees all of its area. With one sample the cuboid's edges, nearly along the rows, are stairs
of a pixel, and the strip of its side, half a pixel wide, is drawn in pieces."""
SETTLE_S = 0.2
CHI2_6_95 = 12.5916
"""Chi-square's 95 % of six degrees of freedom."""


@dataclass(frozen=True, eq=False)
class PlacedPose:
    """The mean of the readings of one row in one frame ("camera" or "base"), against the truth.

    T, truth (4, 4): of the equivalent poses those nearest to the paper's; spread_mm, spread_deg (3,): standard
    deviations of the readings along and about the frame's axes; error (6,): rad and m; covariance (6, 6): predicted.
    """

    seed: int
    row: str
    frame: str
    T: Array
    truth: Array
    spread_mm: Array
    spread_deg: Array
    error: Array
    covariance: Array

    @property
    def error_mm(self) -> float:
        """Length of the error."""
        return 1e3 * float(np.linalg.norm(self.error[3:]))

    @property
    def error_deg(self) -> float:
        """Angle of the error, modulo the cuboid's symmetry."""
        return float(np.rad2deg(np.linalg.norm(self.error[:3])))

    @property
    def predicted_95_mm(self) -> float:
        """What the error's length stays below with 95 %."""
        return 1e3 * radius_95(self.covariance[3:, 3:])

    @property
    def predicted_95_deg(self) -> float:
        """What its angle stays below with 95 %."""
        return float(np.rad2deg(radius_95(self.covariance[:3, :3])))

    @property
    def inside(self) -> bool:
        """Whether the truth is in the predicted 95 % region of the six numbers together."""
        return float(self.error @ np.linalg.solve(self.covariance, self.error)) <= CHI2_6_95


@dataclass(frozen=True, eq=False)
class Stand:
    """A row of the paper's tables in the cell. T_base_camera (4, 4): where the camera is sent; T_base_object: where the
    cuboid is laid."""

    row: str
    T_base_camera: Array
    T_base_object: Array


def seen_at(row: str) -> Array:
    """T_camera_object (4, 4) of a row of table 1, the camera looking straight down; z points up, out of the plane."""
    x, y, _, *_, turn = published.CAMERA[row]
    z = published.PLANE_MM - 500 * published.SIDES_M[2]
    R = so3.exp([0, 0, np.deg2rad(turn)]) @ so3.exp([np.pi, 0, 0])
    return se3.make(R, 1e-3 * np.array([x, y, z]))


def stands() -> Iterator[Stand]:
    """The rows: A where the paper's base has it, the camera's x along the base's."""
    a = 1e-3 * published.place(published.BASE, "PA")
    T_base_A = se3.make(so3.exp([np.pi, 0, 0]) @ seen_at("PA")[:3, :3], [a[0], a[1], published.SIDES_M[2] / 2])
    T_base_P = T_base_A @ se3.inverse(seen_at("PA"))
    for row in published.FIXED:
        yield Stand(row, T_base_P, T_base_P @ seen_at(row))
    for row in published.MOVED:
        yield Stand(row, T_base_A @ se3.inverse(seen_at(row)), T_base_A)


def cell_spec() -> RobotCellSpec:
    """The cuboid and the board for the calibration, and the wrist camera alone."""
    from calibrant.simulate.robot_cell.parts.spec import LARGE_BOARD, WRIST, RobotCellSpec, cuboid, sheet

    objects = (cuboid(NAME), sheet("board", LARGE_BOARD, present=False))
    return RobotCellSpec(objects=objects, cameras=(replace(WRIST, samples=SAMPLES),))


def paper_run(cell: RobotCell, *, readings: int = READINGS) -> list[PlacedPose]:
    """Both series in one cell: calibrated, then every row read; two poses a row, in the camera and in the base.

    Raises: RefusedError where the calibration is refused, or the cuboid is not found.
    """
    from calibrant.studies.cell_calibration import calibrate_cell_cameras

    known = calibrate_cell_cameras(cell, (CAMERA,))[CAMERA].hand_eye
    side, rig, noise = robot_side(known, CAMERA), _rig(cell, known.cameras[CAMERA]), depth_noise(cell)
    out: list[PlacedPose] = []
    stood: Array | None = None
    for stand in stands():
        if stood is None or not np.array_equal(stood, stand.T_base_camera):
            _send(cell, stand.T_base_camera, known)
            stood = stand.T_base_camera
        x, y = stand.T_base_object[:2, 3]
        yaw = np.arctan2(stand.T_base_object[1, 0], stand.T_base_object[0, 0])
        cell.lay(NAME, float(x), float(y), yaw=float(yaw))
        cell.wait(SETTLE_S)
        out += _read(cell, stand, side, rig, noise, readings)
    return out


def depth_noise(cell: RobotCell) -> DepthNoise:
    """Of the wrist's depth camera, as its maker states it."""
    depth = cell.cameras[CAMERA].stated.depth
    if depth is None:
        raise InputError(f"camera {CAMERA} has no depth")
    return DepthNoise.stereo(focal_px=depth.parameters["fx"], baseline_m=BASELINE_M)


def _rig(cell: RobotCell, colour: Camera) -> DepthRig:
    """The calibrated colour camera with the device's own figures of its depth camera, and how well these hold."""
    stated = cell.cameras[CAMERA].stated
    if stated.depth is None or stated.T_colour_depth is None:
        raise InputError(f"camera {CAMERA} says nothing of its depth camera")
    return DepthRig(colour, stated.depth, stated.T_colour_depth, np.diag(np.repeat([TURNED, SHIFTED], 3) ** 2))


def _send(cell: RobotCell, T_base_camera: Array, known: CalibrationResult) -> None:
    """The camera to a place, by what the calibration says of it; from the rest position, so that turns stay short."""
    T_gripper_camera = known.transform("gripper", CAMERA).matrix
    cell.robot.move_joints(cell.robot.home, speed=1.0)
    cell.robot.move_to(T_base_camera @ se3.inverse(T_gripper_camera), speed=1.0)


def _read(
    cell: RobotCell, stand: Stand, side: RobotSide, rig: DepthRig, noise: DepthNoise, readings: int
) -> list[PlacedPose]:
    """The row's readings, each a picture; their means in both frames."""
    shape = box(published.SIDES_M, name=NAME)
    in_camera, in_base = [], []
    for _ in range(readings):
        picture = cell.cameras[CAMERA].take()
        T_base_gripper = cell.robot.pose()
        if picture.depth is None:
            raise RefusedError(f"picture {picture.name} has no depth")
        scene = Scene.of(picture.colour, picture.depth, rig, noise=noise)
        segment = the_one(find_segments(picture.colour, COLOUR), what=f"the {NAME}")
        pose = locate(scene, segment, shape).nearest_to(seen_at(stand.row))
        in_camera.append(pose)
        in_base.append(based(pose, side, T_base_gripper))
    true = cell.truth.T_camera_object(CAMERA, NAME), cell.truth.T_base_object(NAME)
    frames = (("camera", in_camera, true[0]), ("base", in_base, true[1]))
    return [mean_pose(cell.seed, stand.row, frame, poses, truth) for frame, poses, truth in frames]


def based(pose: ObjectPose, side: RobotSide, T_base_gripper: Array) -> ObjectPose:
    """A pose in the camera as one in the base, with what robot and hand-eye err by."""
    once = np.zeros(1, dtype=np.int64)
    links = [Link("A", once), Link("X", once)]
    values = [T_base_gripper[None], side.X[None]]
    of_A, of_X = (M[0] for M in link_maps(links, values))
    own = np.diag(np.repeat([side.rotation, side.translation], 3) ** 2)
    C = of_A @ own @ of_A.T + of_X @ side.covariance[:6, :6] @ of_X.T
    if side.arm is not None:
        # What the arm's geometry erred by when it calibrated is in the mounting, and partly what it errs by now.
        shares, here = side.arm.roots(T_base_gripper[None])
        J = of_A @ here[0] + of_X @ shares[:6]
        C = C + J @ J.T
    return pose.moved(product(links, values)[0], "base", C)


def mean_pose(seed: int, row: str, frame: str, poses: Sequence[ObjectPose], truth: Array) -> PlacedPose:
    """The mean of readings, as certain as one of them: what they share (depth's rounding and offset, the calibration)
    outweighs what differs."""
    first = poses[0]
    aligned = np.stack([p.nearest_to(first.matrix).matrix for p in poses])
    mean = replace(first, matrix=se3.mean(aligned), covariance=np.mean([p.covariance for p in poses], axis=0))
    steps = se3.local(np.broadcast_to(mean.matrix, aligned.shape), aligned)
    count = len(poses)
    spread = np.std(steps, axis=0, ddof=1) if count > 1 else np.full(6, np.nan)
    same = truth @ first.symmetries
    nearest = min(same, key=lambda T: float(np.linalg.norm(se3.local(T, mean.matrix)[:3])))
    return PlacedPose(
        seed, row, frame,
        T=mean.matrix, truth=nearest, spread_mm=1e3 * spread[3:], spread_deg=np.rad2deg(spread[:3]),
        error=se3.local(nearest, mean.matrix), covariance=mean.covariance,
    )  # fmt: skip
