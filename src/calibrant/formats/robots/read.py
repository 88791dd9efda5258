"""Robots from files of any kind, or by name; and writing them back."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from calibrant.errors import InputError
from calibrant.formats.robots.dh_yaml import dh_text, parse_dh
from calibrant.formats.robots.urdf import UrdfChain, corrected_urdf, new_urdf, parse_urdf
from calibrant.reading.files import Most, read_text
from calibrant.reading.notes import note_unused
from calibrant.robots.arms import ARMS
from calibrant.robots.dh import DHChain
from calibrant.robots.geometry import ParametricChain
from calibrant.robots.links import LinkChain

DESCRIPTION = Most(16_000_000, "a robot of ten thousand links")
URDF_SUFFIXES = (".urdf", ".xml")
DH_SUFFIXES = (".yaml", ".yml")


@dataclass(frozen=True, eq=False)
class Robot:
    """A chain and where it came from; urdf is there when that was a URDF file."""

    chain: ParametricChain
    source: str
    urdf: UrdfChain | None = None

    @property
    def base(self) -> str:
        """What the file calls the base."""
        return "base" if self.urdf is None else self.urdf.base

    @property
    def flange(self) -> str:
        """What the file calls the end of the chain."""
        return "flange" if self.urdf is None else self.urdf.tip


def read_robot(source: str | Path, *, link: str | None = None, base: str | None = None) -> Robot:
    """A robot from a URDF or a DH table (YAML), or one known by name, such as ur5e.

    Args: link, base: ends of the chain, for URDF; what else that holds is noted as not used.
    Raises: InputError: no such file or name, no robot in it.
    """
    path = Path(source)
    if not path.exists():
        if str(source) in ARMS:
            known = ARMS[str(source)]
            if isinstance(known, ParametricChain):
                return _without_links(Robot(known, str(source)), link, base)
        raise InputError(f"no robot file {source}, and no robot of that name; known names: {', '.join(ARMS)}")
    text = read_text(path, most=DESCRIPTION, what="robot file", expected="a URDF or a DH table (YAML)")
    if not text.strip():
        raise InputError(f"{path}: the file is empty; expected a URDF or a DH table (YAML)")
    if path.suffix.lower() in URDF_SUFFIXES or text.lstrip().startswith("<"):
        urdf = parse_urdf(text, str(path), link=link, base=base)
        note_unused(str(path), urdf.unused)
        return Robot(urdf.chain, str(path), urdf)
    return _without_links(Robot(parse_dh(text, str(path)), str(path)), link, base)


def robot_text(original: Robot | None, chain: ParametricChain, suffix: str) -> str:
    """The robot as text for a file of that suffix: the original URDF corrected, a new URDF, or a DH table.

    Raises: InputError for a chain that the kind of file cannot hold, or an unknown suffix.
    """
    if suffix.lower() in URDF_SUFFIXES:
        if original is not None and original.urdf is not None and isinstance(chain, LinkChain):
            return corrected_urdf(original.urdf, chain)
        return new_urdf(chain)
    if suffix.lower() in DH_SUFFIXES:
        if not isinstance(chain, DHChain):
            raise InputError("only a robot given as a DH table is written as one; write a URDF instead (robot.urdf)")
        return dh_text(chain)
    raise InputError(f"cannot write a robot as {suffix!r}; expected a name ending in .urdf or .yaml")


def _without_links(robot: Robot, link: str | None, base: str | None) -> Robot:
    asked = link if link not in (None, robot.flange) else base if base not in (None, robot.base) else None
    if asked is not None:
        raise InputError(f"{robot.source}: no link {asked!r}; a DH table has the links base and flange")
    return robot
