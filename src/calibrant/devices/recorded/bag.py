"""A bag of ROS 1 or 2 as devices: `bag:FILE`, `bag:FILE,camera=/left/image_raw,tf=base_link:tool0`. Needs rosbags."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.data.devices import DeviceCalibration
from calibrant.detection.images.images import to_bgr8
from calibrant.devices.driver import Driver, Opened
from calibrant.devices.recorded.folder import chain_of
from calibrant.devices.recorded.session import Session, Shot, played
from calibrant.devices.spec import DeviceSpec
from calibrant.devices.stated import stated_in
from calibrant.errors import InputError
from calibrant.formats.bags.stamps import HEADER, STAMPS

if TYPE_CHECKING:
    from calibrant.formats.bags.pictures import Entry
    from calibrant.robots.chain import KinematicChain

MILLIMETRES = 1e-3
"""Of a whole number of a depth picture, as REP 118 has it; others are metres."""


def open_bag(spec: DeviceSpec) -> Opened:
    """A topic's pictures, and the robot of the transforms or the joint values. Raises: InputError."""
    session = bag_session(spec)
    topic = session.topic
    return played(session, topic, topic, _stated(Path(session.source), spec))


@dataclass(eq=False)
class BagSession(Session):
    """topic: of the colour pictures."""

    topic: str = ""


def bag_session(spec: DeviceSpec) -> BagSession:
    """The recording as it plays. Raises: InputError."""
    bag = Path(spec.need_place("a recording: bag:FILE")).expanduser()
    stamps = spec.one_of("stamps", STAMPS, HEADER)
    topics = _topics(bag)
    topic = _topic(bag, topics, spec.options.get("camera"), beside=spec.options.get("depth"))
    times = _times(topics[topic], topic, stamps)
    order = np.argsort(times, kind="stable")
    times, mine = times[order], [topics[topic][i] for i in order]
    T, joints, chain = _where_the_robot_was(bag, spec, times + _offset(spec), stamps)
    deep = _depths(bag, topics, spec.options.get("depth"), times, stamps)
    shots = tuple(
        Shot(f"{bag.name}/{entry.number:06d}", float(time_s), partial(_colour, bag, entry.number), depth)
        for entry, time_s, depth in zip(mine, times, deep, strict=True)
    )
    return BagSession(str(bag), shots, T, joints, chain, topic=topic)


def _offset(spec: DeviceSpec) -> float:
    """What is added to the pictures' times to be the robot's, seconds. Raises: InputError."""
    text = spec.options.get("clock-offset", "0s")
    unit = next((u for u in ("ms", "s") if text.endswith(u)), "")
    try:
        return float(text.removesuffix(unit)) * {"ms": 1e-3, "s": 1.0}[unit]
    except (ValueError, KeyError):
        raise InputError(f"{spec.text}: clock-offset is a time with its unit, such as 37ms; got {text!r}") from None


def _topics(bag: Path) -> dict[str, list[Entry]]:
    """Every picture, by topic. Raises: InputError for a bag without."""
    from calibrant.formats.bags.pictures import entries, frame_count

    frame_count(bag)  # says what the bag has instead of pictures
    out: dict[str, list[Entry]] = {}
    for entry in entries(bag):
        out.setdefault(entry.topic, []).append(entry)
    return out


def _topic(bag: Path, topics: dict[str, list[Entry]], asked: str | None, *, beside: str | None) -> str:
    """The topic of the colour pictures. Raises: InputError listing them."""
    rest = [t for t in topics if t != beside]
    if asked is None and len(rest) == 1:
        return rest[0]
    if asked in topics:
        return str(asked)
    listed = ", ".join(f"{t} ({len(found)} pictures)" for t, found in topics.items())
    what = "has pictures of several topics" if asked is None else f"has no pictures under {asked}"
    raise InputError(f"bag {bag} {what}: {listed}; name one with camera=TOPIC")


