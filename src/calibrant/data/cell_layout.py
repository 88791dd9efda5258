"""Who stands where in a cell of cameras, robots and targets, as a result keeps it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class SigmaRobot:
    """Noise of the robot's poses, 1 sigma per axis, estimated from the data, with the sigma of the estimate."""

    mm: float
    deg: float
    mm_sigma: float | None = None
    deg_sigma: float | None = None


@dataclass(frozen=True)
class PictureList:
    """A list of pictures: the camera they are of, the robot at whose poses they were taken, who carries what.

    setup: eye-in-hand, eye-to-hand, standing, hand-to-hand, where robot `other` carries the target, or handheld, which
    knows no robot (an empty name).
    """

    camera: str
    robot: str
    setup: str
    target: str
    other: str = ""


@dataclass(frozen=True)
class CellLayout:
    """The lists of pictures of a cell, and the noise that was found by camera (pixels per axis) and by robot.

    sigma_px and sigma_robot are empty where there is one camera or one robot: then the result's own say it.
    sigma_joint_deg: noise of a joint's reading, by robot whose joints were free.
    """

    pictures: tuple[PictureList, ...]
    sigma_px: Mapping[str, float] = field(default_factory=dict)
    sigma_robot: Mapping[str, SigmaRobot] = field(default_factory=dict)
    sigma_joint_deg: Mapping[str, float] = field(default_factory=dict)
