"""Which pictures of a bag are meant, and when they were taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from calibrant.errors import InputError
from calibrant.reading.notes import note
from calibrant.tasks.options.bags import BagOptions

if TYPE_CHECKING:
    from calibrant.arrays import Array
    from calibrant.formats.bags.pictures import Entry

ONLY = ""
"""The name of a camera that was given none."""
_PACKED = "/compressed"


@dataclass(frozen=True, eq=False)
class Recorded:
    """A camera's pictures in a bag, in the order taken: files, frames of the bag, and seconds (n,) since 1970."""

    topic: str
    entries: tuple[Entry, ...]
    files: tuple[Path, ...]
    seconds: Array

    def only(self, keep: Sequence[int]) -> Recorded:
        """Some of them, by position."""
        return Recorded(
            self.topic,
            tuple(self.entries[i] for i in keep),
            tuple(self.files[i] for i in keep),
            self.seconds[list(keep)],
        )


def recorded_pictures(options: BagOptions, *, stamps: str | None = None) -> dict[str, Recorded]:
    """The pictures of every camera asked for, by its name.

    Raises: InputError for topics that are not there (those that are there are listed), or none told of several;
    cameras with two topics; a clock that jumps.
    """
    import numpy as np

    from calibrant.formats.bags.pictures import entries, name_of
    from calibrant.formats.bags.stamps import seconds_of

    options.check()
    if options.bag is None:
        raise InputError("no bag is given: --bag FILE")
    bag = options.bag.expanduser()
    named = _named_topics(bag, options.image_topic)
    out: dict[str, Recorded] = {}
    for name, topic in named.items():
        mine = [e for e in entries(bag) if e.topic == topic]
        seconds = seconds_of(
            [e.stamp_ns for e in mine],
            [e.received_ns for e in mine],
            what=f"the pictures of {topic}",
            stamps=stamps or options.stamps,
        )
        if options.stamps == "header" and not any(e.stamp_ns for e in mine):
            note(f"{bag}: the pictures of {topic} have no times of their own; those of the recorder count")
        order = np.argsort(seconds, kind="stable")
        first = Recorded(topic, tuple(mine), tuple(name_of(bag, e.number) for e in mine), seconds)
        out[name] = first.only([int(i) for i in order])
    return out


def check_topics(options: BagOptions) -> None:
    """Raises: InputError for a bag that cannot be opened, or topics that it has no pictures under, by its index."""
    from calibrant.formats.bags.bag import PICTURES, opened

    if options.bag is None:
        return
    with opened(options.bag.expanduser()) as bag:
        there = {t.name: t.count for t in bag.topics if t.kind in PICTURES and t.count}
    if not there:
        from calibrant.formats.bags.pictures import frame_count

        frame_count(options.bag.expanduser())  # says what the bag has instead
    for text in options.image_topic:
        topic = text.partition("=")[2] or text
        if topic not in there and topic.rstrip("/") + _PACKED not in there:
            listed = ", ".join(f"{name} ({n} pictures)" for name, n in there.items())
            raise InputError(f"--image-topic {text}: the bag has no pictures under {topic}; it has {listed}")


def _named_topics(bag: Path, asked: Sequence[str]) -> dict[str, str]:
    """Topics by the camera's name. Raises: InputError."""
    from calibrant.formats.bags.pictures import entries

    there = dict.fromkeys(e.topic for e in entries(bag))
    if not there:
        from calibrant.formats.bags.pictures import frame_count

        frame_count(bag)  # says what the bag has instead
    if not asked:
        if len(there) > 1:
            raise InputError(
                f"bag {bag} has pictures of several cameras: {_counted(bag)}; say which: --image-topic "
                f"{next(iter(there))}"
            )
        (topic,) = there
        note(f"{bag}: the pictures are of {topic}, the only topic with some")
        return {ONLY: topic}
    out: dict[str, str] = {}
    for text in asked:
        name, equals, topic = text.partition("=")
        name, topic = (name, topic) if equals else (ONLY, text)
        if topic not in there and topic.rstrip("/") + _PACKED in there:
            topic = topic.rstrip("/") + _PACKED
        if topic not in there:
            raise InputError(f"--image-topic {text}: the bag has no pictures under {topic}; it has {_counted(bag)}")
        if name in out or topic in out.values():
            raise InputError(f"--image-topic {text}: given twice; each camera has a topic of its own, NAME=TOPIC")
        out[name] = topic
    if ONLY in out and len(out) > 1:
        raise InputError(f"--image-topic {out[ONLY]} has no name; of several cameras each needs one: NAME=TOPIC")
    return out


def _counted(bag: Path) -> str:
    """Every topic with pictures, and how many."""
    from collections import Counter

    from calibrant.formats.bags.pictures import entries

    return ", ".join(f"{topic} ({n} pictures)" for topic, n in Counter(e.topic for e in entries(bag)).items())


def bag_files(bag: Path) -> list[str]:
    """The files a bag consists of, for the record of inputs."""
    from calibrant.formats.bags.kinds import files_of

    return [str(f) for f in files_of(bag.expanduser())]


def cameras_of_bag(bag: Path, values: Sequence[str]) -> tuple[str, ...]:
    """Values of --camera, those that are topics (/camera/camera_info) as places in the bag."""
    out = []
    for value in values:
        name, equals, file = value.rpartition("=")
        inside = file.startswith("/") and not Path(file).exists()
        out.append(f"{name}{equals}{bag.expanduser()}{file}" if inside else value)
    return tuple(out)
