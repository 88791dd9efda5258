"""The simulated cell: a robot, cameras, things, and the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.geometry import se3
from calibrant.simulate.robot_cell.arm.robot import SimulatedRobot
from calibrant.simulate.robot_cell.draw import lying_at
from calibrant.simulate.robot_cell.parts.spec import CellObject, RobotCellSpec
from calibrant.simulate.robot_cell.pictures.camera import SimulatedCamera
from calibrant.simulate.robot_cell.pictures.views import Renderer
from calibrant.simulate.robot_cell.truth import CellTruth
from calibrant.simulate.robot_cell.world.physics import World

if TYPE_CHECKING:
    from calibrant.simulate.robot_cell.film import Recorder


class RobotCell:
    """What `make_robot_cell` gives. A context manager: leaving it lets go of the renderer and ends a recording.

    seed, spec; robot: a `data.Robot`; cameras: `data.CameraSource` by name; truth: what is true; drawn_by: which
    renderer draws, and why. `random` is the cell's own stream of random numbers, for what a run draws besides.
    """

    def __init__(
        self,
        seed: int,
        spec: RobotCellSpec,
        *,
        world: World,
        robot: SimulatedRobot,
        cameras: Mapping[str, SimulatedCamera],
        truth: CellTruth,
        renderer: Renderer,
        drawn_by: str,
        random: np.random.Generator,
    ) -> None:
        self.seed, self.spec = seed, spec
        self.robot, self.cameras, self.truth = robot, cameras, truth
        self.drawn_by, self.random = drawn_by, random
        self._world, self._renderer = world, renderer
        self._items = {o.name: o for o in spec.objects}
        self._recorder: Recorder | None = None
        self._tool: str | None = spec.tool

    def __enter__(self) -> RobotCell:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End a recording and let go of the renderer; nothing happens the second time."""
        if self._recorder is not None:
            self._recorder.finish()
            self._recorder = None
        for camera in self.cameras.values():
            camera.close()
        self._renderer.close()

    @property
    def time_s(self) -> float:
        """Seconds since the cell began."""
        return self._world.time_s

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self._world.wait(seconds)

    @property
    def objects(self) -> dict[str, CellObject]:
        """Things by name, also those that are away."""
        return dict(self._items)

    def place(self, name: str, T_base_object: ArrayLike) -> None:
        """Bring a thing into the cell, or move it, at rest. Raises: InputError for an unknown name or no transform."""
        self._world.put(self._item(name).name, se3.check(T_base_object, name="T_base_object"))

    def lay(self, name: str, x: float, y: float, *, yaw: float = 0.0, z: float = 0.0) -> Array:
        """Lay a thing flat with its middle at (x, y), on a plane at height z (the table: 0), turned; metres, radians.
        Returns T_base_object."""
        T = lying_at(self._item(name), x, y, yaw=yaw, z=z)
        self.place(name, T)
        return T

    def remove(self, name: str) -> None:
        """Take a thing out of the cell."""
        self._world.take_away(self._item(name).name)

    def present(self, name: str) -> bool:
        """Whether a thing is in the cell."""
        return self._world.is_present(self._item(name).name)

    def camera(self, name: str) -> SimulatedCamera:
        """A camera by name. Raises: InputError listing the names."""
        return self._source(name)

    def push(self, camera: str, xi: ArrayLike) -> None:
        """Knock a camera by xi (6,), rotation and translation along its parent's axes (`se3.retract`), rad and m."""
        source = self._source(camera)
        source.T_parent_camera = se3.retract(source.T_parent_camera, np.asarray(xi, dtype=np.float64))

    def carry(self, tool: Literal["pen", "stick"] | None) -> None:
        """Put the pen or the stick's board into the gripper, or take it out; the tip's place changes with it."""
        if tool not in (None, "pen", "stick"):
            raise InputError(f"unknown tool {tool!r}; the gripper carries 'pen', 'stick' or nothing (None)")
        self._tool = tool
        self.robot.carry(tool)

    @property
    def tool(self) -> str | None:
        """What is in the gripper: "pen", "stick" or nothing."""
        return self._tool

    def spin(self, name: str, rad_s: float) -> None:
        """Turn a box about the vertical at a rate, as a turntable under it would, until friction stops it; called at
        every step it goes on. Raises: InputError for an unknown name."""
        self._world.spin(self._item(name).name, rad_s)

    def run_conveyor(self, speed_m_s: float) -> None:
        """Run the belt at a speed along +y. Raises: InputError for a cell without one."""
        if self.spec.conveyor is None:
            raise InputError("this cell has no conveyor; make it with RobotCellSpec(conveyor=Conveyor())")
        self._world.belt_speed = float(speed_m_s)
        if speed_m_s == 0:
            self._world.data.qvel[self._world.model.joint("belt").dofadr[0]] = 0.0

    def record(self, recorder: Recorder) -> None:
        """Keep every picture and a film of the cell from now on, until `close`."""
        self._recorder = recorder
        for camera in self.cameras.values():
            camera.when_taken(recorder.picture)
        self._world.at_every_step(recorder.at_time)

    def show(self) -> None:
        """Open a window on the cell, that follows it in its own time. Raises: InputError without a screen."""
        from calibrant.simulate.robot_cell.window import open_window

        self._world.at_every_step(open_window(self._world))

    def at_every_step(self, hook: Callable[[float], None]) -> None:
        """Call hook(time_s) after every step of physics, for studies that watch the truth."""
        self._world.at_every_step(hook)

    def _item(self, name: str) -> CellObject:
        if name not in self._items:
            raise InputError(f"there is nothing called {name!r} in the cell; it has {', '.join(self._items)}")
        return self._items[name]

    def _source(self, camera: str) -> SimulatedCamera:
        if camera not in self.cameras:
            raise InputError(f"the cell has no camera {camera!r}; it has {', '.join(self.cameras)}")
        return self.cameras[camera]
