"""Options that name the robot whose joint values or poses are read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calibrant.errors import InputError
from calibrant.tasks.options.choices import ANGLES, MAKERS
from calibrant.tasks.options.option import Option

if TYPE_CHECKING:
    from calibrant.robots.geometry import ParametricChain


@dataclass(frozen=True, kw_only=True)
class RobotOptions:
    """The robot, where its poses are joint values, and the maker's way to write poses."""

    robot_format: Annotated[str | None, Option("MAKER", choices=MAKERS)] = None
    """How poses are written: ur, franka, kuka, fanuc, abb, yaskawa, staubli, kawasaki."""
    robot: Annotated[str | None, Option("FILE")] = None
    """The robot, where joint values are given: URDF, DH table (YAML), or a name such as ur5e."""
    robot_link: Annotated[str | None, Option("NAME")] = None
    """URDF: the link that ends the chain."""
    robot_base: Annotated[str | None, Option("NAME")] = None
    """URDF: the link that starts the chain."""
    joint_angle: Annotated[str, Option("UNIT", choices=ANGLES)] = "auto"
    """auto (by the limits), deg or rad."""

    def chain(self) -> ParametricChain | None:
        """The robot's chain, or None where none is given. Raises: InputError as `read_robot`."""
        if self.robot is None:
            given = {"--robot-link": self.robot_link is not None, "--robot-base": self.robot_base is not None}
            given["--joint-angle"] = self.joint_angle != "auto"
            alone = [option for option, there in given.items() if there]
            if alone:
                raise InputError(f"{alone[0]} says something about a robot: give it (--robot FILE)")
            return None
        if self.robot_format is not None:
            raise InputError("--robot reads joint values, --robot-format reads poses; give one of them")
        from calibrant.formats.robots.read import read_robot

        return read_robot(self.robot, link=self.robot_link, base=self.robot_base).chain

    @property
    def files(self) -> list[str]:
        """The robot's file, where it is one."""
        return [self.robot] if self.robot is not None and Path(self.robot).exists() else []
