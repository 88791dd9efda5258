"""Bags of a project: the options that its observations say, and the pictures that count, chosen as the commands do."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.tasks.inputs.bags.sharpest import TakenTogether, only_camera, taken_together
from calibrant.tasks.inputs.sources import kept
from calibrant.tasks.listener import Listener
from calibrant.tasks.options.bags import BagOptions, PosedBagOptions
from calibrant.tasks.project.solution.at_robot import list_request
from calibrant.tasks.project.solution.handheld import mates_of
from calibrant.tasks.project.solution.sources import target_spec
from calibrant.tasks.robots.hand_eye_bag import BagLists, read_bag

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibrant.formats.projects.records import Project, Recording


def pictures_of_bag(folder: Path, project: Project, name: str, listener: Listener) -> list[Path]:
    """The pictures of observations in a bag, without those left out. Raises: InputError, RefusedError as the parts."""
    seen = project.observations[name]
    if seen.robot:
        files = [Path(f) for f in posed_lists(folder, project, name, listener).images]
    elif len(mates := mates_of(project, name)) > 1:
        files = [Path(f) for f in together(folder, project, mates).files[seen.camera]]
    else:
        files = [Path(f) for f in only_camera(_options(folder, _recording(project, name)), ())]
    keep = kept([f.name for f in files], seen.exclude, what="picture")
    return [f for f, k in zip(files, keep) if k]


def posed_lists(folder: Path, project: Project, name: str, listener: Listener) -> BagLists:
    """Pictures and the robot's pose at each, as `hand-eye --bag` has them."""
    seen, said = project.observations[name], _recording(project, name)
    options = PosedBagOptions(
        bag=folder / said.bag,
        image_topic=(said.topic,) if said.topic else (),
        stamps=said.stamps,
        tf=said.tf or None,
        joint_topic=said.joint_topic or None,
        moments=said.moments,
        clock_offset=said.clock_offset or None,
    )
    options.check()
    component = project.components[seen.camera]
    lens = {"": folder / component.file} if component.file and not component.start else {}
    target = target_spec(folder, project.components[seen.target])
    return read_bag(options, list_request(folder, project, seen, listener), target, lens, seen.setup)


def together(folder: Path, project: Project, names: Sequence[str]) -> TakenTogether:
    """Pictures of a rig's cameras in one bag. Raises: InputError for several bags, or a camera without a topic."""
    said = {project.observations[n].camera: _recording(project, n) for n in names}
    bags = dict.fromkeys(r.bag for r in said.values())
    if len(bags) > 1:
        raise InputError(
            f"the cameras of a rig are in {len(bags)} bags, {', '.join(bags)}: what was taken at once is told by the "
            "times of one"
        )
    none = [camera for camera, r in said.items() if not r.topic]
    if none:
        raise InputError(f"which pictures of {next(iter(bags))} are of {none[0]}? Name its topic (--image-topic)")
    topics = tuple(f"{camera}={r.topic}" for camera, r in said.items())
    first = next(iter(said.values()))
    return taken_together(BagOptions(bag=folder / first.bag, image_topic=topics, stamps=first.stamps))


def _options(folder: Path, said: Recording) -> BagOptions:
    topics = (said.topic,) if said.topic else ()
    return BagOptions(bag=folder / said.bag, image_topic=topics, stamps=said.stamps)


def _recording(project: Project, name: str) -> Recording:
    found = project.observations[name].recording
    if found is None:
        raise InputError(f"observations {name} are of no bag, and others of the same rig are; take all from one")
    return found
