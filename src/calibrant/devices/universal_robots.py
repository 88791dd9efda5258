"""Arms of Universal Robots through ur-rtde: `ur:192.168.0.10`, `ur:192.168.0.10,arm=ur5e`. **Untested on hardware.**

Written after ur_rtde 1.6's documented interface (https://sdurobotics.gitlab.io/ur_rtde, RTDEControlInterface and
RTDEReceiveInterface), and tested against a fake of it. Motions are started and watched, so that a stop of the
controller, a lost connection or Ctrl-C ends them. Poses of the controller are of its active tool point; here they are
of the flange:  T_base_flange = T_base_tcp T_flange_tcp^-1.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.data.devices import GripperState, RobotLimits
from calibrant.devices.driver import Driver, Opened
from calibrant.devices.extras import makers_library
from calibrant.devices.host_time import TICK_S, now_s, pause
from calibrant.devices.requests import checked_seconds, checked_speed, checked_twist
from calibrant.devices.spec import DeviceSpec
from calibrant.errors import CalibrantError, DeviceError, RefusedError
from calibrant.geometry import rotations, se3
from calibrant.robots.arms import arm
from calibrant.robots.chain import KinematicChain

JOINT_SPEED = 2 * np.pi / 3
"""rad/s of every joint at speed 1: of the family's slowest joints, base and shoulder of the UR10e (data sheet)."""
TOOL_SPEED = 1.0
"""m/s at speed 1, the "typical TCP speed" of the data sheets."""
JOINT_ACCELERATION, TOOL_ACCELERATION = 1.4, 1.2
"""rad/s2 and m/s2: the defaults of moveJ and moveL."""
DRIVE_ACCELERATION = 0.5
"""m/s2 while driven: from rest to 5 cm/s in a tenth of a second."""
STOP_JOINTS, STOP_TOOL = 2.0, 10.0
"""rad/s2 and m/s2: the defaults of stopJ and speedStop."""
AT_GOAL_RAD, AT_GOAL_M, RESTING_RAD_S = 1e-3, 1e-3, 1e-3
"""A joint, or the tool, so near its goal and so slow has arrived."""
STARTS_S = 0.5
"""An arm that rests for longer than this and is not at its goal will not get there."""


