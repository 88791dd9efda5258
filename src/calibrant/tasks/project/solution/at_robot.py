"""Observations of a project at a robot's poses: paired and examined as `hand-eye` does."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import CalibrantError
from calibrant.tasks.listener import Listener
from calibrant.tasks.options.cameras import LensOptions
from calibrant.tasks.options.poses import PoseOptions
from calibrant.tasks.options.robots import RobotOptions
from calibrant.tasks.robots import hand_eye_list
from calibrant.tasks.robots.hand_eye_list import ListRequest
from calibrant.tasks.robots.hand_eye_pictures import ReadList, moments_of, require_sound

if TYPE_CHECKING:
    from calibrant.formats.projects.records import Component, Notation, Project, Seen


def list_request(folder: Path, project: Project, seen: Seen, listener: Listener) -> ListRequest:
    """The options of `hand-eye` for these observations, but for what they show."""
    component = project.components[seen.camera]
    return ListRequest(
        poses=tuple(str(folder / p) for p in seen.poses),
        setup=seen.setup,
        form=pose_options(seen.notation),
        arm=arm_of(folder, project.components[seen.robot], seen.notation),
        lens=LensOptions(model=component.model or project.options.model, fix=component.fix or project.options.fix),
        listener=listener,
    )


def pose_options(said: Notation) -> PoseOptions:
    """How poses are written, as options have it."""
    return PoseOptions(
        pose_units=said.units, pose_rotation=said.rotation, pose_angle=said.angle, pose_direction=said.direction
    )


def arm_of(folder: Path, robot: Component, said: Notation) -> RobotOptions:
    """The robot's chain, where its poses are joint values, and its maker's way to write poses."""
    if not robot.chain:
        return RobotOptions(robot_format=said.maker or None)
    file = folder / robot.chain
    return RobotOptions(
        robot=str(file) if file.exists() else robot.chain,
        robot_link=robot.chain_link or None,
        robot_base=robot.chain_base or None,
        joint_angle=robot.joint_angle,
    )


def read_at_robot(request: ListRequest, name: str, camera: str) -> ReadList:
    """Observations paired with the robot's poses, and examined. Raises: InputError, RefusedError naming them."""
    try:
        data = hand_eye_list.read(request)
        with request.listener.status(f"Examining the data of {name} …"):
            diagnosis = hand_eye_list.diagnose(data, request)
        require_sound(diagnosis)
    except CalibrantError as error:
        error.args = (f"observations {name}: {error}",)
        raise
    return ReadList.examined(name, camera, None, data, diagnosis, moments_of(data))


def of_robot(project: Project, read: Mapping[str, ReadList], robot: str) -> list[ReadList]:
    """The lists at the poses of a robot."""
    return [r for name, r in read.items() if project.observations[name].robot == robot]
