"""The names that options of hand-eye give to cameras and robots, and the lists of photos they make.

--images left=DIR, or left@robot=DIR with several robots, left@robot:other=DIR where the other robot carries the target;
--poses robot=FILE; --camera left=FILE; --setup left=eye-in-hand; --target left=SPEC. Without names there is one list,
of the camera "camera".
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from calibrant.errors import InputError

ONLY_CAMERA = "camera"
"""The name of a camera that was given none."""
_NAMED = re.compile(r"^(?P<name>[A-Za-z][\w-]*)(?:@(?P<robot>[A-Za-z][\w-]*(?::[A-Za-z][\w-]*)?))?=(?P<value>.+)$")


@dataclass(frozen=True)
class Named:
    """Values of an option by their name, and those without one."""

    named: Mapping[tuple[str, str], tuple[str, ...]] = field(default_factory=dict)
    plain: tuple[str, ...] = ()


def named(values: Sequence[str], option: str) -> Named:
    """NAME=VALUE apart from plain values; a file that exists under the whole word is meant as such.

    Raises: InputError where some values have a name and others do not.
    """
    found: dict[tuple[str, str], tuple[str, ...]] = {}
    plain: list[str] = []
    for value in values:
        match = _NAMED.match(value)
        if match is None or Path(value).exists():
            plain.append(value)
            continue
        key = (match["name"], match["robot"] or "")
        found[key] = (*found.get(key, ()), match["value"])
    if found and plain and option not in ("--setup", "--target"):
        name = next(iter(found))[0]
        raise InputError(
            f"{option} {plain[0]} has no name, {option} {name}=… has one: with several, each needs its name "
            f"({option} NAME={plain[0]})"
        )
    return Named(found, tuple(plain))


@dataclass(frozen=True)
class Names:
    """What belongs to which camera and robot. images by (camera, robot); robot "" where none was named; target, setup:
    those of cameras that have none of their own."""

    images: Mapping[tuple[str, str], tuple[str, ...]]
    poses: Mapping[str, tuple[str, ...]]
    cameras: Mapping[str, Path]
    setups: Mapping[str, str]
    targets: Mapping[str, str]
    target: str | None = None
    setup: str = "auto"

    @property
    def plain(self) -> bool:
        """Whether there is one list of the only robot."""
        return len(self.images) == 1 and len(self.poses) == 1 and ":" not in next(iter(self.images))[1]

    def target_of(self, camera: str) -> str | None:
        """The board that a camera sees."""
        return self.targets.get(camera, self.target)

    def setup_of(self, camera: str) -> str:
        """How a camera stands to the robot."""
        return self.setups.get(camera, self.setup)

    def target_name(self, camera: str) -> str:
        """ "target" where all cameras see one kind of board, else its spec."""
        kinds = {self.target_of(name) for name, _ in self.images}
        return "target" if len(kinds) == 1 else self.target_of(camera) or "target"


def names_of(
    *,
    images: Sequence[str],
    poses: Sequence[str],
    cameras: Sequence[str],
    setups: Sequence[str],
    targets: Sequence[str],
    beside_photos: bool,
) -> Names:
    """The names in the options' values. Args: beside_photos: points found before or target poses are given.

    Raises: InputError for names that contradict each other.
    """
    seen, robots = named(images, "--images"), named(poses, "--poses")
    known, setup, target = named(cameras, "--camera"), named(setups, "--setup"), named(targets, "--target")
    every = {"--camera": known, "--setup": setup, "--target": target}
    stray = next((option for option, n in every.items() if {name for name, _ in n.named} - {ONLY_CAMERA}), None)
    if stray is not None and not seen.named:
        raise InputError(f"{stray} names a camera, but the photos have no names: --images NAME=IMAGES for each camera")
    if beside_photos and (seen.named or robots.named):
        raise InputError("several cameras or robots, and free joints, are calibrated from photos: give --images")
    lists = dict(seen.named) or {(ONLY_CAMERA, ""): seen.plain}
    cameras_named = {camera for camera, _ in lists}
    for option, n in every.items():
        for name, robot in n.named:
            if robot or name not in cameras_named:
                asked = f"{name}@{robot}" if robot else name
                raise InputError(
                    f"{option} {asked}=…: there is no camera of that name; --images names {', '.join(cameras_named)}"
                )
    if known.plain and len(cameras_named) > 1:
        listed = ", ".join(sorted(cameras_named))
        raise InputError(f"--camera {known.plain[0]}: which of {listed}? Write --camera NAME=FILE")
    files = {next(iter(cameras_named)): Path(known.plain[-1])} if known.plain else {}
    return Names(
        lists,
        {robot: f for (robot, _), f in robots.named.items()} or {"": robots.plain},
        files | {name: Path(values[-1]) for (name, _), values in known.named.items()},
        {name: values[-1] for (name, _), values in setup.named.items()},
        {name: values[-1] for (name, _), values in target.named.items()},
        target.plain[-1] if target.plain else None,
        setup.plain[-1] if setup.plain else "auto",
    )
