"""A folder of pictures as devices: `folder:DIR`, `folder:DIR,poses=poses.csv,rotation=rotvec`.

Depth lies beside the pictures (name_depth.png, depth/name.png, name.npy), poses in a file of any kind that `hand-eye`
reads: the folder's own poses.*, or the one that is named.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibrant.arrays import Array
from calibrant.data.file_names import distinct_names
from calibrant.devices.driver import Driver, Opened
from calibrant.devices.recorded.pictures import colour_files, depth_beside, read_colour, read_metres
from calibrant.devices.recorded.session import Session, Shot, played
from calibrant.devices.spec import DeviceSpec
from calibrant.devices.stated import stated_in
from calibrant.errors import InputError
from calibrant.reading.notes import note

if TYPE_CHECKING:
    from calibrant.formats.poses.read import RawPoses
    from calibrant.robots.chain import KinematicChain

NOTATION = ("units", "rotation", "angle", "direction", "maker")
"""How poses are written, as the options --pose-units … and --robot-format have it."""
ROBOT = ("robot", "link", "base", "joint-angle")
"""The robot, where the poses are joint values."""


def open_folder(spec: DeviceSpec) -> Opened:
    """The pictures of a folder, a pattern or a video, and the robot of its poses. Raises: InputError."""
    from calibrant.detection.images.files import expand

    place = spec.need_place("a folder of pictures: folder:DIR")
    folder = Path(place).expanduser()
    files = colour_files(expand([str(folder / spec.options["images"]) if "images" in spec.options else place]))
    poses = spec.options.get("poses")
    if poses is not None:
        named = [str(_in(folder, poses))]
    else:
        named = [str(p) for p in _own_poses(folder)]
    raw = read_raw(named, spec.options) if named else None
    chain = chain_of(spec.options)
    session = session_of(place, files, raw, chain=chain, unit=_unit(spec))
    stated = stated_in(_in(folder, spec.options["lens"]) if "lens" in spec.options else None)
    return played(session, "camera", "camera", stated)


def session_of(
    source: str,
    files: Sequence[Path],
    raw: RawPoses | None,
    *,
    chain: KinematicChain | None = None,
    unit: float | None = None,
) -> Session:
    """The session of picture files and the poses read for them; pictures without a pose are left out.

    unit: metres of a number of the depth files. Raises: InputError where pictures and poses do not belong together, or
    the poses could be read in several ways.
    """
    from calibrant.formats.poses.pairing import match_raw

    if raw is None:
        return Session(source, tuple(_shots(files, np.arange(float(len(files))), unit)), chain=chain)
    pairing = match_raw(raw, [str(file) for file in files])
    rows = list(pairing.pose_index)
    seen = [files[i] for i in pairing.view_index]
    times = np.arange(float(len(seen))) if raw.times is None else raw.times[rows]
    joints = None if raw.joints is None else raw.joints[rows]
    return Session(source, tuple(_shots(seen, times, unit)), in_base(raw)[rows], joints, chain)


def read_raw(files: Sequence[str], said: Mapping[str, str]) -> RawPoses:
    """The poses of files, as the options say. Raises: InputError as `read_poses`."""
    from calibrant.formats.poses.read import read_poses

    return read_poses(
        list(files), robot=chain_of(said), joint_angle=said.get("joint-angle", "auto"), maker=said.get("maker"),
        units=said.get("units", "auto"), rotation=said.get("rotation", "auto"), angle=said.get("angle", "auto"),
        direction=said.get("direction", "auto"),
    )  # fmt: skip


def in_base(raw: RawPoses) -> Array:
    """T_base_gripper (n, 4, 4), read the way that is most believable. Raises: InputError for what could be several."""
    from calibrant.formats.poses.read import notations, refuse_ambiguous

    try:
        refuse_ambiguous(raw)
    except InputError as error:
        raise InputError(
            f"{error} In a device's spec these are rotation=rotvec, maker=ur, angle=deg, units=mm"
        ) from None
    believed = notations(raw)[0]
    if raw.joints is None:
        note(f"{believed.source}: read as {believed.description}")
    return believed.T_base_gripper


def chain_of(said: Mapping[str, str]) -> KinematicChain | None:
    """The robot that is named. Raises: InputError as `read_robot`."""
    if "robot" not in said:
        return None
    from calibrant.formats.robots.read import read_robot

    return read_robot(said["robot"], link=said.get("link"), base=said.get("base")).chain


def _shots(files: Sequence[Path], times: Array, unit: float | None) -> list[Shot]:
    names = distinct_names(list(files))
    out = []
    for file, time_s in zip(files, times, strict=True):
        beside = depth_beside(file)
        depth = None if beside is None else partial(read_metres, beside, unit)
        out.append(Shot(names[file], float(time_s), partial(read_colour, file), depth))
    return out


def _own_poses(folder: Path) -> list[Path]:
    """The folder's poses.*; none where it has none. Raises: InputError for several."""
    from calibrant.formats.poses.read import SUFFIXES

    if not folder.is_dir():
        return []
    found = sorted(p for p in folder.iterdir() if p.stem.lower() == "poses" and p.suffix.lower() in SUFFIXES)
    if len(found) > 1:
        raise InputError(
            f"{folder} has several files of poses: {', '.join(p.name for p in found)}; say which: poses=FILE"
        )
    return found


def _in(folder: Path, given: str) -> Path:
    """A file that is named from the folder, or from here."""
    inside = folder / given
    return inside if inside.exists() else Path(given).expanduser()


def _unit(spec: DeviceSpec) -> float | None:
    if "depth-unit" not in spec.options:
        return None
    from calibrant.targets.lengths import parse_length

    return parse_length(spec.options["depth-unit"], what="depth-unit")


DRIVER = Driver(
    name="folder",
    form="folder:DIR[,poses=FILE,images=PATTERN,depth-unit=0.1mm,lens=FILE,robot=ARM,rotation=rotvec …]",
    gives=("robot", "camera"),
    says="pictures of a folder, with depth beside them, and the robot poses of a file",
    tested="itself: files",
    connect=open_folder,
    keys=("poses", "images", "depth-unit", "lens", *NOTATION, *ROBOT),
)
