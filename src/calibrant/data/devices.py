"""What a robot and a camera are to the rest of the house, simulated or real: two small protocols, and what they give.

Verification, servoing and studies speak to these alone and never learn whether there is a simulator behind them. Time
is the devices' own: `Robot.time_s` and `Robot.wait` instead of a clock on the wall, so that a simulated second may take
less.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.errors import InputError


@dataclass(frozen=True, eq=False)
class Picture:
    """One moment of a camera: colour, depth where it has it, and when.

    name: of the picture, unique in its session; colour (h, w, 3) uint8, BGR; time_s: middle of the exposure, seconds on
    the robot's clock; depth (h, w) float32, metres along the depth camera's optical axis, NaN where there is none, in
    the grid of the depth camera, or None for a camera without depth.
    Raises: InputError for arrays of another shape or kind.

        >>> import numpy as np
        >>> from calibrant.data import Picture
        >>> Picture("0", np.zeros((480, 640, 3), np.uint8), 0.0).size
        (640, 480)
    """

    name: str
    colour: NDArray[np.uint8]
    time_s: float
    depth: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        if self.colour.ndim != 3 or self.colour.shape[2] != 3 or self.colour.dtype != np.uint8:
            raise InputError(
                f"picture {self.name}: colour is {self.colour.shape} of {self.colour.dtype}; expected (h, w, 3) of "
                "uint8: blue, green, red"
            )
        if self.depth is not None and (self.depth.ndim != 2 or not np.issubdtype(self.depth.dtype, np.floating)):
            raise InputError(
                f"picture {self.name}: depth is {self.depth.shape} of {self.depth.dtype}; expected (h, w) of float32, "
                "metres"
            )

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the colour picture."""
        return self.colour.shape[1], self.colour.shape[0]


@dataclass(frozen=True, eq=False)
class DeviceCalibration:
    """What a camera says of itself, before anybody calibrates it: the maker's figures.

    colour: intrinsics of the colour picture; depth: those of the depth picture, where it has a grid of its own;
    T_colour_depth (4, 4): from the depth camera's frame to the colour camera's, metres.
    """

    colour: Camera | None = None
    depth: Camera | None = None
    T_colour_depth: Array | None = None


class CameraSource(Protocol):
    """A camera that is asked for pictures."""

    @property
    def name(self) -> str:
        """Of the camera: "wrist", "front", …"""
        ...

    @property
    def stated(self) -> DeviceCalibration:
        """What the device says of its own lens; empty where it says nothing."""
        ...

    def take(self) -> Picture:
        """The next picture. Raises: DeviceError when the camera is gone or gives none."""
        ...

    def close(self) -> None:
        """Let go of the device; nothing happens the second time."""
        ...


@dataclass(frozen=True, eq=False)
class RobotLimits:
    """Where a robot may be: joint ranges (n, 2), speeds (n,); radians and rad/s, of sliding joints metres and m/s."""

    joints: Array
    speeds: Array


@dataclass(frozen=True)
class GripperState:
    """width_m: between the fingers now; holds: whether they stand against something."""

    width_m: float
    holds: bool


class Robot(Protocol):
    """An arm with a gripper, as controllers know it. Motions return when done; `speed` is a share of the limits.

    Motions raise: DeviceError when the robot stops answering or stops by itself, RefusedError for what it cannot reach;
    nothing has moved then but as far as the message says.
    """

    @property
    def name(self) -> str:
        """Of the robot, for people."""
        ...

    @property
    def moves_matter(self) -> bool:
        """Whether things and people could be hit: a person is asked before such a robot moves."""
        ...

    @property
    def limits(self) -> RobotLimits:
        """Joint ranges and speeds."""
        ...

    @property
    def time_s(self) -> float:
        """Seconds on the robot's clock."""
        ...

    def joints(self) -> Array:
        """(n,) as the controller reads them now, radians."""
        ...

    def pose(self) -> Array:
        """T_base_gripper (4, 4) as the controller says it now, metres: of the flange, without any tool."""
        ...

    def forward(self, joints: Array) -> Array:
        """T_base_gripper (4, 4) at these joints (n,), by the controller's own geometry."""
        ...

    def move_joints(self, joints: Array, *, speed: float = 0.3) -> None:
        """All joints together to (n,) radians."""
        ...

    def move_to(self, T_base_gripper: Array, *, speed: float = 0.3) -> None:
        """To a pose by any path (inverse kinematics, then joints)."""
        ...

    def move_line(self, T_base_gripper: Array, *, speed: float = 0.3) -> None:
        """To a pose along a straight line of the flange."""
        ...

    def drive(self, twist: Array, *, seconds: float) -> None:
        """Move the flange with a velocity for that long; it keeps it until the next call.

        twist (6,): rotation, then translation, rad/s and m/s, along the base's axes, of the flange's origin. Joint
        ranges and speeds are kept: a twist that they forbid is slowed down as a whole.
        """
        ...

    def grip(self, width_m: float) -> GripperState:
        """Open or close the fingers to a width; returns when they stand still."""
        ...

    def wait(self, seconds: float) -> None:
        """Let time pass, at rest."""
        ...

    def stop(self) -> None:
        """Stand still at once; never raises."""
        ...
