"""Robot poses from a file for those who work in Python: every way its numbers can be meant, or the one that fits."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from calibrant.errors import InputError
from calibrant.tasks.options.fields import build, spread, words_of
from calibrant.tasks.options.poses import PoseOptions
from calibrant.tasks.options.robots import RobotOptions

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from calibrant.formats.poses.notations import PoseNotation


def read_poses(
    files: str | Path | Iterable[str | Path],
    *,
    T_camera_target: ArrayLike | None = None,
    setup: Literal["auto", "eye-in-hand", "eye-to-hand"] = "auto",
    **options: Any,
) -> tuple[PoseNotation, ...]:
    """Every way in which a file of robot poses can be meant, the most believable first.

    Args: files: a file, a folder, a pattern, or one file a pose; T_camera_target (n, 4, 4), metres: a target pose for
    each robot pose, by which one way is chosen, alone in what is returned; setup: where that is known; options:
    pose_units, pose_rotation, pose_angle, pose_direction, robot_format, robot, robot_link, robot_base, joint_angle, as
    on the command line.
    Raises: InputError for a file that cannot be read and options that are none; RefusedError where two ways fit the
    target poses equally well, or the motions determine nothing.

        >>> import calibrant as cb
        >>> first = cb.read_poses("poses.csv", pose_units="mm")[0]  # doctest: +SKIP
        >>> first.description, first.poses.T_base_gripper.shape  # doctest: +SKIP
        ('positions in mm, quaternions x y z w, T_base_gripper', (20, 4, 4))
    """
    from calibrant.formats.poses.notations import every_notation, notations

    known = {f.name for group in (PoseOptions, RobotOptions) for f in spread(group)}
    unknown = sorted(set(options) - known)
    if unknown:
        raise InputError(f"read_poses has no option {unknown[0]!r}; it has {', '.join(sorted(known))}")
    named = list(words_of("files", files))
    form, arm = (build(group, options) for group in (PoseOptions, RobotOptions))
    raw = form.read(named, arm)
    if T_camera_target is None:
        return notations(raw)
    from calibrant.diagnose.conventions.decide import decide

    return (decide(every_notation(raw), T_camera_target, setup=setup).notation,)
