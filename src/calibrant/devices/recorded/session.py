"""A recording that plays: its pictures in turn, and where the robot was at each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.data.devices import DeviceCalibration, GripperState, Picture, RobotLimits
from calibrant.devices.driver import Opened
from calibrant.errors import DeviceError, InputError, RefusedError
from calibrant.robots.chain import KinematicChain


@dataclass(frozen=True, eq=False)
class Shot:
    """A picture of the recording, read when its turn comes. time_s: on the recording's clock; depth: if any."""

    name: str
    time_s: float
    colour: Callable[[], NDArray[np.uint8]]
    depth: Callable[[], NDArray[np.float32]] | None = None


@dataclass(eq=False)
class Session:
    """The recording and its moment: that of the picture taken last, at first that of the first.

    T_base_gripper (n, 4, 4) and joints (n, k): where the robot was at each of the n shots, as far as is known.
    """

    source: str
    shots: tuple[Shot, ...]
    T_base_gripper: Array | None = None
    joints: Array | None = None
    chain: KinematicChain | None = None
    taken: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        if not self.shots:
            raise InputError(f"{self.source} holds no pictures")

    @property
    def moment(self) -> int:
        """Which shot it is now."""
        return max(0, self.taken - 1)

    @property
    def time_s(self) -> float:
        """Of this moment, seconds."""
        return self.shots[self.moment].time_s

    def next(self) -> Shot:
        """The next shot, whose moment it is from now on. Raises: DeviceError after the last."""
        if self.taken >= len(self.shots):
            count = len(self.shots)
            raise DeviceError(
                f"{self.source} has ended: {'its picture was' if count == 1 else f'all {count} pictures were'} taken"
            )
        self.taken += 1
        return self.shots[self.taken - 1]


@dataclass(eq=False)
class RecordedCamera:
    """The camera of a recording. See `calibrant.data.CameraSource` for what its methods promise."""

    session: Session
    name: str = "camera"
    stated: DeviceCalibration = field(default_factory=DeviceCalibration)
    _open: bool = field(default=True, init=False)

    def take(self) -> Picture:
        if not self._open:
            raise DeviceError(f"camera {self.name} gives no picture: it was closed")
        shot = self.session.next()
        return Picture(shot.name, shot.colour(), shot.time_s, None if shot.depth is None else shot.depth())

    def close(self) -> None:
        self._open = False


@dataclass(eq=False)
class RecordedRobot:
    """The robot of a recording: it says where it was, and refuses to move. See `calibrant.data.Robot`."""

    session: Session
    moves_matter: bool = field(default=False, init=False)

    @property
    def name(self) -> str:
        return f"recorded robot of {self.session.source}"

    @property
    def limits(self) -> RobotLimits:
        """Of the chain, where one was named; a recording goes at no speed."""
        chain = self.session.chain
        if chain is None:
            count = 0 if self.session.joints is None else self.session.joints.shape[1]
            return RobotLimits(np.tile([-np.inf, np.inf], (count, 1)), np.zeros(count))
        return RobotLimits(np.column_stack([chain.lower, chain.upper]), np.zeros(len(chain.joints)))

    @property
    def time_s(self) -> float:
        return self.session.time_s

    def joints(self) -> Array:
        """Raises: RefusedError where the recording has poses alone."""
        if self.session.joints is None:
            raise RefusedError(
                f"{self.session.source} holds poses and no joint values; where the file has these, name the robot "
                "(robot=ur5e, or its URDF)"
            )
        return np.array(self.session.joints[self.session.moment])

    def pose(self) -> Array:
        if self.session.T_base_gripper is None:
            raise RefusedError(f"{self.session.source} holds no robot poses")
        return np.array(self.session.T_base_gripper[self.session.moment])

    def forward(self, joints: Array) -> Array:
        """Raises: RefusedError where no robot was named."""
        if self.session.chain is None:
            raise RefusedError(
                f"{self.session.source} does not say which robot it is of: name it (robot=ur5e, or its URDF)"
            )
        return self.session.chain.forward(joints)

    def move_joints(self, joints: Array, *, speed: float = 0.3) -> None:
        self._refuse()

    def move_to(self, T_base_gripper: Array, *, speed: float = 0.3) -> None:
        self._refuse()

    def move_line(self, T_base_gripper: Array, *, speed: float = 0.3) -> None:
        self._refuse()

    def drive(self, twist: Array, *, seconds: float) -> None:
        self._refuse()

    def grip(self, width_m: float) -> GripperState:
        raise self._refusal()

    def wait(self, seconds: float) -> None:
        """The recording's time goes on with its pictures alone."""

    def stop(self) -> None:
        """It stands still always."""

    def _refuse(self) -> None:
        raise self._refusal()

    def _refusal(self) -> RefusedError:
        return RefusedError(
            f"the {self.name} does not move: it plays what was recorded; open a cell or a real robot to move one"
        )


def played(session: Session, key: str, camera: str, stated: DeviceCalibration) -> Opened:
    """The devices of a session. key: what a spec calls the camera; camera: its own name."""
    robot = None if session.T_base_gripper is None else RecordedRobot(session)
    return Opened(robot, {key: RecordedCamera(session, camera, stated)}, key)
