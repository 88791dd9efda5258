"""A bag as topics and messages, one at a time, through rosbags; a bag is never in memory whole.

Messages are read as the standard packages define them (sensor_msgs, tf2_msgs, geometry_msgs of ROS 1 Noetic and ROS 2
Jazzy, alike in all releases), so that a type of one's own in the bag is in nobody's way.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from calibrant.cancel import checkpoint
from calibrant.errors import InputError, MissingExtraError
from calibrant.formats.bags.kinds import check_bag

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
JOINTS = "sensor_msgs/msg/JointState"
PICTURES = (IMAGE, COMPRESSED)
_OLD_TRANSFORMS = "tf/msg/tfMessage"
_TRANSFORMS_TEXT = "geometry_msgs/TransformStamped[] transforms\n"
_HEADED = (*PICTURES, CAMERA_INFO, JOINTS)
"""Messages that begin with a header."""
_CURES = {
    ".bag": "rosbag reindex repairs a recording that was not ended",
    ".mcap": "mcap recover (https://mcap.dev/guides/cli) repairs a recording that was not ended",
    ".db3": "ros2 bag reindex repairs a recording that was not ended",
}


@dataclass(frozen=True)
class Topic:
    """kind: its message type as ROS 2 writes it; count: messages."""

    name: str
    kind: str
    count: int


@dataclass(frozen=True, eq=False)
class Message:
    """received_ns: when it was recorded; stamp_ns: what its header says, where it has one; raw: its bytes."""

    topic: str
    kind: str
    received_ns: int
    stamp_ns: int | None
    raw: bytes


class Bag:
    """An open bag. See `opened`."""

    def __init__(self, path: Path, reader: Any, store: Any, *, ros1: bool) -> None:
        self.path, self._reader, self._store, self._ros1 = path, reader, store, ros1

    @property
    def topics(self) -> tuple[Topic, ...]:
        """Every topic, by name."""
        found: dict[str, Topic] = {}
        for c in self._reader.connections:
            before = found[c.topic].count if c.topic in found else 0
            found[c.topic] = Topic(c.topic, _kind(c.msgtype), before + c.msgcount)
        return tuple(found[name] for name in sorted(found))

    def of_kind(self, *kinds: str) -> list[str]:
        """Names of the topics of some message types that have messages."""
        return [t.name for t in self.topics if t.kind in kinds and t.count]

    def messages(
        self, topics: Sequence[str], *, since_ns: int | None = None, before_ns: int | None = None
    ) -> Iterator[Message]:
        """Messages of the topics in the order they were received, one at a time. Raises: InputError for a bag that is
        cut off or damaged."""
        connections = [c for c in self._reader.connections if c.topic in topics]
        if not connections:
            return
        source = iter(self._reader.messages(connections, start=since_ns, stop=before_ns))
        while True:
            checkpoint()
            with _damage_said(self.path):
                found = next(source, None)
            if found is None:
                return
            connection, received, raw = found
            kind = _kind(connection.msgtype)
            yield Message(connection.topic, kind, received, self._stamp(kind, raw), bytes(raw))

    def read(self, message: Message) -> Any:
        """The message's fields. Raises: InputError for bytes that are no such message."""
        decode = self._store.deserialize_ros1 if self._ros1 else self._store.deserialize_cdr
        try:
            return decode(message.raw, message.kind)
        except _damage() as error:
            raise InputError(
                f"bag {self.path}: a message of {message.topic} is damaged: {error or type(error).__name__}"
            ) from error

    def _stamp(self, kind: str, raw: bytes) -> int | None:
        """Seconds and nanoseconds stand behind ROS 1's seq and behind ROS 2's four bytes of encapsulation alike."""
        if kind not in _HEADED or len(raw) < 12:
            return None
        order = "<" if self._ros1 or raw[1] & 1 else ">"
        seconds, nanoseconds = struct.unpack_from(f"{order}iI", raw, 4)
        return int(seconds) * 1_000_000_000 + int(nanoseconds)


@contextmanager
def opened(path: str | Path) -> Iterator[Bag]:
    """An open bag. Raises: InputError for a file that is no bag, is cut off or damaged, also while it is read;
    MissingExtraError without rosbags."""
    bag = Path(path)
    check_bag(bag)
    try:
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise MissingExtraError(
            f'bag {bag}: bags are read by rosbags, which is not installed: pip install "calibrant[ros]"'
        ) from None
    ros1 = bag.suffix.lower() == ".bag" and bag.is_file()
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    if TRANSFORMS not in store.fielddefs:
        store.register(get_types_from_msg(_TRANSFORMS_TEXT, TRANSFORMS))
    with ExitStack() as stack:
        with _damage_said(bag):
            reader = stack.enter_context(Reader1(bag) if ros1 else Reader2(bag))
        yield Bag(bag, reader, store, ros1=ros1)


@contextmanager
def _damage_said(bag: Path) -> Iterator[None]:
    """Raises: InputError for what rosbags and the libraries below it raise for bytes that are no bag's."""
    try:
        yield
    except _damage() as error:
        cure = _CURES.get(bag.suffix.lower(), _CURES[".db3"])
        raise InputError(
            f"bag {bag} cannot be read: it is cut off or damaged ({str(error).rstrip('.') or type(error).__name__}); "
            f"{cure}, or record it again"
        ) from error


def _damage() -> tuple[type[Exception], ...]:
    """rosbags' own errors, and those of SQLite and of the packers below it where it uses these."""
    from rosbags.rosbag1 import ReaderError as Error1
    from rosbags.rosbag2 import ReaderError as Error2
    from rosbags.serde import SerdeError

    below: list[type[Exception]] = []
    for module, name in (("apsw", "Error"), ("sqlite3", "Error"), ("backports.zstd", "ZstdError")):
        try:
            below.append(getattr(import_module(module), name))
        except ImportError:
            continue
    wrong = (struct.error, AssertionError, ValueError, LookupError, TypeError, ArithmeticError, EOFError, OSError)
    return (Error1, Error2, SerdeError, *wrong, RuntimeError, MemoryError, *below)


def _kind(name: str) -> str:
    return TRANSFORMS if name == _OLD_TRANSFORMS else name
