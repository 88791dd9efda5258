"""Franka arms through panda-python: `panda:172.16.0.2`, `panda:172.16.0.2,gripper=no`. **Untested on hardware.**

Written after panda-py 1's documented interface (https://jeanelsner.github.io/panda-py), and tested against a fake of
it. Way and pose are computed here, from the published kinematics, and sent as joint values: panda-py's own Cartesian
motion is an impedance controller that settles some millimetres short. While it is driven, joint velocities follow

    q' = J^T (J J^T + mu^2 I)^-1 twist

a hundred times a second, slowed down as a whole where a joint would be too fast. The arm's activation (Desk, FCI) is
the person's: calibrant keeps no passwords.
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
from calibrant.devices.host_time import now_s, pause
from calibrant.devices.requests import checked_seconds, checked_speed, checked_twist
from calibrant.devices.spec import DeviceSpec
from calibrant.errors import DeviceError, InputError, RefusedError
from calibrant.geometry import se3
from calibrant.robots.arms import arm
from calibrant.robots.inverse import joint_rates
from calibrant.robots.limits import LIMIT_SLACK
from calibrant.robots.paths import line_path, nearest_joints

JOINT_SPEEDS = np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])
"""rad/s: the limits of the Franka Control Interface (Robot and interface specifications)."""
REST = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])
"""Joints of the maker's rest position, where the search for joints of a pose begins too."""
FINGER_SPEED, WIDEST_M = 0.1, 0.08
"""m/s and m: of the Franka Hand, which closes with up to 0.2 m/s."""
FORCE_N = 20.0
"""Of a grip unless told: a third of what the hand keeps up."""
HELD_M = 0.001
"""Fingers that stop this far before what was asked stand against something."""
AHEAD_S = 0.1
"""A joint that would leave its range so soon stops the drive: at the drive's speed it still comes to rest."""
MOST_WAYPOINTS = 12
"""Of a straight line: panda-py plans through each; between them the flange leaves a line of 30 cm by less than 1 mm."""


