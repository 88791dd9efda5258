"""A bag's pictures as frames: bag.mcap/000120 is picture 120 of all its image topics together, counted from 0 in the
order they were received, so that a number says which picture of which topic is meant.

One pass lists when each was taken; a picture is then read by its moment, and one is in memory at a time.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.errors import InputError
from calibrant.formats.bags.bag import COMPRESSED, PICTURES, Bag, Message, opened
from calibrant.formats.bags.encodings import decoded_compressed, decoded_image
from calibrant.formats.bags.kinds import check_bag, files_of


@dataclass(frozen=True)
class Entry:
    """A picture of a bag: its number, topic, when it was received, and what its header says; rank: of pictures of its
    topic that were received at that nanosecond, which."""

    number: int
    topic: str
    received_ns: int
    stamp_ns: int
    rank: int


def entries(bag: Path) -> tuple[Entry, ...]:
    """Every picture of a bag, in the order received. Raises: InputError for a bag that cannot be read, or has none."""
    check_bag(bag)
    # A bag that was changed since is another one.
    return _entries(bag, tuple((f.stat().st_size, f.stat().st_mtime_ns) for f in files_of(bag)))


@lru_cache(maxsize=8)
def _entries(bag: Path, state: tuple[tuple[int, int], ...]) -> tuple[Entry, ...]:
    found: list[Entry] = []
    with opened(bag) as recording:
        topics = recording.of_kind(*PICTURES)
        seen: list[tuple[int, str, int]] = []
        for message in recording.messages(topics):
            seen.append((message.received_ns, message.topic, message.stamp_ns or 0))
    seen.sort(key=lambda s: (s[0], s[1]))
    for number, (received, topic, stamp) in enumerate(seen):
        before = found[-1] if found else None
        again = before is not None and (before.received_ns, before.topic) == (received, topic)
        found.append(Entry(number, topic, received, stamp, before.rank + 1 if again and before is not None else 0))
    return tuple(found)


def name_of(bag: Path, number: int) -> Path:
    """The name of a picture, as of a file."""
    return bag / f"{number:06d}"


def frame_count(bag: Path) -> int:
    """How many pictures a bag holds, over all topics. Raises: InputError where it holds none."""
    return len(_some(bag))


def frame_rate(bag: Path) -> None:
    """A bag states no rate: its pictures have times."""


def frames(bag: Path, every: int | None = None) -> list[Path]:
    """Names of the pictures of a bag's only image topic, every n-th.

    Raises: InputError where several topics have pictures.
    """
    topics = list(dict.fromkeys(e.topic for e in _some(bag)))
    if len(topics) > 1:
        raise InputError(
            f"bag {bag}: which pictures? It has {', '.join(topics)}; name one with --bag and --image-topic"
        )
    return [name_of(bag, e.number) for e in entries(bag)[:: every or 1]]


def _some(bag: Path) -> tuple[Entry, ...]:
    found = entries(bag)
    if not found:
        with opened(bag) as recording:
            listed = ", ".join(f"{t.name} ({t.kind})" for t in recording.topics) or "no topic"
        raise InputError(f"bag {bag} holds no pictures (sensor_msgs Image or CompressedImage); it has {listed}")
    return found


def read_frame(bag: Path, number: int) -> NDArray[Any]:
    """A picture (h, w) grey or (h, w, 3 or 4) BGR. Raises: InputError for a number that is none, or a damaged one."""
    found = entries(bag)
    if number >= len(found):
        raise InputError(f"bag {bag} has {len(found)} pictures, counted from 0; there is no {number}")
    return _reader(str(bag)).read(found[number])


class _Reader:
    """A bag that stays open while its pictures are read."""

    def __init__(self, bag: Path) -> None:
        self.bag, self.stack = bag, ExitStack()
        self.recording: Bag = self.stack.enter_context(opened(bag))

    def __del__(self) -> None:
        if hasattr(self, "stack"):
            self.stack.close()

    def read(self, entry: Entry) -> NDArray[Any]:
        at = entry.received_ns
        same = self.recording.messages([entry.topic], since_ns=at, before_ns=at + 1)
        message = next((m for k, m in enumerate(same) if k == entry.rank), None)
        if message is None:
            raise InputError(f"bag {self.bag} has changed while it was read: picture {entry.number} is gone")
        return decoded(self.recording, message, str(name_of(self.bag, entry.number)))


@lru_cache(maxsize=2)
def _reader(bag: str) -> _Reader:
    return _Reader(Path(bag))


def decoded(recording: Bag, message: Message, where: str) -> NDArray[Any]:
    """The picture in a message. Raises: InputError naming `where`."""
    content = recording.read(message)
    return (decoded_compressed if message.kind == COMPRESSED else decoded_image)(content, where)


def pictures(bag: Path, wanted: Sequence[Entry]) -> Iterator[tuple[Entry, NDArray[Any]]]:
    """Some pictures of a bag, one at a time, in the order received."""
    reader = _reader(str(bag))
    for entry in sorted(wanted, key=lambda e: e.number):
        yield entry, np.asarray(reader.read(entry))
