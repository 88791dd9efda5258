"""Options that say what of a bag is read: a recording of ROS 1 or ROS 2, in place of photos and files of poses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from calibrant.errors import InputError
from calibrant.tasks.options.option import Option

STAMPS = ("header", "received")
MOMENTS = ("still", "moving")


@dataclass(frozen=True, kw_only=True)
class BagOptions:
    """A bag, and which of its topics are the cameras'."""

    bag: Annotated[Path | None, Option("FILE")] = None
    """A recording in place of photos: .bag (ROS 1), .mcap, .db3 or their folder (ROS 2). No ROS is needed."""
    image_topic: Annotated[tuple[str, ...], Option("TOPIC")] = ()
    """The topic of the pictures in the bag; of several cameras: NAME=TOPIC for each. Without it the only one."""
    stamps: Annotated[str, Option("header|received", choices=STAMPS)] = "header"
    """Times of the bag's messages: what their headers say, or when they were received, for clocks that are wrong."""

    def check(self) -> None:
        """Raises: InputError for options of a bag without one, and a word that is none."""
        if self.stamps not in STAMPS:
            raise InputError(f"--stamps {self.stamps}: choose {' or '.join(STAMPS)}")
        if self.bag is None and self.image_topic:
            raise InputError(f"--image-topic {self.image_topic[0]} names pictures in a bag: give it (--bag FILE)")
        if self.bag is None and self.stamps != STAMPS[0]:
            raise InputError("--stamps says which times of a bag count: give it (--bag FILE)")


@dataclass(frozen=True, kw_only=True)
class MovingBagOptions(BagOptions):
    """A bag with a robot's motion in it."""

    tf: Annotated[str | None, Option("BASE:TOOL")] = None
    """The robot's poses in the bag: its base's and its flange's frame, base_link:tool0. With --robot, without this:
    from the joint values."""
    joint_topic: Annotated[str | None, Option("TOPIC")] = None
    """With --robot: the topic of the joint values in the bag, where there are several."""

    def check(self) -> None:
        """Raises: InputError as `BagOptions.check`."""
        super().check()
        for option, value in (("--tf", self.tf), ("--joint-topic", self.joint_topic)):
            if self.bag is None and value is not None:
                raise InputError(f"{option} {value} names what is in a bag: give it (--bag FILE)")
        if self.tf is not None and self.joint_topic is not None:
            raise InputError("--tf and --joint-topic both say where the robot's poses are; give one of them")
        _ = self.frames

    @property
    def frames(self) -> tuple[str, str] | None:
        """Base and tool. Raises: InputError for other than two names."""
        if self.tf is None:
            return None
        base, colon, tool = self.tf.partition(":")
        if not (base.strip() and colon and tool.strip()):
            raise InputError(
                f"--tf takes two frames, the robot's base and its flange, as base_link:tool0; got {self.tf!r}"
            )
        return base.strip().lstrip("/"), tool.strip().lstrip("/")


@dataclass(frozen=True, kw_only=True)
class PosedBagOptions(MovingBagOptions):
    """A bag whose pictures are paired with the robot's poses."""

    moments: Annotated[str, Option("still|moving", choices=MOMENTS)] = "still"
    """Which pictures of the bag count: one of each moment in which robot and picture stand still; or those on the move,
    for which the offset of the clocks is found."""
    clock_offset: Annotated[str | None, Option("TIME")] = None
    """What is added to the times of the bag's pictures to be the robot's, where it is known: 37ms."""

    def check(self) -> None:
        """Raises: InputError as `MovingBagOptions.check`."""
        super().check()
        if self.moments not in MOMENTS:
            raise InputError(f"--moments {self.moments}: choose {' or '.join(MOMENTS)}")
        if self.bag is None and (self.moments != MOMENTS[0] or self.clock_offset is not None):
            raise InputError("--moments and --clock-offset are about pictures in a bag: give it (--bag FILE)")
        _ = self.offset_s

    @property
    def offset_s(self) -> float | None:
        """Seconds; None where it is not known. Raises: InputError for a time without a unit."""
        if self.clock_offset is None:
            return None
        text = self.clock_offset.strip()
        unit = next((u for u in ("ms", "us", "s") if text.endswith(u)), None)
        try:
            value = float(text.removesuffix(unit or ""))
        except ValueError:
            value = float("nan")
        if unit is None or not abs(value) < 1e9:
            raise InputError(f"--clock-offset takes a time with its unit, such as 37ms or -0.02s; got {text!r}")
        return value * {"ms": 1e-3, "us": 1e-6, "s": 1.0}[unit]