class UniversalRobot:
    """A UR arm as `calibrant.data.Robot`. Untested on hardware.

    control, receive: ur-rtde's interfaces, connected; chain: the maker's nominal figures, by which `forward` is
    computed here (faster, and off by the arm's own calibration); None: the controller computes it.
    """

    moves_matter = True

    def __init__(self, control: Any, receive: Any, name: str, *, chain: KinematicChain | None = None) -> None:
        self.name = name
        self._control, self._receive, self._chain = control, receive, chain
        self._T_flange_tcp = _matrix(self._asked(control.getTCPOffset))
        self._driving = False

    @property
    def limits(self) -> RobotLimits:
        return RobotLimits(np.tile([-2 * np.pi, 2 * np.pi], (6, 1)), np.full(6, JOINT_SPEED))

    @property
    def time_s(self) -> float:
        return now_s()

    def joints(self) -> Array:
        return np.array(self._asked(self._receive.getActualQ), dtype=np.float64)

    def pose(self) -> Array:
        T_base_tcp = _matrix(self._asked(self._receive.getActualTCPPose))
        return np.asarray(T_base_tcp @ se3.inverse(self._T_flange_tcp))

    def forward(self, joints: Array) -> Array:
        q = np.asarray(joints, dtype=np.float64)
        if self._chain is not None:
            return self._chain.forward(q)
        return _matrix(self._asked(lambda: self._control.getForwardKinematics(q.tolist(), [0.0] * 6)))

    def move_joints(self, joints: Array, *, speed: float = 0.3) -> None:
        q = np.asarray(joints, dtype=np.float64)
        if not self._asked(lambda: self._control.isJointsWithinSafetyLimits(q.tolist())):
            raise RefusedError(
                f"{self.name}: these joints are beyond the arm's limits or safety planes; nothing has moved"
            )
        share = checked_speed(speed)
        self._halt_drive()
        self._start(
            lambda: self._control.moveJ(q.tolist(), share * JOINT_SPEED, JOINT_ACCELERATION, True),
            lambda: bool(np.abs(self.joints() - q).max() < AT_GOAL_RAD),
        )

    def move_to(self, T_base_gripper: Array, *, speed: float = 0.3) -> None:
        pose = self._goal(T_base_gripper)
        q = self._asked(lambda: self._control.getInverseKinematics(pose, self.joints().tolist()))
        if len(q) != 6:
            raise RefusedError(f"{self.name} finds no joints for {_words(T_base_gripper)}; nothing has moved")
        self.move_joints(np.array(q), speed=speed)

    def move_line(self, T_base_gripper: Array, *, speed: float = 0.3) -> None:
        pose, share = self._goal(T_base_gripper), checked_speed(speed)
        wanted = se3.check(T_base_gripper, name="T_base_gripper")
        self._halt_drive()
        self._start(
            lambda: self._control.moveL(pose, share * TOOL_SPEED, TOOL_ACCELERATION, True),
            lambda: bool(np.abs(se3.local(self.pose(), wanted)).max() < AT_GOAL_M),
        )

    def drive(self, twist: Array, *, seconds: float) -> None:
        asked, seconds = checked_twist(twist), checked_seconds(seconds)
        self._driving = True
        self._stopping(lambda: self._send(asked))
        # The tool point's velocity turns with the tool: it is sent again at every tick where that changes it.
        turns = bool(np.cross(asked[:3], self._T_flange_tcp[:3, 3]).any())
        self._stopping(lambda: pause(seconds, (lambda: self._send(asked)) if turns else self._need_health))

    def grip(self, width_m: float) -> GripperState:
        raise RefusedError(
            f"{self.name} has no gripper that calibrant drives: grippers of this arm have interfaces of their own. "
            "Open or close it by hand or by its program"
        )

    def wait(self, seconds: float) -> None:
        self._halt_drive()
        pause(checked_seconds(seconds), self._need_health)

    def stop(self) -> None:
        """Stand still; never raises: whatever does not answer, the next command is tried."""
        for command in (
            lambda: self._control.speedStop(STOP_TOOL) if self._driving else None,
            lambda: self._control.stopJ(STOP_JOINTS, False),
        ):
            with suppress(Exception):
                command()
        self._driving = False

    def close(self) -> None:
        """Stand still and let the controller's script end; never raises."""
        self.stop()
        for command in (
            lambda: self._control.stopScript(),
            lambda: self._control.disconnect(),
            lambda: self._receive.disconnect(),
        ):
            with suppress(Exception):  # the connection may be gone already
                command()

    # -- the controller ----------------------------------------------------------------------------------------------

    def _send(self, twist: Array) -> None:
        """The velocity of the tool point with which the flange has this twist: v + omega x R t."""
        omega, v = twist[:3], twist[3:]
        lever = self.pose()[:3, :3] @ self._T_flange_tcp[:3, 3]
        of_tool = [float(x) for x in (*(v + np.cross(omega, lever)), *omega)]
        self._command(lambda: self._control.speedL(of_tool, DRIVE_ACCELERATION, 0.0))

    def _goal(self, T_base_gripper: Array) -> list[float]:
        """The pose of the tool point with the flange there. Raises: RefusedError where it cannot be."""
        T = se3.check(T_base_gripper, name="T_base_gripper") @ self._T_flange_tcp
        pose = [*T[:3, 3], *rotations.rotation_vector_from_matrix(T[:3, :3], unit="rad")]
        values = [float(v) for v in pose]
        if not self._asked(lambda: self._control.isPoseWithinSafetyLimits(values)):
            raise RefusedError(
                f"{self.name} cannot reach {_words(T_base_gripper)}, or its safety planes forbid it; nothing has moved"
            )
        return values

    def _start(self, move: Callable[[], bool], arrived: Callable[[], bool]) -> None:
        """A motion from its start to its end. Raises: DeviceError where it ends elsewhere."""
        if arrived():
            return
        self._command(move)
        self._stopping(lambda: self._watch(arrived))

    def _watch(self, arrived: Callable[[], bool]) -> None:
        resting_since: float | None = None
        while True:
            self._need_health()
            resting = np.abs(self._asked(self._receive.getActualQd)).max() < RESTING_RAD_S
            if resting and arrived():
                return
            now = now_s()
            resting_since = (resting_since or now) if resting else None
            if resting_since is not None and now - resting_since > STARTS_S:
                raise DeviceError(f"{self.name} stands still before its goal: see the message on its teach pendant")
            pause(TICK_S)

    def _stopping(self, work: Callable[[], None]) -> None:
        """The arm stops when what runs ends by an error, or by Ctrl-C."""
        try:
            work()
        except BaseException:
            self.stop()
            raise

    def _halt_drive(self) -> None:
        if self._driving:
            self._driving = False
            self._command(lambda: self._control.speedStop(STOP_TOOL))

    def _command(self, send: Callable[[], bool]) -> None:
        self._need_health()
        if not self._asked(send):
            raise DeviceError(
                f"{self.name} does not take commands: is it in remote control, and is no other program running?"
            )

    def _need_health(self) -> None:
        if not self._asked(self._receive.isConnected):
            raise DeviceError(f"{self.name} does not answer any more: the connection is lost. Look at the arm first")
        stopped = "an emergency stop" if self._asked(self._receive.isEmergencyStopped) else ""
        stopped = "a protective stop" if not stopped and self._asked(self._receive.isProtectiveStopped) else stopped
        if stopped:
            raise DeviceError(f"{self.name} stopped by itself: {stopped}. Free the arm and unlock it on its pendant")

    def _asked(self, question: Callable[[], Any]) -> Any:
        """What the library answers. Raises: DeviceError for what it raises."""
        try:
            return question()
        except CalibrantError:
            raise
        except RuntimeError as error:
            raise DeviceError(f"{self.name} does not answer: {error}") from error


