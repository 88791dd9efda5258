"""Pictures of a bag and the robot's pose at each, as the lists of hand-eye take them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from calibrant.tasks.inputs.bags.motion import RobotMotion, covered, robot_motion
from calibrant.tasks.inputs.bags.topics import Recorded, recorded_pictures
from calibrant.tasks.options.bags import PosedBagOptions
from calibrant.tasks.options.robots import RobotOptions

if TYPE_CHECKING:
    from calibrant.arrays import Array
    from calibrant.formats.poses.read import RawPoses


@dataclass(frozen=True, eq=False)
class PosedPictures:
    """pictures, by camera; T_base_gripper (n, 4, 4) by camera; robot: its whole motion; words: how moments were
    found."""

    pictures: Mapping[str, Recorded]
    T_base_gripper: Mapping[str, Array]
    robot: RobotMotion
    words: str

    def raw(self) -> RawPoses:
        """Every pose, named as its picture, as if a file had them in metres as matrices."""
        import numpy as np

        from calibrant.formats.poses.raw import PoseOptions, RawPoses, Stated

        T = np.concatenate(list(self.T_base_gripper.values()))
        names = tuple(f.name for p in self.pictures.values() for f in p.files)
        times = np.concatenate([p.seconds for p in self.pictures.values()])
        return RawPoses(
            T[:, :3, 3].copy(),
            T[:, :3, :3].copy(),
            names,
            tuple(f"{self.robot.words}, picture {name}" for name in names),
            Stated(units="m", rotation="matrix", direction="base-gripper"),
            PoseOptions(units="m", rotation="matrix", direction="base-gripper"),
            self.robot.words,
            times=times,
            joints=None if self.robot.joints is None else self.robot.joints.at(times),
        )

    def shifted(self, offset: float) -> PosedPictures:
        """With the poses at the pictures' times and so much more, seconds, by the smooth motion through all samples."""
        from calibrant.calibrate.clocks.start import PoseSpline

        motion = self.robot.motion
        origin = float(motion.times[0])
        spline = PoseSpline(motion.times - origin, motion.T)
        inside = {
            name: p.only([int(i) for i in covered_at(self.robot, p, offset).nonzero()[0]])
            for name, p in self.pictures.items()
        }
        T = {name: spline.pose(p.seconds + offset - origin) for name, p in inside.items()}
        return replace(self, pictures=inside, T_base_gripper=T)


def covered_at(robot: RobotMotion, recorded: Recorded, offset: float) -> Array:
    """Which pictures lie within the robot's motion. Raises: InputError where none does."""
    return covered(robot, recorded.seconds, offset=offset, what=recorded.topic)


def posed_pictures(options: PosedBagOptions, arm: RobotOptions) -> PosedPictures:
    """The pictures of a bag that count, each with the robot's pose.

    On the move these are all within the motion, at the offset that is given, 0 else: `moving_pictures` finds it.
    Raises: InputError, RefusedError as the parts do.
    """
    from calibrant.tasks.inputs.bags.moments import still_pictures

    options.check()
    recorded = recorded_pictures(options)
    robot = robot_motion(options, arm)
    offset = options.offset_s or 0.0
    if options.moments == "moving":
        every = PosedPictures(recorded, {}, robot, f"pictures on the move, {robot.words}")
        return every.shifted(offset)
    found = {name: still_pictures(robot, p, offset=offset) for name, p in recorded.items()}
    words = "; ".join(f"{name}: {s.words}" if name else s.words for name, s in found.items())
    return PosedPictures(
        {name: s.pictures for name, s in found.items()}, {name: s.T for name, s in found.items()}, robot, words
    )
