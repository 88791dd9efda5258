"""A fake of panda-py 1: Panda, controllers.IntegratedVelocity, libfranka.Gripper as documented, over an exact arm."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.devices.fake_clock import FakeClock

from calibrant.geometry import rotations, se3
from calibrant.robots.arms import arm

HOME = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])
HAND = se3.make(rotations.matrix_from_rotation_vector([0, 0, -np.pi / 4], unit="rad"), [0.0, 0.0, 0.1034])


class Controller:
    """The arm: waypoints are reached at once, velocities are followed as time passes."""

    def __init__(self, clock: FakeClock) -> None:
        self.chain, self.q, self.width, self.object_m = arm("panda"), HOME.copy(), 0.08, 0.0
        self.velocity: IntegratedVelocity | None = None
        self.error: str | None = None
        self.held = False
        self.waypoints: list[NDArray] = []
        self.speeds: list[float] = []
        self.clock = clock
        clock.movers.append(self.step)

    def step(self, seconds: float) -> None:
        if self.velocity is not None and self.error is None:
            self.q = self.q + seconds * self.velocity.qd

    def fail(self) -> None:
        if self.error is not None:
            raise RuntimeError(f"libfranka: {self.error}")


class IntegratedVelocity:
    def __init__(self, stiffness=None, damping=None) -> None:
        self.qd = np.zeros(7)

    def set_control(self, velocity) -> None:
        assert np.shape(velocity) == (7,)
        self.qd = np.array(velocity, dtype=float)

    def get_qd(self) -> NDArray:
        return self.qd


def make_modules(controller: Controller) -> list[ModuleType]:
    """panda_py, panda_py.controllers, panda_py.libfranka."""

    class Panda:
        def __init__(self, hostname: str, name: str = "panda", realtime_config: int = 1) -> None:
            if hostname == "nobody":
                raise RuntimeError("libfranka: Connection to FCI refused. Please enable FCI mode in Desk.")

        def get_state(self):
            controller.fail()
            O_T_EE = controller.chain.forward(controller.q) @ HAND
            return SimpleNamespace(
                q=controller.q.tolist(), O_T_EE=O_T_EE.ravel("F").tolist(), F_T_EE=HAND.ravel("F").tolist()
            )

        def raise_error(self) -> None:
            controller.fail()

        def start_controller(self, controller_: IntegratedVelocity) -> None:
            controller.fail()
            controller.velocity = controller_

        def stop_controller(self) -> None:
            controller.velocity = None

        def move_to_joint_position(self, waypoints, speed_factor: float = 0.2, stiffness=None, damping=None,
                                   dq_threshold: float = 0.001, success_threshold: float = 0.01) -> bool:  # fmt: skip
            controller.fail()
            controller.waypoints = [np.array(w) for w in waypoints]
            controller.speeds.append(speed_factor)
            if controller.held:
                return False
            controller.q = controller.waypoints[-1].copy()
            controller.clock.pass_time(1.0)
            return True

    class Gripper:
        def __init__(self, franka_address: str) -> None:
            if franka_address == "nobody":
                raise RuntimeError("libfranka: Connection refused")

        def read_once(self):
            return SimpleNamespace(width=controller.width, is_grasped=controller.object_m > 0, max_width=0.08)

        def move(self, width: float, speed: float) -> bool:
            controller.width = width
            return True

        def grasp(self, width: float, speed: float, force: float, epsilon_inner: float = 0.005,
                  epsilon_outer: float = 0.005) -> bool:  # fmt: skip
            controller.width = max(width, controller.object_m)
            return width - epsilon_inner <= controller.width <= width + epsilon_outer

    library, controllers, libfranka = (
        ModuleType(name) for name in ("panda_py", "panda_py.controllers", "panda_py.libfranka")
    )
    library.Panda, controllers.IntegratedVelocity, libfranka.Gripper = Panda, IntegratedVelocity, Gripper
    return [library, controllers, libfranka]


def installed(monkeypatch: pytest.MonkeyPatch, clock: FakeClock) -> Controller:
    """The fake in place of the library."""
    controller = Controller(clock)
    for module in make_modules(controller):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    return controller
