"""The arm of the cell as `data.Robot`: a controller over MuJoCo's servos.

The controller knows the nominal chain and reads encoders. The flange is elsewhere: links and encoder zeros are off
(baked into the model), and at every stop each joint stands off by backlash and repeatability, which no encoder sees:

    joint = encoder + play,  play = backlash / 2 * (side it came from) + noise
"""

from __future__ import annotations

import numpy as np

from calibrant.arrays import Array
from calibrant.data import GripperState, RobotLimits
from calibrant.errors import DeviceError, InputError, RefusedError
from calibrant.geometry import se3
from calibrant.robots.links import LinkChain
from calibrant.robots.paths import joint_path, line_path, nearest_joints
from calibrant.simulate.robot_cell.arm.arms import CellArm
from calibrant.simulate.robot_cell.arm.gripper import FINGERS, STROKE_M, TOOL_GEOMS, tip_end_m
from calibrant.simulate.robot_cell.arm.paths import Workspace
from calibrant.simulate.robot_cell.arm.servos import servo_lag_s
from calibrant.simulate.robot_cell.parts.noise import RobotNoise
from calibrant.simulate.robot_cell.world.physics import World

_LOST_RAD = 0.012
"""A joint this far behind its command pushes with 100 N m, as many as the Franka arm's reflexes allow: it stops."""
_ACCELERATION = 6.0
"""rad/s^2 of joints, below the 7.5 to 20 that the Franka arm's interface allows: what its servos follow closely."""
_CONTROL_STEPS = 4
"""Of physics for one of the controller: 125 Hz, as the UR5's interface has."""
_FINGER_SPEED = 0.1
"""m/s each; Franka's hand: 0.2 m/s of width."""
_HOLD_M = 0.001
"""Fingers that stop this far before what was asked stand against something."""


