"""A cell without pictures: an arm that moves by its kinematics, a camera whose features are projected and blurred.

It speaks the protocols of `data.devices`, on a clock of its own, thousands of times faster than one that renders. What
a picture would show is kept beside its name: `PointCamera.find` is the detector.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data.devices import DeviceCalibration, GripperState, Picture, RobotLimits
from calibrant.errors import DeviceError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.robots.chain import KinematicChain
from calibrant.robots.inverse import solve_inverse

TICK = 0.005
"""Seconds of one step of the clock."""
DAMPING = 1e-3


@dataclass(eq=False)
class KinematicArm:
    """An arm that follows at once and exactly, within its joints' ranges and speeds. start (n,): its joints.

    fails_at: seconds from which the controller does not answer; holds: what the fingers close on, asked at closing.
    """

    chain: KinematicChain
    start: Array
    top_speed: float = np.pi
    name: str = "kinematic arm"
    moves_matter: bool = False
    fails_at: float = inf
    close_s: float = 0.3
    holds: Callable[[Array, float], bool] = lambda T_base_gripper, time_s: False
    q: Array = field(init=False)
    twist: Array = field(init=False)
    clock: float = 0.0

    def __post_init__(self) -> None:
        self.q, self.twist = self.chain.check(self.start).copy(), np.zeros(6)

    @property
    def limits(self) -> RobotLimits:
        return RobotLimits(np.stack([self.chain.lower, self.chain.upper], axis=1), np.full(len(self.q), self.top_speed))

    @property
    def time_s(self) -> float:
        return self.clock

    def joints(self) -> Array:
        self._answer()
        return self.q.copy()

    def pose(self) -> Array:
        self._answer()
        return self.chain.forward(self.q)

    def forward(self, joints: Array) -> Array:
        return self.chain.forward(joints)

    def move_joints(self, joints: Array, *, speed: float = 0.3) -> None:
        self._answer()
        self.twist = np.zeros(6)
        self.clock += float(np.abs(joints - self.q).max() / (speed * self.top_speed))
        self.q = self.chain.check(joints).copy()

    def move_to(self, T_base_gripper: Array, *, speed: float = 0.3) -> None:
        found = solve_inverse(self.chain, T_base_gripper, self.q)
        if not bool(found.reached):
            raise RefusedError(f"the {self.name} does not reach the pose")
        self.move_joints(found.q, speed=speed)

    def move_line(self, T_base_gripper: Array, *, speed: float = 0.3) -> None:
        self.move_to(T_base_gripper, speed=speed)

    def drive(self, twist: Array, *, seconds: float) -> None:
        self._answer()
        self.twist = np.asarray(twist, dtype=np.float64).copy()
        self.pass_time(seconds)

    def grip(self, width_m: float) -> GripperState:
        self._answer()
        self.pass_time(self.close_s)
        held = self.holds(self.chain.forward(self.q), self.clock)
        return GripperState(0.04 if held else width_m, held)

    def wait(self, seconds: float) -> None:
        self._answer()
        self.twist = np.zeros(6)
        self.pass_time(seconds)

    def stop(self) -> None:
        self.twist = np.zeros(6)

    def pass_time(self, seconds: float) -> None:
        """The clock runs, and the arm goes on with the twist that it has."""
        end = self.clock + seconds
        while self.clock < end - 1e-9:
            h = min(TICK, end - self.clock)
            if self.twist.any():
                J = self.chain.jacobian(self.q)
                rates = J.T @ np.linalg.solve(J @ J.T + DAMPING**2 * np.eye(6), self.twist)
                rates /= max(1.0, float(np.abs(rates).max()) / self.top_speed)
                self.q = np.clip(self.q + h * rates, self.chain.lower, self.chain.upper)
            self.clock += h

    def _answer(self) -> None:
        if self.clock >= self.fails_at:
            raise DeviceError(f"the {self.name} does not answer since {self.fails_at:g} s")


@dataclass(eq=False)
class PointCamera:
    """A camera that sees the points (n, 3) of a target, with noise of sigma_px per axis; all of them, or none.

    place: T_base_camera now; target: T_base_target at a time; latency_s: how much later a picture is stamped than it
    was taken; a picture costs take_s of the arm's clock.
    """

    arm: KinematicArm
    camera: Camera
    points: Array
    place: Callable[[], Array]
    target: Callable[[float], Array]
    rng: np.random.Generator
    sigma_px: float = 0.1
    take_s: float = 0.02
    latency_s: float = 0.0
    name: str = "wrist"
    seen: dict[str, Array | None] = field(default_factory=dict)
    stated: DeviceCalibration = field(default_factory=DeviceCalibration)
    dark: NDArray[np.uint8] = field(init=False)

    def __post_init__(self) -> None:
        width, height = self.camera.image_size
        self.dark = np.zeros((height, width, 3), np.uint8)

    def take(self) -> Picture:
        t = self.arm.clock
        name = f"{self.name}-{len(self.seen)}"
        T = se3.inverse(self.place()) @ self.target(t)
        uv = self.camera.project(se3.apply(T, self.points))
        size = np.array(self.camera.image_size)
        whole = np.isfinite(uv).all() and bool(np.all((uv >= 0) & (uv <= size - 1)))
        self.seen[name] = uv + self.rng.normal(scale=self.sigma_px, size=uv.shape) if whole else None
        self.arm.pass_time(self.take_s)
        return Picture(name, self.dark, t + self.latency_s)

    def close(self) -> None:
        """Nothing to let go of."""

    def pixels(self, picture: Picture) -> Array | None:
        """What the picture shows of the points (n, 2); None where not all are in it."""
        return self.seen[picture.name]


def tilted(T: Array, rng: np.random.Generator, *, metres: float, degrees: float) -> Array:
    """A pose (4, 4) moved by exactly that far and turned by exactly that much, to any side."""
    turn, shift = rng.normal(size=3), rng.normal(size=3)
    omega = np.deg2rad(degrees) * turn / np.linalg.norm(turn)
    return se3.make(so3.exp(omega) @ T[:3, :3], T[:3, 3] + metres * shift / np.linalg.norm(shift))
