"""A project with one thing more, less or otherwise: pure functions, each gives a new project.

project = with_component(project, "left", Component(kind="camera"))
project = placed(project, "left", Placement(relative_to="base", xyz_mm=(0, 0, 900), ypr_deg=(0, 0, 180), source=TYPED))
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TypeVar

from calibrant.errors import InputError
from calibrant.formats.projects.checks import check_name, check_project, used_by, used_by_touches
from calibrant.formats.projects.frames import BASE, GRIPPER, check_frames, frame_named
from calibrant.formats.projects.records import Component, Kept, Placement, Project, Seen, Touched

R = TypeVar("R", Seen, Touched)


def with_component(project: Project, name: str, component: Component) -> Project:
    """One more component. Raises: InputError for a name that is taken or none, and for what it names."""
    name = _free_name(project, name)
    return _checked(replace(project, components={**project.components, name: component}))


def with_seen(project: Project, name: str, seen: Seen) -> Project:
    """More observations. Raises: InputError for a name that is taken, and for components that are not there."""
    name = check_name(name)
    if name in project.observations:
        raise InputError(
            f"there are observations called {name!r} already; add to them with --more, or take another name"
        )
    return _checked(replace(project, observations={**project.observations, name: seen}))


def with_touches(project: Project, name: str, touched: Touched) -> Project:
    """More touches. Raises: InputError for a name that is taken, and for components that are not there."""
    name = check_name(name)
    if name in project.touches or name in project.observations:
        raise InputError(f"there are touches or observations called {name!r} already; take another name")
    return _checked(replace(project, touches={**project.touches, name: touched}))


def with_more_seen(project: Project, name: str, more: Seen) -> Project:
    """Observations with more images, captures and poses. Raises: InputError where there are none of that name."""
    before = observations_named(project, name)
    joined = replace(
        before,
        images=_joined(before.images, more.images),
        captures=_joined(before.captures, more.captures),
        poses=_joined(before.poses, more.poses),
        exclude=_joined(before.exclude, more.exclude),
    )
    return _checked(replace(project, observations={**project.observations, name: joined}))


def observations_named(project: Project, name: str) -> Seen:
    """Raises: InputError listing those that there are."""
    if name not in project.observations:
        listed = ", ".join(project.observations) or "none"
        raise InputError(f"there are no observations called {name!r}; there are: {listed}")
    return project.observations[name]


def without(project: Project, name: str) -> Project:
    """Without a component, or without observations. Raises: InputError where others need it, naming them."""
    if name not in project.components and name in project.observations:
        left = {n: seen for n, seen in project.observations.items() if n != name}
        results = tuple(k for k in project.results if not (k.of == "seen" and k.name == name))
        return replace(project, observations=left, results=results)
    if name not in project.components and name in project.touches:
        return replace(project, touches={n: t for n, t in project.touches.items() if n != name})
    _require(project, name)
    users = list(_users(project, name))
    if users:
        raise InputError(f"{name} is needed by {', '.join(users)}; remove or change these first")
    components = {n: _not_shown_in(project, c, name) for n, c in project.components.items() if n != name}
    return _checked(replace(project, components=components, world="" if project.world == name else project.world))


def renamed(project: Project, old: str, new: str) -> Project:
    """With another name for a component, or for observations, wherever it stands but in the results' own files.

    Raises: InputError for a name that is not there, or one that is taken.
    """
    if old not in project.components and old in project.observations:
        if (new := check_name(new)) in project.observations:
            raise InputError(f"there are observations called {new!r} already")
        seen = {new if n == old else n: s for n, s in project.observations.items()}
        results = tuple(replace(k, name=new) if k.of != "given" and k.name == old else k for k in project.results)
        return replace(project, observations=seen, results=results)
    if old not in project.components and old in project.touches:
        kept = {check_name(new) if n == old else n: t for n, t in project.touches.items()}
        if len(kept) < len(project.touches):
            raise InputError(f"there are touches called {new!r} already")
        return _checked(replace(project, touches=kept))
    _require(project, old)
    new = check_name(new)
    taken = next((n for n in project.components if n != old and n.casefold() == new.casefold()), None)
    if taken is not None:
        raise InputError(f"there is a {project.components[taken].kind} called {taken!r} already")
    names = {old: new, **({f"{old}_{GRIPPER}": f"{new}_{GRIPPER}"} if project.components[old].kind == "robot" else {})}
    components = {names.get(n, n): _component_renamed(c, names) for n, c in project.components.items()}
    seen = {n: _named_otherwise(s, _NAMED_BY_SEEN, names) for n, s in project.observations.items()}
    touches = {n: _named_otherwise(t, _NAMED_BY_TOUCHES, names) for n, t in project.touches.items()}
    world = names.get(project.world, project.world)
    return _checked(replace(project, components=components, observations=seen, touches=touches, world=world))


def names_in_result(kept: Kept, old: str, new: str) -> Mapping[str, str]:
    """What a result's file must call otherwise where a component is renamed."""
    if old not in kept.robots:
        return {old: new}
    return {old: new, **{f"{old}_{part}": f"{new}_{part}" for part in (BASE, GRIPPER) if len(kept.robots) > 1}}


