"""Targets that somebody moves before a project's cameras: whose pictures were taken at once, and of what moment each
is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.tasks.inputs.image_moments import images_by_moment, matched_images

if TYPE_CHECKING:
    from calibrant.data import Missed, Observations, View
    from calibrant.formats.projects.records import Project
    from calibrant.tasks.project.solution.parts import Part


def own_target(project: Project, part: Part, name: str) -> str:
    """What a target is called where somebody moves it: cameras of a rig see the same, others see it at other times, and
    then it is another thing for the problem."""
    seen = project.observations[name]
    if seen.setup != "handheld":
        return seen.target or "target"
    group = group_of(project, name)
    others = {
        group_of(project, n)
        for n in part.observations
        if project.observations[n].setup == "handheld" and project.observations[n].target == seen.target
    }
    target = seen.target or "target"
    return target if others == {group} else f"{target} of {group}"


def group_of(project: Project, name: str) -> str:
    """Whose pictures were taken at once: a rig's, those of one camera of targets that are fixed to each other, or one
    list's alone."""
    seen = project.observations[name]
    if seen.captures:
        return name
    return project.rig_of(seen.camera) or (seen.camera if project.body_of(seen.target) else name)


def mates_of(project: Project, name: str) -> tuple[str, ...]:
    """The handheld observations whose pictures were taken with these, these among them."""
    group = group_of(project, name)
    return tuple(n for n, s in project.observations.items() if s.setup == "handheld" and group_of(project, n) == group)


def rigid_groups(project: Project, part: Part) -> tuple[tuple[str, ...], ...]:
    """The targets that are fixed to each other, by the names that the problem has for them."""
    called: dict[str, str] = {}
    for name in part.observations:
        seen = project.observations[name]
        if seen.setup == "handheld":
            called.setdefault(seen.target, own_target(project, part, name))
    bodies = [project.components[body].targets for body in project.of_kind("body")]
    groups = [tuple(called[t] for t in targets if t in called) for targets in bodies]
    return tuple(group for group in groups if len(group) > 1)


def handheld_moments(project: Project, part: Part, seen: Mapping[str, Observations]) -> dict[str, dict[str, str]]:
    """By observations, the moment of every view of a target that somebody moves, by its id.

    Raises: InputError for two lists of one camera that show one target.
    """
    groups: dict[str, list[str]] = {}
    for name in part.observations:
        if project.observations[name].setup == "handheld":
            groups.setdefault(group_of(project, name), []).append(name)
    out: dict[str, dict[str, str]] = {}
    for names in groups.values():
        if len(names) == 1 or any(project.observations[n].points for n in names):
            out |= {n: {v.id: v.moment for v in seen[n].views} for n in names}
            continue
        refuse_twice(project, names)
        by_file = _at_once(project, {name: seen[name] for name in names})
        cameras = {n: project.observations[n].camera for n in names}
        out |= {n: {v.id: by_file[cameras[n]][_file(v)] for v in seen[n].views} for n in names}
    return out


def refuse_twice(project: Project, names: Sequence[str]) -> None:
    """Raises: InputError for two lists of one camera that show one target, among observations taken at once."""
    shown = Counter((project.observations[n].camera, project.observations[n].target) for n in names)
    (camera, _), count = shown.most_common(1)[0]
    if count > 1:
        raise InputError(
            f"observations {', '.join(names)}: camera {camera} has two lists of the same handheld target in one "
            "rig; put them into one (calibrant project add images NAME --more)"
        )


def _at_once(project: Project, seen: Mapping[str, Observations]) -> dict[str, dict[Path, str]]:
    """By camera, the moment of every image, matched by their names."""
    from calibrant.detection.images.files import natural_key

    files: dict[str, set[Path]] = {}
    for name, found in seen.items():
        every: list[View | Missed] = [*found.views, *found.missed]
        files.setdefault(project.observations[name].camera, set()).update(_file(v) for v in every)
    ordered = {camera: sorted(mine, key=natural_key) for camera, mine in files.items()}
    if len(ordered) == 1:
        return {camera: {file: file.name for file in mine} for camera, mine in ordered.items()}
    keep = {file.name: True for mine in ordered.values() for file in mine}
    return images_by_moment(ordered, matched_images(ordered), keep)


def _file(view: View | Missed) -> Path:
    return Path(view.file or view.id)