class FrankaArm:
    """A Franka arm and hand as `calibrant.data.Robot`. Untested on hardware.

    panda: a `panda_py.Panda`; velocity: makes a `controllers.IntegratedVelocity`; hand: a `libfranka.Gripper`, or None.
    """

    moves_matter = True

    def __init__(
        self, panda: Any, name: str, *, velocity: Callable[[], Any], hand: Any = None, force_n: float = FORCE_N
    ) -> None:
        self.name = name
        self._panda, self._hand, self._force_n = panda, hand, force_n
        self._velocity, self._drive = velocity, None
        self._chain = arm("panda")

    @property
    def limits(self) -> RobotLimits:
        return RobotLimits(np.column_stack([self._chain.lower, self._chain.upper]), JOINT_SPEEDS.copy())

    @property
    def time_s(self) -> float:
        return now_s()

    def joints(self) -> Array:
        return np.array(self._state().q, dtype=np.float64)

    def pose(self) -> Array:
        """O_T_EE F_T_EE^-1: the flange, whatever end effector is set in Desk."""
        state = self._state()
        return np.asarray(_matrix(state.O_T_EE) @ se3.inverse(_matrix(state.F_T_EE)))

    def forward(self, joints: Array) -> Array:
        return self._chain.forward(joints)

    def move_joints(self, joints: Array, *, speed: float = 0.3) -> None:
        goal = self._chain.check(joints)
        beyond = (goal < self._chain.lower) | (goal > self._chain.upper)
        if beyond.any():
            k = int(np.argmax(beyond))
            low, high = np.rad2deg([self._chain.lower[k], self._chain.upper[k]])
            raise RefusedError(
                f"{self.name}: joint {k + 1} would go to {np.rad2deg(goal[k]):.1f} deg, its limits are {low:.1f} to "
                f"{high:.1f} deg; nothing has moved"
            )
        self._through([goal], speed)

    def move_to(self, T_base_gripper: Array, *, speed: float = 0.3) -> None:
        T = se3.check(T_base_gripper, name="T_base_gripper")
        self.move_joints(nearest_joints(self._chain, T, self.joints(), REST), speed=speed)

    def move_line(self, T_base_gripper: Array, *, speed: float = 0.3) -> None:
        T = se3.check(T_base_gripper, name="T_base_gripper")
        path = line_path(self._chain, self.joints(), T)
        rows = np.unique(np.linspace(1, len(path) - 1, MOST_WAYPOINTS).round().astype(int))
        self._through([path[k] for k in rows], speed)

    def drive(self, twist: Array, *, seconds: float) -> None:
        asked, seconds = checked_twist(twist), checked_seconds(seconds)
        try:
            if self._drive is None:
                controller = self._velocity()
                controller.set_control(np.zeros(7))
                self._asked(lambda: self._panda.start_controller(controller))
                self._drive = controller
            pause(seconds, lambda: self._follow(asked))
        except BaseException:
            self.stop()
            raise

    def grip(self, width_m: float) -> GripperState:
        if self._hand is None:
            raise RefusedError(f"{self.name} was opened without a gripper (gripper=no)")
        if not 0 <= width_m <= WIDEST_M:
            raise InputError(f"the gripper opens from 0 to {1e3 * WIDEST_M:g} mm, asked for {1e3 * width_m:g} mm")
        before = float(self._asked(self._hand.read_once).width)
        if width_m >= before:
            self._asked(lambda: self._hand.move(width_m, FINGER_SPEED))
        else:
            # Any width between is accepted, so that fingers that find nothing are no error.
            self._asked(lambda: self._hand.grasp(width_m, FINGER_SPEED, self._force_n, WIDEST_M, WIDEST_M))
        width = float(self._asked(self._hand.read_once).width)
        return GripperState(width, width > width_m + HELD_M)

    def wait(self, seconds: float) -> None:
        self._end_drive()
        pause(checked_seconds(seconds))

    def stop(self) -> None:
        """Stand still; never raises."""
        for command in (
            lambda: None if self._drive is None else self._drive.set_control(np.zeros(7)),
            lambda: self._panda.stop_controller(),
        ):
            with suppress(Exception):
                command()
        self._drive = None

    # -- the arm -----------------------------------------------------------------------------------------------------

    def _through(self, waypoints: list[Array], speed: float) -> None:
        share = checked_speed(speed)
        self._end_drive()
        try:
            done = self._asked(lambda: self._panda.move_to_joint_position(waypoints, speed_factor=share))
        except BaseException:
            self.stop()
            raise
        if not done:
            self._asked(self._panda.raise_error)
            raise DeviceError(f"{self.name} stands still before its goal: something may be in the way")

    def _follow(self, twist: Array) -> None:
        """One step of a drive. Raises: RefusedError at the end of a joint's range, when the arm has stopped."""
        self._asked(self._panda.raise_error)
        q = self.joints()
        rates = joint_rates(self._chain, q, twist, JOINT_SPEEDS)
        ahead = q + AHEAD_S * rates
        beyond = (ahead < self._chain.lower - LIMIT_SLACK) | (ahead > self._chain.upper + LIMIT_SLACK)
        if (beyond & (np.abs(rates) > 0)).any():
            raise RefusedError(
                f"{self.name} has stopped: joint {int(np.argmax(beyond)) + 1} is at the end of its range; drive back, "
                "or move to another pose"
            )
        self._asked(lambda: None if self._drive is None else self._drive.set_control(rates))

    def _end_drive(self) -> None:
        if self._drive is not None:
            self.stop()

    def _state(self) -> Any:
        return self._asked(self._panda.get_state)

    def _asked(self, question: Callable[[], Any]) -> Any:
        """What the library answers. Raises: DeviceError for what it raises."""
        try:
            return question()
        except RuntimeError as error:
            raise DeviceError(
                f"{self.name} stopped or does not answer: {error}. Look at the arm, free it and unlock it in Desk"
            ) from error


def open_arm(spec: DeviceSpec) -> Opened:
    """Connect. Raises: MissingExtraError without panda-python; DeviceError where nothing answers."""
    host = spec.need_place("the arm's address: panda:172.16.0.2")
    with_hand = spec.one_of("gripper", ("yes", "no"), "yes") == "yes"
    what = "a Franka arm"
    library = makers_library("panda_py", package="panda-python", what=what)
    controllers = makers_library("panda_py.controllers", package="panda-python", what=what)
    libfranka = makers_library("panda_py.libfranka", package="panda-python", what=what)
    try:
        panda = library.Panda(host)
        hand = libfranka.Gripper(host) if with_hand else None
    except RuntimeError as error:
        raise DeviceError(
            f"no Franka arm answers at {host}: {error}. Is it on, unlocked, and FCI active in Desk? Without a Franka "
            "Hand: gripper=no"
        ) from error
    robot = FrankaArm(
        panda,
        f"Franka at {host}",
        velocity=controllers.IntegratedVelocity,
        hand=hand,
        force_n=spec.number("force", FORCE_N),
    )
    return Opened(robot, release=robot.stop)


def _matrix(column_major: Any) -> Array:
    """T (4, 4) of libfranka's sixteen numbers, column by column."""
    values = np.asarray(column_major, dtype=np.float64)
    if values.shape != (16,) or not np.isfinite(values).all():
        raise DeviceError(f"the arm answered {values} for a pose; expected sixteen finite numbers")
    return values.reshape(4, 4, order="F")


DRIVER = Driver(
    name="panda",
    form="panda:ADDRESS[,gripper=yes|no,force=20]",
    gives=("robot",),
    says="a Franka arm and its hand",
    tested="a fake of panda-py 1; untested on hardware",
    connect=open_arm,
    keys=("gripper", "force"),
    extra="devices",
)
