"""Options that say where robot poses are and how they are written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from calibrant.tasks.options.choices import ANGLES, ROTATIONS, TARGET_DIRECTIONS, UNITS
from calibrant.tasks.options.choices import DIRECTIONS as ROBOT_DIRECTIONS
from calibrant.tasks.options.option import Option

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from calibrant.formats.poses.read import RawPoses
    from calibrant.tasks.options.robots import RobotOptions

DIRECTIONS = ("auto", "camera-target", "target-camera")
"""Of target poses."""


@dataclass(frozen=True, kw_only=True)
class NotationOptions:
    """How poses are written; auto: decided from the data."""

    pose_units: Annotated[str, Option("UNIT", choices=UNITS)] = "auto"
    """Unit of positions: auto, m, mm, cm or in."""
    pose_rotation: Annotated[str, Option("FORM", choices=ROTATIONS)] = "auto"
    """auto, quat-xyzw, quat-wxyz, rotvec, euler:ZYX, euler:xyz …, matrix."""
    pose_angle: Annotated[str, Option("UNIT", choices=ANGLES)] = "auto"
    """auto, deg or rad."""


@dataclass(frozen=True, kw_only=True)
class PoseOptions(NotationOptions):
    """How robot poses are written; auto: decided from the data."""

    pose_direction: Annotated[str, Option("NAME", choices=ROBOT_DIRECTIONS)] = "auto"
    """auto, base-gripper or gripper-base."""

    def read(self, files: Sequence[str], arm: RobotOptions) -> RawPoses:
        """The poses of the files. Raises: InputError as `read_poses`."""
        from calibrant.formats.poses.read import read_poses

        return read_poses(
            list(files), units=self.pose_units, rotation=self.pose_rotation, angle=self.pose_angle,
            direction=self.pose_direction, robot=arm.chain(), joint_angle=arm.joint_angle, maker=arm.robot_format,
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class TouchPoseOptions(PoseOptions):
    """How robot poses are written in which a tool touches a point."""

    pose_direction: Annotated[str, Option("NAME", choices=ROBOT_DIRECTIONS[1:])] = "base-gripper"
    """base-gripper or gripper-base: inverted poses close as well."""


@dataclass(frozen=True, kw_only=True)
class TargetPoseOptions:
    """Measured poses of the target in place of photos."""

    target_poses: Annotated[tuple[str, ...], Option("FILES")] = ()
    """Poses of the target in the camera, instead of photos."""
    target_pose_rotation: Annotated[str, Option("FORM", choices=ROTATIONS)] = "auto"
    """How the rotations of --target-poses are written, where the data cannot tell: as --pose-rotation."""
    target_pose_direction: Annotated[str, Option("NAME", choices=TARGET_DIRECTIONS)] = "auto"
    """auto (camera-target, doubted where no camera could see it), camera-target (T_camera_target) or target-camera."""
    target_scale: Annotated[str, Option("NUMBER")] = "1"
    """What the target's lengths are multiplied by; free: found by the robot's motion (tracks of unknown scale)."""

    @property
    def free_scale(self) -> bool:
        """Whether the target's scale is to be found."""
        return self.target_scale == "free"

    @property
    def scale(self) -> float:
        """What the target's lengths are multiplied by; 1 where that is to be found. Raises: InputError."""
        from calibrant.errors import InputError

        if self.free_scale:
            return 1.0
        try:
            value = float(self.target_scale)
        except ValueError:
            value = float("nan")
        if not 0 < value < float("inf"):
            raise InputError(f"--target-scale {self.target_scale}: give a positive number, or free")
        return value

    def check(self) -> None:
        """Raises: InputError for a direction that there is not, or a scale that is none."""
        from calibrant.errors import InputError

        if self.target_pose_direction not in DIRECTIONS:
            raise InputError(
                f"--target-pose-direction {self.target_pose_direction}: choose {', '.join(DIRECTIONS[:-1])} or "
                f"{DIRECTIONS[-1]}"
            )
        _ = self.scale

    def as_camera_target(self, T: NDArray) -> NDArray:
        """T_camera_target of poses (n, 4, 4) in the direction and at the scale that were said."""
        from calibrant.geometry import se3

        out = se3.inverse(T) if self.target_pose_direction == "target-camera" else T.copy()
        out[:, :3, 3] *= self.scale
        return out
