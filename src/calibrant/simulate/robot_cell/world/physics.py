"""The running world: time, bodies by name, what happens at every step."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.errors import DeviceError, InputError
from calibrant.geometry import so3
from calibrant.simulate.robot_cell.world.engine import need_mujoco, pose_of

if TYPE_CHECKING:
    import mujoco

_PARKING = np.array([-1.4, -2.4, -0.70])
"""Where things are that are not in the cell: on the room's floor behind the arm, hidden, a step apart."""
_BELT_PERIOD = 0.5
"""Metres after which the belt is set back: it looks and feels the same everywhere."""


def _said_by_step(_: str) -> None:
    """A warning of MuJoCo's."""


class World:
    """A MuJoCo model in motion. Bodies, joints and geoms are asked for by name."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._mujoco = need_mujoco()
        # MuJoCo would write its warnings to a file in the working directory; `step` looks for what they warn of.
        self._mujoco.set_mju_user_warning(_said_by_step)
        self.model = model
        self.data = self._mujoco.MjData(model)
        self.belt_speed = 0.0
        self._hooks: list[Callable[[float], None]] = []
        self._absent: dict[str, float] = {}
        self._parked = 0
        self._behind = False

    @property
    def time_s(self) -> float:
        """Seconds since the world began."""
        return float(self.data.time)

    @property
    def step_s(self) -> float:
        """Of one step."""
        return float(self.model.opt.timestep)

    def step(self) -> None:
        """One step of physics, then what was asked for at every step."""
        if self.belt_speed:
            self._run_belt()
        before = self.data.time
        self._mujoco.mj_step(self.model, self.data)
        if self.data.time <= before:  # MuJoCo has set the world back to its beginning
            raise DeviceError(
                f"the simulated cell came apart after {before:.2f} s: something was placed inside another thing, or "
                "moved by force; make the cell anew"
            )
        self._behind = True
        for hook in self._hooks:
            hook(self.time_s)

    def wait(self, seconds: float) -> None:
        """Steps until that much time has passed, to the nearest step."""
        for _ in range(round(seconds / self.step_s)):
            self.step()

    def at_every_step(self, hook: Callable[[float], None]) -> None:
        """Call hook(time_s) after every step."""
        self._hooks.append(hook)

    def settle(self) -> None:
        """Poses follow from joints, without time passing."""
        self._behind = True
        self.catch_up()

    def catch_up(self) -> None:
        """After a step MuJoCo's places are those before it, its joints those after: bring the places up to now."""
        if self._behind:
            self._mujoco.mj_kinematics(self.model, self.data)
            self._behind = False

    def pose(self, body: str) -> Array:
        """T_base_body (4, 4) now. Raises: InputError for a name that is none."""
        self.catch_up()
        b = self._body(body)
        return pose_of(self.data.xpos[b], self.data.xquat[b])

    def put(self, body: str, T_base_body: Array) -> None:
        """Place a free or held body, at rest; it is in the cell then."""
        if body in self._absent:
            self._show(body, self._absent.pop(body))
        self._set(body, T_base_body)
        self.settle()

    def spin(self, body: str, rad_s: float) -> None:
        """Give a free body a turn about the vertical, rad/s; its other speeds stay."""
        joint = self.model.joint(body)
        speed = int(joint.dofadr[0])
        R = pose_of(self.data.xpos[self._body(body)], self.data.xquat[self._body(body)])[:3, :3]
        # A free joint turns about the body's own axes.
        own = self.data.qvel[speed + 3 : speed + 6].copy()
        up = R.T @ np.array([0.0, 0.0, 1.0])
        self.data.qvel[speed + 3 : speed + 6] = own + (rad_s - own @ up) * up

    def take_away(self, body: str) -> None:
        """Hide a body and park it; nothing happens when it is away."""
        if body in self._absent:
            return
        self._absent[body] = float(self.model.geom_rgba[self._geom(body), 3])
        self._show(body, 0.0)
        T = np.eye(4)
        T[:3, 3] = _PARKING
        T[1, 3] += 0.3 * self._parked
        self._parked += 1
        self._set(body, T)
        self.settle()

    def is_present(self, body: str) -> bool:
        """Whether a thing is in the cell."""
        return body not in self._absent

    def show(self, geom: str, *, visible: bool) -> None:
        """Show or hide a geom that touches nothing."""
        self.model.geom_rgba[self._geom(geom), 3] = float(visible)

    def joint_rows(self, names: list[str]) -> tuple[Array, Array, Array]:
        """Rows in qpos, in qvel and in ctrl of the joints of these servos."""
        model = self.model
        servos = np.array([model.actuator(n).id for n in names])
        joints = model.actuator_trnid[servos, 0]
        return model.jnt_qposadr[joints].copy(), model.jnt_dofadr[joints].copy(), servos

    def _show(self, body: str, alpha: float) -> None:
        self.model.geom_rgba[self._geom(body), 3] = alpha

    def _set(self, body: str, T: Array) -> None:
        b = self._body(body)
        q = so3.quaternion_wxyz(T[:3, :3])
        mocap = int(self.model.body_mocapid[b])
        if mocap >= 0:
            self.data.mocap_pos[mocap], self.data.mocap_quat[mocap] = T[:3, 3], q
            return
        joint = self.model.joint(body)
        at, speed = int(joint.qposadr[0]), int(joint.dofadr[0])
        self.data.qpos[at : at + 7] = np.concatenate([T[:3, 3], q])
        self.data.qvel[speed : speed + 6] = 0.0

    def _body(self, name: str) -> int:
        b = self._mujoco.mj_name2id(self.model, self._mujoco.mjtObj.mjOBJ_BODY, name)
        if b < 0:
            raise InputError(f"there is nothing called {name!r} in the cell")
        return int(b)

    def _geom(self, name: str) -> int:
        return int(self.model.geom(name).id)

    def _run_belt(self) -> None:
        joint = self.model.joint("belt")
        at, speed = int(joint.qposadr[0]), int(joint.dofadr[0])
        self.data.qvel[speed] = self.belt_speed
        if abs(self.data.qpos[at]) > _BELT_PERIOD:
            self.data.qpos[at] -= np.sign(self.data.qpos[at]) * _BELT_PERIOD
