"""The robot's motion in a bag: of a frame in another, or of a chain by its joint values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.tasks.options.bags import MovingBagOptions
from calibrant.tasks.options.robots import RobotOptions

if TYPE_CHECKING:
    from calibrant.arrays import Array
    from calibrant.formats.bags.joints import JointMotion
    from calibrant.geometry.motion import Motion


@dataclass(frozen=True, eq=False)
class RobotMotion:
    """motion: T_base_gripper over time, seconds since 1970; words: where it is from; joints: where it is from these."""

    motion: Motion
    words: str
    joints: JointMotion | None = None


def robot_motion(options: MovingBagOptions, arm: RobotOptions) -> RobotMotion:
    """The robot's motion in the bag.

    Raises: InputError where it is not said where the poses are (what there is, is listed), frames or joints that are
    not there, or a clock that jumps.
    """
    from calibrant.formats.bags.bag import JOINTS, TRANSFORMS, opened
    from calibrant.formats.bags.joints import read_joints
    from calibrant.formats.bags.transforms import read_tree
    from calibrant.geometry.motion import Motion

    if options.bag is None:
        raise InputError("no bag is given: --bag FILE")
    frames = options.frames
    with opened(options.bag.expanduser()) as bag:
        chain = arm.chain() if frames is None else None
        if chain is not None:
            joints = read_joints(bag, chain, options.joint_topic, stamps=options.stamps)
            return RobotMotion(Motion(joints.times, chain.forward(joints.q)), "joint values and --robot", joints)
        if frames is None:
            if not bag.of_kind(TRANSFORMS):
                what = (
                    "joint values: give the robot, --robot FILE"
                    if bag.of_kind(JOINTS)
                    else "neither tf nor joint values"
                )
                raise InputError(f"bag {bag.path}: where are the robot's poses? It has no tf, and {what}")
            tree = read_tree(bag)
            best = tree.proposal()
            proposed = f", perhaps --tf {best}" if best else ""
            raise InputError(
                f"bag {bag.path}: which frames are the robot's base and its flange? Say --tf BASE:TOOL{proposed}; its "
                f"frames are\n{tree.words()}"
            )
        motion = read_tree(bag).motion(*frames, stamps=options.stamps)
    return RobotMotion(motion, f"tf {frames[0]} to {frames[1]}")


def covered(robot: RobotMotion, seconds: Array, *, offset: float, what: str) -> Array:
    """Which moments of the camera lie within the robot's motion, (n,). Raises: InputError where none does."""
    there = robot.motion.covers(seconds + offset)
    if not there.any():
        times = robot.motion.times
        raise InputError(
            f"no picture of {what} was taken while the robot's poses were recorded ({robot.words}): pictures from "
            f"{seconds.min():.3f} s to {seconds.max():.3f} s, poses from {times[0]:.3f} s to {times[-1]:.3f} s since "
            "1970. Are the clocks set alike? Take the recorder's times for both (--stamps received), or give the "
            "offset (--clock-offset)"
        )
    return there
