"""The offset between the clocks of a bag's camera and robot, from pictures of a board on the move."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from calibrant.errors import InputError, RefusedError
from calibrant.tasks.inputs.bags.motion import RobotMotion
from calibrant.tasks.inputs.bags.topics import Recorded

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibrant.arrays import Array
    from calibrant.calibrate.clocks.offset import TimeOffset
    from calibrant.cameras import Camera
    from calibrant.data import Observations, View

LEAST_HZ, MOST = 10.0, 600
"""Of more pictures than these every n-th is searched, as long as so many a second are left: turns are compared over a
tenth of a second."""


@dataclass(frozen=True, eq=False)
class SeenMotion:
    """times (n,), seconds since 1970, and T_camera_target (n, 4, 4) of the pictures that show the board, in views (n,),
    to the camera."""

    times: Array
    T: Array
    camera: Camera
    views: tuple[View, ...] = ()

    def by(self, camera: Camera) -> Array:
        """T_camera_target (n, 4, 4) by another camera."""
        from calibrant.calibrate.pose.target_poses import target_poses

        return target_poses(camera, list(self.views)).T_camera_target


def thinned(recorded: Recorded) -> Recorded:
    """Every n-th of many pictures."""
    n = len(recorded.files)
    if n <= MOST:
        return recorded
    lasted = float(recorded.seconds[-1] - recorded.seconds[0])
    every = min(-(-n // MOST), int(max(1.0, n / max(lasted, 1e-9) // LEAST_HZ)))
    return recorded.only(range(0, n, max(1, every)))


def seen_motion(
    found: Observations, recorded: Recorded, camera: Camera | None, model: str, fix: Sequence[str]
) -> SeenMotion:
    """The board's motion in the camera. Without the camera its pictures calibrate it first.

    Raises: RefusedError where no picture shows enough of the board.
    """
    import numpy as np

    from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
    from calibrant.calibrate.pose.target_poses import determine_a_pose, target_poses

    lens = camera or calibrate_keeping(found, model=model, fix=fix).result.camera
    views = [v for v, enough in zip(found.views, determine_a_pose(lens, found.views)) if enough]
    if not views:
        raise RefusedError(f"no picture of {recorded.topic} shows enough of the board to say where it is")
    at = {str(file): t for file, t in zip(recorded.files, recorded.seconds)}
    times = np.array([at[str(v.file)] for v in views])
    T = target_poses(lens, views).T_camera_target
    order = np.argsort(times, kind="stable")
    times, first = np.unique(times[order], return_index=True)
    kept = [int(i) for i in order[first]]
    return SeenMotion(times, T[kept], lens, tuple(views[i] for i in kept))


def clock_offset(robot: RobotMotion, seen: SeenMotion, *, setup: str, largest: float) -> tuple[TimeOffset, str]:
    """The offset, what an error of the lens does to it in its sigma, and the setup it was found in: with "auto" the one
    in which the loop closes better.

    Raises: InputError, RefusedError as `estimate_time_offset`.
    """
    from calibrant.calibrate.clocks.lens import with_lens_error
    from calibrant.calibrate.clocks.offset import estimate_time_offset
    from calibrant.calibrate.solvers.setup import SETUPS

    motion = robot.motion
    # Times since 1970 lose no digits when counted from the start of the recording.
    origin = min(motion.times[0], seen.times[0])
    found: list[tuple[TimeOffset, str]] = []
    failures: list[InputError | RefusedError] = []
    for place in SETUPS if setup == "auto" else (setup,):
        try:
            answer = estimate_time_offset(
                motion.times - origin, motion.T, seen.times - origin, seen.T, setup=place, largest=largest
            )
        except (InputError, RefusedError) as error:
            failures.append(error)
            continue
        found.append((answer, place))
    if not found:
        raise failures[0]
    best, place = min(found, key=lambda pair: pair[0].misfit)
    if not seen.views:
        return best, place
    of_robot = {"robot_times": motion.times - origin, "T_base_gripper": motion.T}
    return (
        with_lens_error(best, seen.camera, seen.by, camera_times=seen.times - origin, setup=place, **of_robot),
        place,
    )
