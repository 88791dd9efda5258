"""Touches of a project: poses at which a tool's tip is on a point or on a target's corners, in the part's problem."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.tasks.project.solution.at_robot import arm_of, of_robot, pose_options
from calibrant.tasks.project.solution.sources import target_spec
from calibrant.tasks.robots.hand_eye_pictures import ReadList

if TYPE_CHECKING:
    from calibrant.arrays import Array
    from calibrant.calibrate.cell.problem.touches import Touches
    from calibrant.data import RobotPoses
    from calibrant.formats.poses.read import PoseNotation
    from calibrant.formats.projects.records import Project, Touched
    from calibrant.tasks.project.solution.parts import Part


def touches_of(
    folder: Path, project: Project, part: Part, robots: Mapping[str, RobotPoses], read: Mapping[str, ReadList]
) -> tuple[dict[str, RobotPoses], tuple[Touches, ...]]:
    """The robots' poses with those of the touches, and the touches of a part.

    Args: robots: the poses of pictures; read: the lists at robots' poses, as which poses of touches are read.
    Raises: InputError for poses that can be read in several ways, and corners that the target does not have.
    """
    import numpy as np

    from calibrant.calibrate.cell.problem.touches import Touches
    from calibrant.data import RobotPoses

    every, out = dict(robots), []
    for name in part.touches:
        touched = project.touches[name]
        reading = _reading(folder, project, name, touched, of_robot(project, read, touched.robot))
        T, before = reading.poses.T_base_gripper, every[touched.robot]
        ids = tuple(f"touch {name} {k}" for k in range(len(T)))
        every[touched.robot] = RobotPoses(
            (*before.ids, *ids), np.concatenate([before.T_base_gripper, T]), before.source
        )
        if not touched.target:
            out.append(Touches(ids, touched.robot, touched.tool, name))
            continue
        points = _corners(folder, project, name, touched, len(T))
        out.append(Touches(ids, touched.robot, touched.tool, target=touched.target, points=points))
    return every, tuple(out)


def _reading(folder: Path, project: Project, name: str, touched: Touched, lists: list[ReadList]) -> PoseNotation:
    """The poses, read as those of the robot's pictures are. Raises: InputError where that leaves several ways."""
    from calibrant.formats.poses.read import every_notation

    arm = arm_of(folder, project.components[touched.robot], touched.notation)
    raw = pose_options(touched.notation).read(tuple(str(folder / p) for p in touched.poses), arm)
    possible = list(every_notation(raw))
    said = {r.notation for r in lists if r.notation}
    alike = [n for n in possible if n.description in said] or possible
    if len(alike) != 1:
        raise InputError(
            f"touches {name}: their poses can be read in {len(alike)} ways, and pictures of {touched.robot} do not "
            "tell which: say it with --pose-units, --pose-rotation, --pose-angle and --pose-direction"
        )
    return alike[0]


def _corners(folder: Path, project: Project, name: str, touched: Touched, count: int) -> Array:
    """The touched places (n, 3) in the target's frame, metres."""
    from calibrant.targets.registry import parse_target

    points = parse_target(target_spec(folder, project.components[touched.target])).points
    if len(touched.corners) != count:
        raise InputError(
            f"touches {name}: {count} poses and {len(touched.corners)} corners of {touched.target}; a pose touches one"
        )
    wrong = [k for k in touched.corners if not 0 <= k < len(points)]
    if wrong:
        raise InputError(
            f"touches {name}: {touched.target} has the points 0 to {len(points) - 1}; there is no {wrong[0]}"
        )
    return points[list(touched.corners)]
