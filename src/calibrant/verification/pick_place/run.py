"""One cube set upon another: looked at, said, grasped, lifted, set down, looked after."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data.devices import CameraSource, Robot
from calibrant.errors import CalibrantError, InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.perceive.colour.ranges import ColourRange
from calibrant.perceive.registered_depth.noise import DepthNoise
from calibrant.perceive.registered_depth.register import DepthRig, register_depth
from calibrant.verification.pick_place.cubes import Cube, Eye, by_point, by_shape, half_added
from calibrant.verification.touch.table import OFF, Table
from calibrant.verification.unchanged.robot_noise import RobotSide

OPEN_M = 0.075
"""Between the fingers before a grasp: a cube of 40 mm, turned by some degrees, and what its place errs by."""
SQUEEZE_M = 0.01
"""Below the cube's side: what the fingers are told, so that they press."""
ABOVE_M = 0.10
CLEAR_M = 0.001
"""Between two cubes when the upper one is let go."""
WAYS = ("shape", "centre of the mask", "half a side added")
"""The way of this project, and the thesis's two."""


@dataclass(frozen=True, eq=False)
class Task:
    """What it takes. side: the calibration; cube_m: a cube's side; pick, place: colours; T_gripper_grasp (4, 4): the
    middle between the fingers' pads; confirm: asked in words before the arm moves; table: where cubes stand on."""

    robot: Robot
    source: CameraSource
    camera: Camera
    rig: DepthRig
    noise: DepthNoise
    side: RobotSide
    cube_m: float
    pick: ColourRange
    place: ColourRange
    T_gripper_grasp: Array
    confirm: Callable[[str], bool]
    table: Table
    speeds: tuple[float, float] = (0.3, 0.1)


@dataclass(frozen=True, eq=False)
class Seen:
    """Both cubes by one way, or why they are not known."""

    pick: Cube | None
    place: Cube | None
    reason: str = ""


def look(task: Task, *, off: Array | None = None) -> dict[str, Seen]:
    """Both cubes by every way, from one picture.

    Args: off (3,), metres along the axes of the camera's parent: what the thesis's two ways are given a camera off by.
    Raises: DeviceError when the camera is gone; InputError for one without depth.
    """
    picture = task.source.take()
    if picture.depth is None:
        raise InputError(f"camera {task.source.name} gives no depth; where a cube is, its colour alone does not tell")
    eye = _eye(task, task.side.X)
    shape = _both(task, lambda colour: by_shape(eye, picture, colour))
    old = _eye(task, se3.retract(task.side.X, np.concatenate([np.zeros(3), np.zeros(3) if off is None else off])))
    registered = register_depth(picture.depth, task.rig, noise=task.noise)
    point = _turned(_both(task, lambda colour: by_point(old, picture, registered, colour)), shape)
    half = Seen(
        None if point.pick is None else half_added(old, point.pick),
        None if point.place is None else half_added(old, point.place),
        point.reason,
    )
    return dict(zip(WAYS, (shape, point, half)))


def _eye(task: Task, X: Array) -> Eye:
    T = task.robot.pose() @ X if task.side.in_hand else X
    return Eye(task.camera, task.rig, task.noise, task.side, T, task.cube_m)


def _both(task: Task, way: Callable[[ColourRange], Cube]) -> Seen:
    try:
        return Seen(way(task.pick), way(task.place))
    except RefusedError as error:
        return Seen(None, None, str(error))


def _turned(point: Seen, shape: Seen) -> Seen:
    """The points with the turns that the shapes told: the thesis's cubes lay as the fingers needed them."""
    pairs = ((point.pick, shape.pick), (point.place, shape.place))
    found = [None if p is None else replace(p, yaw=None if s is None else s.yaw) for p, s in pairs]
    return Seen(found[0], found[1], point.reason)


