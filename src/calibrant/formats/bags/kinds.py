"""What a bag is by its name: .bag of ROS 1, .mcap or .db3 of ROS 2, or the folder that ROS 2 records into."""

from __future__ import annotations

from pathlib import Path

from calibrant.errors import InputError
from calibrant.reading.files import open_file

FILES = (".bag", ".mcap", ".db3")
METADATA = "metadata.yaml"
"""What stands beside the files of a ROS 2 bag, https://github.com/ros2/rosbag2 (rosbag2_storage)."""
_HEADS = {".bag": b"#ROSBAG V2.0", ".mcap": b"\x89MCAP0\r\n", ".db3": b"SQLite format 3\0"}
_OLD = b"#ROSBAG V1"
_PROFILE = b"ros2"


def is_bag(path: Path) -> bool:
    """Whether the name is a bag's: a file with a bag's ending that is there, or a folder with a bag's metadata."""
    if path.suffix.lower() in FILES:
        return path.is_file() or _is_recorded_folder(path)
    return _is_recorded_folder(path)


def _is_recorded_folder(path: Path) -> bool:
    return (
        path.is_dir() and (path / METADATA).is_file() and any(p.suffix in FILES or _packed(p) for p in path.iterdir())
    )


def _packed(path: Path) -> bool:
    return path.suffix == ".zstd" and path.with_suffix("").suffix in FILES


def files_of(bag: Path) -> list[Path]:
    """The files that a bag consists of."""
    if not bag.is_dir():
        return [bag]
    return sorted(p for p in bag.iterdir() if p.name == METADATA or p.suffix in FILES or _packed(p))


def check_bag(bag: Path) -> None:
    """Raises: InputError for a file that is not there, empty, or something else than its ending says; for a folder that
    ROS 2 did not record."""
    if bag.is_dir():
        if not _is_recorded_folder(bag):
            raise InputError(
                f"bag {bag}: the folder has no {METADATA} beside files {' or '.join(FILES[1:])}, as ROS 2 records "
                "them; give that folder, or one file of it"
            )
        for file in files_of(bag):
            if file.suffix in FILES:
                _check_file(file)
        return
    _check_file(bag)


def _check_file(bag: Path) -> None:
    """Raises: InputError for a file that is not there, empty, or something else than its ending says."""
    suffix = bag.suffix.lower()
    with open_file(bag, what="bag") as stream:
        head = stream.read(100)
        size = stream.seek(0, 2)
    if suffix not in FILES:
        raise InputError(f"bag {bag}: expected a file {', '.join(FILES)}, or the folder that ROS 2 records into")
    if not head:
        raise InputError(f"bag {bag} is empty (0 bytes)")
    if head.startswith(_OLD):
        raise InputError(f"bag {bag} is of an early ROS 1 format; make a new one of it: rosbag fix {bag} new.bag")
    if not head.startswith(_HEADS[suffix]):
        other = next((kind for kind, mark in _HEADS.items() if head.startswith(mark)), None)
        is_one = f"its content is a bag of the kind {other}: rename it" if other else "its content is something else"
        raise InputError(f"bag {bag} is no {suffix} bag: {is_one}")
    if suffix == ".db3":
        _refuse_short(bag, head, size)
    if suffix == ".mcap":
        _refuse_other_profile(bag, head)


def _refuse_other_profile(bag: Path, head: bytes) -> None:
    """An MCAP file begins with a record that names its profile (https://mcap.dev/spec). Raises: InputError for another
    than ROS 2's."""
    length = int.from_bytes(head[17:21], "little")
    profile = head[21 : 21 + length]
    if len(head) < 100 or length > 40 or profile == _PROFILE:
        return  # what is cut off or damaged its reader says
    said = profile.decode("utf-8", "replace")
    raise InputError(
        f"bag {bag} is an MCAP recording of the profile {said!r}, expected 'ros2': of ROS 1 give the .bag file, of "
        "others pictures and a table of poses"
    )


def _refuse_short(bag: Path, head: bytes, size: int) -> None:
    """SQLite reads a file that lacks its end until the end is asked for; the header counts the pages
    (https://sqlite.org/fileformat.html). Raises: InputError for fewer bytes than it says."""
    page = int.from_bytes(head[16:18], "big")
    expected = int.from_bytes(head[28:32], "big") * (65536 if page == 1 else page)
    if len(head) == 100 and head[24:28] == head[92:96] and size < expected:
        raise InputError(
            f"bag {bag} cannot be read: it is cut off or damaged (it has {size:,} of {expected:,} bytes); copy it "
            "again, or record it again"
        )