class SimulatedRobot:
    """An arm in a `World`. See `calibrant.data.Robot` for what its methods promise."""

    def __init__(self, world: World, arm: CellArm, noise: RobotNoise, rng: np.random.Generator) -> None:
        self._world, self._arm, self._rng = world, arm, rng
        self._chain: LinkChain = arm.chain
        self._noise = noise
        n = len(arm.chain.joints)
        self._q_rows, self._v_rows, self._servos = world.joint_rows([j.name for j in arm.chain.joints])
        self._finger_rows, _, self._finger_servos = world.joint_rows(list(FINGERS))
        self._play, self._side, self._correction = np.zeros(n), np.zeros(n), np.zeros(n)
        self._target, self._speed = arm.home.copy(), np.zeros(n)
        self._twist: Array | None = None
        self._rate, self._ticks = np.zeros(n), 0
        self._low: str | None = None
        self._repeat = self._joint_scatter()
        self.workspace = Workspace(arm.chain, tip_end_m(None), 0.0)
        self.carried: str | None = None
        self.fault: str | None = None
        world.data.qpos[self._q_rows] = arm.home
        world.data.qpos[self._finger_rows] = STROKE_M / 2
        world.data.ctrl[self._finger_servos] = STROKE_M / 2
        world.data.ctrl[self._servos] = arm.home
        world.settle()
        world.at_every_step(self._keep_moving)

    @property
    def name(self) -> str:
        return f"simulated {self._arm.name}"

    @property
    def moves_matter(self) -> bool:
        return False

    @property
    def limits(self) -> RobotLimits:
        return RobotLimits(np.column_stack([self._chain.lower, self._chain.upper]), self._arm.speeds)

    @property
    def chain(self) -> LinkChain:
        """The controller's kinematics: the maker's figures."""
        return self._chain

    @property
    def home(self) -> Array:
        """Joints (n,) of its rest position."""
        return self._arm.home.copy()

    @property
    def time_s(self) -> float:
        return self._world.time_s

    def joints(self) -> Array:
        return np.array(self._world.data.qpos[self._q_rows]) - self._play

    def pose(self) -> Array:
        return self.forward(self.joints())

    def forward(self, joints: Array) -> Array:
        return self._chain.forward(joints)

    def move_joints(self, joints: Array, *, speed: float = 0.3) -> None:
        goal = self._checked(joints)
        path = joint_path(self._command(), goal)
        low = self.workspace.first_below(path)
        if low is not None:
            raise RefusedError(
                f"on the way to these joints {low}; nothing has moved. Give a goal above the table, or go there by a "
                "pose above it first"
            )
        self._follow(path, speed)

    def move_to(self, T_base_gripper: Array, *, speed: float = 0.3) -> None:
        goal = self._inverse(T_base_gripper)
        path = self.workspace.path_over_table(self._command(), goal, self._arm.home)
        self._follow(path, speed)

    def move_line(self, T_base_gripper: Array, *, speed: float = 0.3) -> None:
        T = self._checked_pose(T_base_gripper)
        self._follow(line_path(self._chain, self._command(), T), speed)

    def drive(self, twist: Array, *, seconds: float) -> None:
        self._need_answer()
        if seconds < 0:
            raise InputError(f"a drive of {seconds} s; expected 0 or more")
        asked = np.asarray(twist, dtype=np.float64)
        if asked.shape != (6,) or not np.all(np.isfinite(asked)):
            raise InputError(f"a twist is six finite numbers, rotation and translation; got {asked}")
        self._twist, self._ticks = asked, 0
        self._world.wait(seconds)
        if self.fault is not None:
            raise RefusedError(self._take_fault())

    def grip(self, width_m: float) -> GripperState:
        self._need_answer()
        if not 0 <= width_m <= STROKE_M:
            raise InputError(f"the gripper opens from 0 to {1e3 * STROKE_M:g} mm, asked for {1e3 * width_m:g} mm")
        data, step = self._world.data, self._world.step_s
        goal, still = width_m / 2, 0
        for _ in range(round(3.0 / step)):
            now = data.ctrl[self._finger_servos]
            data.ctrl[self._finger_servos] = now + np.clip(goal - now, -_FINGER_SPEED * step, _FINGER_SPEED * step)
            before = data.qpos[self._finger_rows].copy()
            self._world.step()
            moved = np.abs(data.qpos[self._finger_rows] - before).max()
            arrived = np.abs(data.ctrl[self._finger_servos] - goal).max() < 1e-9
            still = still + 1 if arrived and moved < 1e-3 * step else 0
            if still > 25:
                break
        width = float(data.qpos[self._finger_rows].sum())
        return GripperState(width, width > width_m + _HOLD_M)

    def wait(self, seconds: float) -> None:
        if self._twist is not None:
            self.stop()
        self._world.wait(seconds)

    def stop(self) -> None:
        self._twist = None
        self._speed = np.zeros(len(self._play))
        self._target = np.array(self._world.data.qpos[self._q_rows]) - self._play
        self._send(self._target, self._speed)

    def carry(self, tool: str | None) -> None:
        """A person puts a tool into the gripper, or takes it out: "pen", "stick" or None."""
        for name, geoms in TOOL_GEOMS.items():
            for geom in geoms:
                self._world.show(geom, visible=name == tool)
        self.carried = tool
        self.workspace = Workspace(self._chain, tip_end_m(tool), 0.0)

    def disconnect(self) -> None:
        """Stop answering, as a robot whose controller was switched off: every motion raises DeviceError from now on."""
        self.stop()
        self._answers = False

    _answers = True

    # -- how motions run -------------------------------------------------------------------------------------------

    def _command(self) -> Array:
        return self._target.copy()

    def _checked(self, joints: Array) -> Array:
        goal = self._chain.check(joints)
        if not self._chain.within_limits(goal):
            k = int(np.argmax(np.maximum(goal - self._chain.upper, self._chain.lower - goal)))
            joint = self._chain.joints[k]
            raise RefusedError(
                f"joint {joint.name} would go to {np.rad2deg(goal[k]):.1f} deg, its limits are "
                f"{np.rad2deg(joint.lower):.1f} to {np.rad2deg(joint.upper):.1f} deg; nothing has moved"
            )
        return goal

    def _checked_pose(self, T_base_gripper: Array) -> Array:
        T = se3.check(T_base_gripper, name="T_base_gripper")
        low = self.workspace.below_table(T)
        if low is not None:
            raise RefusedError(f"at this pose {low}; nothing has moved. Check the pose's z, and the tool's length")
        return T

    def _inverse(self, T_base_gripper: Array) -> Array:
        T = self._checked_pose(T_base_gripper)
        return nearest_joints(self._chain, T, self._command(), self._arm.home)

    def _need_answer(self) -> None:
        if not self._answers:
            raise DeviceError(f"{self.name} does not answer: it was switched off; nothing has moved")

    def _follow(self, path: Array, speed: float) -> None:
        """Run through joint values (m, n) without halting, slow at both ends, then stand still."""
        self._need_answer()
        if not 0 < speed <= 1:
            raise InputError(f"speed is a share of the limits, above 0 up to 1; got {speed}")
        self._twist = None
        reach = np.abs(np.diff(path, axis=0)) / (speed * self._arm.speeds)
        marks = np.concatenate([[0.0], np.cumsum(reach.max(axis=1, initial=0.0))])
        if marks[-1] > 0:
            side = np.sign(path[-1] - path[-2] if len(path) > 1 else 0.0)
            self._side = np.where(np.abs(path[-1] - path[0]) > 1e-9, side, self._side)
            self._draw_play()
            self._run(path, marks)
        self._stand_still(path[-1])

    def _run(self, path: Array, marks: Array) -> None:
        step = self._world.step_s
        keep = np.concatenate([[True], np.diff(marks) > 0])
        knots, values = marks[keep], path[keep]
        # The minimum-jerk profile: its peak speed is 1.875 of the mean, its peak acceleration 5.77 way / time^2.
        way = float(np.abs(np.diff(path, axis=0)).sum(axis=0).max())
        count = max(round(max(1.875 * marks[-1], np.sqrt(5.77 * way / _ACCELERATION)) / step), 25)
        s = np.arange(1, count + 1) / count
        along = marks[-1] * (10 * s**3 - 15 * s**4 + 6 * s**5)
        commands = np.column_stack([np.interp(along, knots, values[:, k]) for k in range(path.shape[1])])
        speeds = np.diff(np.vstack([path[:1], commands]), axis=0) / step
        data, rows = self._world.data, self._q_rows
        for k in range(count):
            self._send(commands[k], speeds[k])
            self._world.step()
            behind = np.abs(data.qpos[rows] - self._play - commands[k])
            if behind.max() > _LOST_RAD:
                joint = self._chain.joints[int(np.argmax(behind))].name
                self.stop()
                raise DeviceError(
                    f"{self.name} stopped by itself: {joint} was held back by {np.rad2deg(behind.max()):.1f} deg; "
                    "something is in the way. Free the arm, then go on from where it stands"
                )

    def _feel(self, behind: Array) -> None:
        """Stop where a joint is held. Raises: DeviceError naming it."""
        if behind.max() < _LOST_RAD:
            return
        joint = self._chain.joints[int(np.argmax(behind))].name
        self.stop()
        raise DeviceError(
            f"{self.name} stopped by itself: {joint} is held back by {np.rad2deg(behind.max()):.1f} deg: something is "
            "in the way. Free the arm, then go on from where it stands"
        )

    def _stand_still(self, goal: Array) -> None:
        """The controller's integral part takes the rest of the error away."""
        data, rows, speeds = self._world.data, self._q_rows, self._v_rows
        still = np.zeros(len(goal))
        for _ in range(400):
            error = goal + self._play - data.qpos[rows]
            if np.abs(error).max() < 2e-6 and np.abs(data.qvel[speeds]).max() < 2e-4:
                break
            self._feel(np.abs(error))
            # Bounded: a tool that presses on something is not driven into it.
            self._correction = np.clip(self._correction + 0.03 * error, -0.004, 0.004)
            self._send(goal, still)
            self._world.step()

    def _send(self, joints: Array, speed: Array) -> None:
        """Command the servos to encoder values (n,); they lead by the lag at this speed."""
        self._target = np.array(joints)
        self._world.data.ctrl[self._servos] = joints + self._play + self._correction + servo_lag_s() * speed

    def _draw_play(self) -> None:
        noise = self._rng.standard_normal(len(self._play))
        self._play = 0.5 * np.deg2rad(self._noise.backlash_deg) * self._side + self._repeat * noise

    def _joint_scatter(self) -> Array:
        """1 sigma of each joint (n,), equal for all: at rest, the flange then scatters by the repeatability along each
        axis: the mean over the axes of J_v J_v^T s^2 is sigma^2."""
        lever = self._chain.jacobian(self._arm.home)[3:]
        per_joint = np.sqrt(np.sum(lever**2) / 3)
        return np.full(len(self._play), 1e-3 * self._noise.repeatability_mm / per_joint)

    def _keep_moving(self, time_s: float) -> None:
        """At every step: the velocity asked for, within ranges and speeds, never below the table."""
        if self._twist is None:
            return
        step = self._world.step_s
        if self._ticks % _CONTROL_STEPS == 0:
            J = self._chain.jacobian(self._target)
            gram = J @ J.T + 1e-6 * np.eye(6)  # near a singular arm the motion is slow instead of wild
            rate = J.T @ np.linalg.solve(gram, self._twist)
            self._rate = rate / max(1.0, float(np.max(np.abs(rate) / self._arm.speeds)))
            ahead = self._target + _CONTROL_STEPS * step * self._rate
            self._low = self.workspace.below_table(self._chain.forward(ahead))
        self._ticks += 1
        rate, low = self._rate, self._low
        wanted = self._target + step * rate
        beyond = not self._chain.within_limits(wanted)
        if low is not None or beyond:
            self._twist = None
            self._send(self._target, np.zeros(len(rate)))
            self.fault = (
                f"the arm has stopped: further along this velocity {low}"
                if low is not None
                else "the arm has stopped at the end of a joint's range; drive back, or move to another pose"
            )
            return
        self._side = np.where(np.abs(rate) > 1e-6, np.sign(rate), self._side)
        self._send(wanted, rate)

    def _take_fault(self) -> str:
        said, self.fault = str(self.fault), None
        return said