def open_arm(spec: DeviceSpec) -> Opened:
    """Connect. Raises: MissingExtraError without ur-rtde; DeviceError where nothing answers."""
    host = spec.need_place("the controller's address: ur:192.168.0.10")
    chain = arm(spec.options["arm"]) if "arm" in spec.options else None
    what = "an arm of Universal Robots"
    receiving = makers_library("rtde_receive", package="ur-rtde", what=what)
    controlling = makers_library("rtde_control", package="ur-rtde", what=what)
    try:
        receive = receiving.RTDEReceiveInterface(host)
        control = controlling.RTDEControlInterface(host)
    except RuntimeError as error:
        raise DeviceError(
            f"no arm of Universal Robots answers at {host}: {error}. Is it on, in remote control, and in this network?"
        ) from error
    robot = UniversalRobot(control, receive, f"UR at {host}", chain=chain)
    return Opened(robot, release=robot.close)


def _matrix(pose: Any) -> Array:
    """T (4, 4) of x, y, z, rx, ry, rz: metres and a rotation vector."""
    values = np.asarray(pose, dtype=np.float64)
    if values.shape != (6,) or not np.isfinite(values).all():
        raise DeviceError(f"the controller answered {values} for a pose; expected six finite numbers")
    return se3.make(rotations.matrix_from_rotation_vector(values[3:], unit="rad"), values[:3])


def _words(T: Array) -> str:
    x, y, z = 1e3 * np.asarray(T)[:3, 3]
    return f"the flange pose at ({x:.0f}, {y:.0f}, {z:.0f}) mm"


DRIVER = Driver(
    name="ur",
    form="ur:ADDRESS[,arm=ur3e|ur5e|ur10e]",
    gives=("robot",),
    says="an arm of Universal Robots",
    tested="a fake of ur-rtde 1.6; untested on hardware",
    connect=open_arm,
    keys=("arm",),
    extra="devices",
)
