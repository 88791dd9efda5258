"""A project made from another program's file, or from a result: its cameras with their lenses, its frames, its places.

What was read stays whole in the project, as a result of its own ("given"); components refer to it.
"""

from __future__ import annotations

from dataclasses import replace

from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.projects.edits import with_component, with_kept
from calibrant.formats.projects.folder import kept_result
from calibrant.formats.projects.frames import BASE, GRIPPER
from calibrant.formats.projects.records import Component, Project

ROBOT = "robot"


def imported(project: Project, result: CalibrationResult, *, source: str) -> tuple[Project, dict[str, str]]:
    """The project with what a file holds, and the results to write beside it (text by file).

    source: the file's name. A frame "gripper" is a robot's, whose base is "base"; the target that a result has seen is
    one with its spec; other frames stay frames. The parent of the first transform is the world.
    Raises: InputError for names that the project has already, or that cannot be.
    """
    frames = list(dict.fromkeys(name for t in result.transforms for name in (t.parent, t.child)))
    if not frames and not result.cameras:
        raise InputError(f"{source} holds no camera and no pose")
    robots = (ROBOT,) if GRIPPER in frames else ()
    slim = replace(result, observations=None, robot_poses=None, T_camera_target=None, views=(), details=())
    kept, text = kept_result(slim, of="given", name=source, robots=robots)
    for name in robots:
        project = with_component(project, name, Component(kind="robot"))
    for name in dict.fromkeys([*frames, *result.cameras]):
        if name in result.cameras:
            component = Component(kind="camera", file=kept.file, name_in_file=name)
        elif robots and name in (BASE, GRIPPER):
            continue
        elif name == "target" and result.observations is not None and result.observations.target:
            component = Component(kind="target", spec=result.observations.target)
        else:
            component = Component(kind="frame")
        project = with_component(project, name, component)
    world = project.world or (frames[0] if frames else "")
    return replace(with_kept(project, kept), world=world), {kept.file: text}
