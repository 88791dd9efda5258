"""Observations of a project as devices: `project:DIR`, `project:DIR,camera=hand`."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from calibrant.data.devices import DeviceCalibration
from calibrant.devices.driver import Driver, Opened
from calibrant.devices.recorded.bag import bag_session
from calibrant.devices.recorded.folder import chain_of, read_raw, session_of
from calibrant.devices.recorded.pictures import colour_files
from calibrant.devices.recorded.session import Session, played
from calibrant.devices.spec import DeviceSpec
from calibrant.errors import InputError
from calibrant.formats.projects.folder import folder_of, outside, placing_results, read_project
from calibrant.formats.projects.lenses import known_lenses
from calibrant.formats.projects.records import Component, Project, Recording, Seen


def open_project(spec: DeviceSpec) -> Opened:
    """The pictures and poses of one of a project's observations. Raises: InputError."""
    folder = folder_of(spec.need_place("a project's folder: project:DIR"))
    project = read_project(folder)
    name, seen = _seen(project, spec)
    lens = known_lenses(folder, project, placing_results(folder, project)).get(seen.camera)
    stated = DeviceCalibration(colour=lens)
    arm = project.components.get(seen.robot)
    at = partial(outside, folder)
    if seen.recording is not None:
        session: Session = bag_session(_of_bag(seen.recording, str(at(seen.recording.bag)), arm, folder))
        return played(session, name, seen.camera, stated)
    from calibrant.detection.images.files import expand

    files = colour_files(expand([str(at(image)) for image in seen.images]))
    options = {**_of_notation(seen), **_of_robot(arm, folder)}
    raw = read_raw([str(at(file)) for file in seen.poses], options) if seen.poses else None
    session = session_of(f"{name} of project {folder}", files, raw, chain=chain_of(options))
    return played(session, name, seen.camera, stated)


def _seen(project: Project, spec: DeviceSpec) -> tuple[str, Seen]:
    """The observations asked for. Raises: InputError listing those that play."""
    plays = {n: s for n, s in project.observations.items() if s.images or s.recording is not None}
    asked = spec.options.get("camera")
    if asked is None and len(plays) == 1:
        return next(iter(plays.items()))
    if asked in plays:
        return str(asked), plays[str(asked)]
    listed = ", ".join(plays) or "none"
    what = "say whose pictures play" if asked is None else f"the project has no observations {asked!r} with pictures"
    raise InputError(f"{spec.text}: {what}, camera=NAME; observations with pictures: {listed}")


def _of_notation(seen: Seen) -> dict[str, str]:
    said = seen.notation
    given = {"units": said.units, "rotation": said.rotation, "angle": said.angle, "direction": said.direction}
    return {**given, **({"maker": said.maker} if said.maker else {})}


def _of_robot(arm: Component | None, folder: Path) -> dict[str, str]:
    if arm is None or not arm.chain:
        return {}
    file = outside(folder, arm.chain)
    given = {"robot": str(file) if file.exists() else arm.chain, "link": arm.chain_link, "base": arm.chain_base}
    return {key: value for key, value in {**given, "joint-angle": arm.joint_angle}.items() if value}


def _of_bag(recording: Recording, file: str, arm: Component | None, folder: Path) -> DeviceSpec:
    given = {
        "camera": recording.topic,
        "stamps": recording.stamps,
        "tf": recording.tf,
        "joints": recording.joint_topic,
        "clock-offset": recording.clock_offset,
        **{k: v for k, v in _of_robot(arm, folder).items() if k != "joint-angle"},
    }
    return DeviceSpec("bag", file, {key: value for key, value in given.items() if value}, f"bag:{file}")


DRIVER = Driver(
    name="project",
    form="project:DIR[,camera=OBSERVATIONS]",
    gives=("robot", "camera"),
    says="what a project's camera saw, and its robot's poses then",
    tested="itself: projects",
    connect=open_project,
    keys=("camera",),
)
