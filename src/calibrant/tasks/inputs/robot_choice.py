"""The robot that a command's poses come from, where they are joint values, and the maker's way to write poses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError

if TYPE_CHECKING:
    from calibrant.robots.geometry import ParametricChain


@dataclass(frozen=True)
class RobotChoice:
    """The options --robot, --robot-link, --robot-base, --joint-angle and --robot-format, as given."""

    robot: str | None = None
    link: str | None = None
    base: str | None = None
    joint_angle: str = "auto"
    maker: str | None = None

    def chain(self) -> ParametricChain | None:
        """The robot's chain, or None where none is given. Raises: InputError as `read_robot`."""
        if self.robot is None:
            given = {"--robot-link": self.link is not None, "--robot-base": self.base is not None}
            given["--joint-angle"] = self.joint_angle != "auto"
            alone = [option for option, there in given.items() if there]
            if alone:
                raise InputError(f"{alone[0]} says something about a robot: give it (--robot FILE)")
            return None
        if self.maker is not None:
            raise InputError("--robot reads joint values, --robot-format reads poses; give one of them")
        from calibrant.formats.robots.read import read_robot

        return read_robot(self.robot, link=self.link, base=self.base).chain

    @property
    def files(self) -> list[str]:
        """The robot's file, where it is one."""
        return [self.robot] if self.robot is not None and Path(self.robot).exists() else []
