"""A fake of ur_rtde 1.6: rtde_control and rtde_receive as documented, over a UR5e that follows its commands exactly.

Names, order and defaults of parameters are those of the library's Python bindings.
"""

from __future__ import annotations

import sys
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.devices.fake_clock import FakeClock

from calibrant.geometry import rotations, se3
from calibrant.robots.arms import arm
from calibrant.robots.inverse import solve_inverse
from calibrant.robots.paths import line_path

HOME = np.deg2rad([180.0, -100.0, 110.0, -100.0, -90.0, 0.0])
TOOL = se3.make(rotations.matrix_from_rotation_vector([0.1, -0.2, 0.3], unit="rad"), [0.01, 0.02, 0.15])


class Controller:
    """The arm behind both interfaces."""

    def __init__(self, clock: FakeClock) -> None:
        self.chain, self.q, self.qd = arm("ur5e"), HOME.copy(), np.zeros(6)
        self.way: list[NDArray] = []
        self.rate = 1.0
        self.twist: NDArray | None = None
        self.connected, self.emergency, self.protective, self.held, self.remote = True, False, False, False, True
        self.sent: list[str] = []
        clock.movers.append(self.step)

    def tool(self, q: NDArray) -> NDArray:
        return self.chain.forward(q) @ TOOL

    def step(self, seconds: float) -> None:
        before = self.q.copy()
        if not (self.protective or self.emergency or self.held):
            if self.twist is not None:
                T = self.tool(self.q)
                T[:3, 3] += seconds * self.twist[:3]
                T[:3, :3] = rotations.matrix_from_rotation_vector(seconds * self.twist[3:], unit="rad") @ T[:3, :3]
                self.q = solve_inverse(self.chain, T @ se3.inverse(TOOL), self.q).q
            elif self.way:
                self._along(seconds)
        self.qd = (self.q - before) / seconds if seconds > 0 else self.qd

    def _along(self, seconds: float) -> None:
        left = seconds * self.rate
        while self.way and left > 0:
            to_go = float(np.abs(self.way[0] - self.q).max())
            if to_go <= left:
                self.q, left = self.way.pop(0).copy(), left - to_go
            else:
                self.q = self.q + left / to_go * (self.way[0] - self.q)
                left = 0.0


def make_modules(controller: Controller) -> tuple[ModuleType, ModuleType]:
    """rtde_control and rtde_receive."""

    class RTDEControlInterface:
        def __init__(self, hostname: str, frequency: float = -1.0, flags: int = 1, ur_cap_port: int = 50002,
                     rt_priority: int = 0) -> None:  # fmt: skip
            if hostname == "nobody":
                raise RuntimeError("Error: Could not connect to: nobody at 30004, verify the IP")

        def _takes(self, name: str) -> bool:
            controller.sent.append(name)
            if not controller.connected:
                raise RuntimeError("RTDE control script is not running!")
            return controller.remote and not controller.protective

        def moveJ(self, q, speed: float = 1.05, acceleration: float = 1.4, asynchronous: bool = False) -> bool:
            assert asynchronous, "a motion is watched"
            if self._takes("moveJ"):
                controller.way, controller.rate = [np.array(q)], speed
                return True
            return False

        def moveL(self, pose, speed: float = 0.25, acceleration: float = 1.2, asynchronous: bool = False) -> bool:
            assert asynchronous, "a motion is watched"
            if self._takes("moveL"):
                controller.way = list(line_path(controller.chain, controller.q, matrix(pose) @ se3.inverse(TOOL)))
                controller.rate = speed
                return True
            return False

        def speedL(self, xd, acceleration: float = 0.25, time: float = 0.0) -> bool:
            if self._takes("speedL"):
                controller.twist = np.array(xd)
                return True
            return False

        def speedStop(self, a: float = 10.0) -> bool:
            self._takes("speedStop")
            controller.twist = None
            return True

        def stopJ(self, a: float = 2.0, asynchronous: bool = False) -> None:
            self._takes("stopJ")
            controller.way, controller.twist = [], None

        def stopScript(self) -> None:
            self._takes("stopScript")

        def getForwardKinematics(self, q=(), tcp_offset=()):
            tool = matrix(tcp_offset) if len(tcp_offset) else TOOL
            return pose_of(controller.chain.forward(np.array(q) if len(q) else controller.q) @ tool)

        def getInverseKinematics(self, x, qnear=(), max_position_error: float = 1e-10,
                                 max_orientation_error: float = 1e-10):  # fmt: skip
            found = solve_inverse(controller.chain, matrix(x) @ se3.inverse(TOOL), np.array(qnear))
            return found.q.tolist() if found.reached else []

        def isPoseWithinSafetyLimits(self, pose) -> bool:
            return bool(np.linalg.norm((matrix(pose) @ se3.inverse(TOOL))[:3, 3]) < 0.9)

        def isJointsWithinSafetyLimits(self, q) -> bool:
            return bool(np.abs(q).max() < 2 * np.pi)

        def getTCPOffset(self):
            return pose_of(TOOL)

        def disconnect(self) -> None:
            controller.connected = False

    class RTDEReceiveInterface:
        def __init__(self, hostname: str, frequency: float = -1.0, variables=(), verbose: bool = False,
                     use_upper_range_registers: bool = False, rt_priority: int = 0) -> None:  # fmt: skip
            if hostname == "nobody":
                raise RuntimeError("Error: Could not connect to: nobody at 30004, verify the IP")

        def getActualQ(self):
            return controller.q.tolist()

        def getActualQd(self):
            return controller.qd.tolist()

        def getActualTCPPose(self):
            return pose_of(controller.tool(controller.q))

        def isConnected(self) -> bool:
            return controller.connected

        def isEmergencyStopped(self) -> bool:
            return controller.emergency

        def isProtectiveStopped(self) -> bool:
            return controller.protective

        def disconnect(self) -> None:
            controller.connected = False

    control, receive = ModuleType("rtde_control"), ModuleType("rtde_receive")
    control.RTDEControlInterface = RTDEControlInterface
    receive.RTDEReceiveInterface = RTDEReceiveInterface
    return control, receive


def installed(monkeypatch: pytest.MonkeyPatch, clock: FakeClock) -> Controller:
    """The fake in place of the library."""
    controller = Controller(clock)
    for module in make_modules(controller):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    return controller


def matrix(pose) -> NDArray:
    return se3.make(rotations.matrix_from_rotation_vector(np.array(pose[3:]), unit="rad"), np.array(pose[:3]))


def pose_of(T: NDArray) -> list[float]:
    return [*map(float, T[:3, 3]), *map(float, rotations.rotation_vector_from_matrix(T[:3, :3], unit="rad"))]