def _times(found: Sequence[Entry], topic: str, stamps: str) -> Array:
    from calibrant.formats.bags.stamps import seconds_of

    told, received = [e.stamp_ns for e in found], [e.received_ns for e in found]
    return seconds_of(told, received, what=f"the pictures of {topic}", stamps=stamps)


def _where_the_robot_was(
    bag: Path, spec: DeviceSpec, times: Array, stamps: str
) -> tuple[Array | None, Array | None, KinematicChain | None]:
    """T_base_gripper (n, 4, 4), joints (n, k) and the robot's chain, at the pictures' times. Raises: InputError."""
    from calibrant.formats.bags.bag import TRANSFORMS, opened
    from calibrant.formats.bags.joints import read_joints
    from calibrant.formats.bags.transforms import read_tree

    chain = chain_of(spec.options)
    with opened(bag) as recording:
        if chain is not None:
            motion = read_joints(recording, chain, spec.options.get("joints"), stamps=stamps)
            q = motion.at(times)
            return chain.forward(q), q, chain
        if "tf" not in spec.options and not recording.of_kind(TRANSFORMS):
            return None, None, None
        tree = read_tree(recording)
    frames = spec.options.get("tf") or tree.proposal()
    if frames is None:
        return None, None, None
    base, colon, tool = frames.partition(":")
    if not colon:
        raise InputError(f"{spec.text}: tf is BASE:TOOL, two frames of the recording; it has\n{tree.words()}")
    return tree.motion(base, tool, stamps=stamps).at(times), None, None


def _depths(
    bag: Path, topics: dict[str, list[Entry]], topic: str | None, times: Array, stamps: str
) -> list[Callable[[], NDArray[np.float32]] | None]:
    """The depth picture next in time to each colour picture, where one is as near as half the way to another."""
    if topic is None:
        return [None] * len(times)
    if topic not in topics:
        raise InputError(f"bag {bag} has no pictures under {topic}; it has {', '.join(topics)}")
    found = topics[topic]
    at = _times(found, topic, stamps)
    near = np.argmin(np.abs(at[None, :] - times[:, None]), axis=1)
    between = float(np.median(np.diff(np.sort(at)))) if len(at) > 1 else np.inf
    close = np.abs(at[near] - times) <= 0.5 * between
    return [partial(_metres, bag, found[k].number) if ok else None for k, ok in zip(near, close, strict=True)]


def _colour(bag: Path, number: int) -> NDArray[np.uint8]:
    from calibrant.formats.bags.pictures import read_frame

    return to_bgr8(read_frame(bag, number))


def _metres(bag: Path, number: int) -> NDArray[np.float32]:
    from calibrant.formats.bags.pictures import read_frame

    given = read_frame(bag, number)
    if given.ndim != 2 or given.dtype == np.uint8:
        raise InputError(f"picture {number} of {bag} is no depth: {given.shape} of {given.dtype}")
    scale = MILLIMETRES if np.issubdtype(given.dtype, np.integer) else 1.0
    z = scale * given.astype(np.float64)
    z[~(np.isfinite(z) & (z > 0))] = np.nan
    return z.astype(np.float32)


def _stated(bag: Path, spec: DeviceSpec) -> DeviceCalibration:
    """By a file (lens=FILE), or by a topic of camera_info (info=TOPIC)."""
    if "info" in spec.options:
        return stated_in(bag / spec.options["info"].lstrip("/"))
    return stated_in(spec.options.get("lens"))


DRIVER = Driver(
    name="bag",
    form="bag:FILE[,camera=TOPIC,depth=TOPIC,info=TOPIC,tf=BASE:TOOL,robot=ARM,joints=TOPIC,clock-offset=37ms …]",
    gives=("robot", "camera"),
    says="a recording of ROS 1 or 2: pictures, depth, transforms or joint values",
    tested="bags written by rosbags, ROS 1 and ROS 2",
    connect=open_bag,
    keys=("camera", "depth", "info", "lens", "tf", "robot", "link", "base", "joints", "stamps", "clock-offset"),
    extra="ros",
)