def placed(project: Project, name: str, pose: Placement | None) -> Project:
    """With a component at a pose that is given; None: where the results have it. Raises: InputError for frames that are
    not there, a component relative to itself, poses that turn in a circle."""
    _require(project, name)
    if pose is not None and frame_named(project, pose.relative_to) == frame_named(project, name):
        raise InputError(f"{name} is always at itself; give its pose relative to another component")
    return _changed(project, name, replace(project.components[name], pose=pose))


def shown_in(project: Project, name: str, frame: str) -> Project:
    """With a component shown in a frame. Raises: InputError for one that is not there."""
    _require(project, name)
    frame_named(project, frame)
    return _changed(project, name, replace(project.components[name], shown_in=frame))


def with_world(project: Project, name: str) -> Project:
    """With all shown in a component's frame. Raises: InputError for one that is not there."""
    frame_named(project, name)
    components = {n: replace(c, shown_in="") for n, c in project.components.items()}
    return replace(project, world=name, components=components)


def with_kept(project: Project, kept: Kept) -> Project:
    """With a result, in the place of the one of the same things."""
    others = tuple(k for k in project.results if (k.of, k.name) != (kept.of, kept.name))
    return replace(project, results=(*others, kept))


def _changed(project: Project, name: str, component: Component) -> Project:
    return _checked(replace(project, components={**project.components, name: component}))


def _checked(project: Project) -> Project:
    check_project(project)
    check_frames(project)
    return project


def _require(project: Project, name: str) -> None:
    if name not in project.components:
        frame_named(project, name)  # a gripper is there, and no component
        raise InputError(f"{name!r} is a frame of a robot; name the robot, or another component")


def _free_name(project: Project, name: str) -> str:
    name = check_name(name)
    taken = next((n for n in project.components if n.casefold() == name.casefold()), None)
    if taken is not None:
        raise InputError(f"there is a {project.components[taken].kind} called {taken!r} already; take another name")
    return name


def _users(project: Project, name: str) -> Iterator[str]:
    """What needs a component, in words."""
    for other, c in project.components.items():
        if name in (*c.cameras, *c.targets, c.camera, c.robot):
            yield f"the {c.kind} {other}"
        elif c.pose is not None and other != name and _belongs(project, c.pose.relative_to, name):
            yield f"the pose of {other}"
    for listed, seen in project.observations.items():
        if name in dict(used_by(seen)):
            yield f"the observations {listed}"
    for listed, touched in project.touches.items():
        if name in dict(used_by_touches(touched)):
            yield f"the touches {listed}"


def _belongs(project: Project, frame: str, name: str) -> bool:
    found = frame_named(project, frame)
    return found == frame_named(project, name) or found == f"{name}_{GRIPPER}" or frame == name


def _not_shown_in(project: Project, c: Component, name: str) -> Component:
    return replace(c, shown_in="") if c.shown_in and _belongs(project, c.shown_in, name) else c


def _component_renamed(c: Component, names: Mapping[str, str]) -> Component:
    def named(name: str) -> str:
        return names.get(name, name)

    pose = None if c.pose is None else replace(c.pose, relative_to=named(c.pose.relative_to))
    return replace(
        c,
        pose=pose,
        shown_in=named(c.shown_in),
        cameras=tuple(map(named, c.cameras)),
        targets=tuple(map(named, c.targets)),
        camera=named(c.camera),
        robot=named(c.robot),
    )


def _named_otherwise(record: R, fields: tuple[str, ...], names: Mapping[str, str]) -> R:
    used = {field: names.get(getattr(record, field), getattr(record, field)) for field in fields}
    return replace(record, **used)


_NAMED_BY_SEEN = ("camera", "target", "projector", "robot")
_NAMED_BY_TOUCHES = ("tool", "robot", "target")


def _joined(before: tuple[str, ...], more: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(dict.fromkeys([*before, *more]))