def pick_and_place(task: Task, seen: Seen) -> str:
    """Set one cube upon the other. Returns: why it failed, empty where nothing was noticed.

    Raises: DeviceError when the robot stops answering; it is stopped then.
    """
    if seen.pick is None or seen.place is None:
        return seen.reason
    for cube, what in ((seen.pick, "pick"), (seen.place, "set down on")):
        low = too_low(task, cube)
        if low:
            return f"the cube to {what}: {low}"
    words = _words(seen)
    if not task.confirm(words):
        raise RefusedError(f"{words}. Not confirmed: the arm has not moved")
    try:
        return _moved(task, seen.pick, seen.place)
    except RefusedError as error:
        task.robot.stop()
        return f"out of reach: {error}"
    except CalibrantError:
        task.robot.stop()
        raise


def too_low(task: Task, cube: Cube) -> str:
    """Words for a point that no cube on the table has: in the table, or over where its middle can be."""
    own = 0.0 if cube.covariance is None else float(np.sqrt(cube.covariance[2, 2]))
    sigma = float(np.hypot(task.table.sigma_z, own))
    off = float(cube.centre[2]) - task.table.z - 0.5 * task.cube_m
    if off < -0.5 * task.cube_m - OFF * task.table.sigma_z:
        return f"no depth on it: its point is {1e3 * (-off - 0.5 * task.cube_m):.0f} mm inside the table"
    if cube.covariance is not None and abs(off) > OFF * sigma:
        return f"its middle is {1e3 * off:+.1f} mm off where a cube on the table has it, {abs(off) / sigma:.1f} sigma"
    return ""


def _words(seen: Seen) -> str:
    def at(cube: Cube | None) -> str:
        return "–" if cube is None else ", ".join(f"{a} {1e3 * v:.1f}" for a, v in zip("xyz", cube.centre))

    return f"the cube to pick is at {at(seen.pick)} mm in the base, the one to set it on at {at(seen.place)} mm"


def _moved(task: Task, pick: Cube, place: Cube) -> str:
    robot, fast, slow = task.robot, *task.speeds
    robot.grip(OPEN_M)
    grasp = _grasp(task, pick.centre, pick.yaw)
    robot.move_to(_raised(grasp), speed=fast)
    robot.move_line(grasp, speed=slow)
    if not robot.grip(max(task.cube_m - SQUEEZE_M, 0.0)).holds:
        robot.move_line(_raised(grasp), speed=slow)
        return "nothing between the fingers: the point is beside the cube, or above it"
    robot.move_line(_raised(grasp), speed=slow)
    if not robot.grip(max(task.cube_m - SQUEEZE_M, 0.0)).holds:
        return "slipped out of the fingers while it was lifted: its edge was taken"
    goal = np.add(place.centre, (0.0, 0.0, task.cube_m + CLEAR_M))
    release = _grasp(task, goal, place.yaw)
    robot.move_to(_raised(release), speed=fast)
    robot.move_line(release, speed=slow)
    robot.grip(OPEN_M)
    robot.move_line(_raised(release), speed=slow)
    return ""


def _raised(T: Array) -> Array:
    out = T.copy()
    out[2, 3] += ABOVE_M
    return out


def _grasp(task: Task, centre: Array, yaw: float | None) -> Array:
    """T_base_gripper (4, 4) that has a point between the pads, from above; of a cube's quarter turns the one that
    turns the hand least from where it is."""
    now = task.robot.pose()[:3, :3]
    ways = []
    for k in range(4):
        R = so3.exp([0.0, 0.0, (yaw or 0.0) + k * np.pi / 2]) @ so3.exp([np.pi, 0.0, 0.0])
        T = se3.make(R, centre) @ se3.inverse(task.T_gripper_grasp)
        ways.append((float(np.linalg.norm(so3.log(now.T @ T[:3, :3]))), T))
    return min(ways, key=lambda way: way[0])[1]


def judged(reason: str, off: Array, cube_m: float) -> str:
    """Why a run failed, by where the cube is: off (3,), from where it should lie on the other one; empty for none."""
    if reason:
        return reason
    aside = float(np.hypot(off[0], off[1]))
    if abs(float(off[2])) > 0.25 * cube_m:
        return f"not on the other cube: {1e3 * float(off[2]):+.0f} mm in height, {1e3 * aside:.0f} mm aside"
    if aside > 0.5 * cube_m:
        return f"hangs over: {1e3 * aside:.0f} mm aside"
    return ""
