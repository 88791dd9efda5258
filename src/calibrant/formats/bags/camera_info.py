"""The camera that a bag's camera_info describes: bag.mcap/camera/camera_info is the message under that topic."""

from __future__ import annotations

from pathlib import Path

from calibrant.errors import InputError
from calibrant.formats.bags.bag import CAMERA_INFO, opened
from calibrant.formats.bags.kinds import is_bag
from calibrant.reading.notes import note


def topic_of(path: Path) -> tuple[Path, str] | None:
    """The bag and topic of a path into a bag; None of any other path."""
    if path.exists():
        return None
    bag = next((parent for parent in path.parents if is_bag(parent)), None)
    return None if bag is None else (bag, "/" + path.relative_to(bag).as_posix())


def camera_info_fields(bag: Path, topic: str) -> dict[str, object]:
    """The first message under the topic, as the fields of a described camera.

    Raises: InputError for a topic that has none (those that do are listed), a camera that was never calibrated (K of
    zeros), or two cameras under one topic.
    """
    with opened(bag) as recording:
        there = recording.of_kind(CAMERA_INFO)
        if topic not in there:
            raise InputError(f"{bag} has no camera_info under {topic}; it has {', '.join(there) or 'none'}")
        first = None
        for message in recording.messages([topic]):
            info = recording.read(message)
            # ROS 1 writes the names of matrices with large letters.
            K, D = (info.k, info.d) if hasattr(info, "k") else (info.K, info.D)
            said = (int(info.width), int(info.height), str(info.distortion_model), tuple(K), tuple(D))
            if first is not None and said != first:
                note(f"{bag}{topic}: its camera changes along the way; the first message's counts")
                break
            first = first or said
            if first == said and (info.binning_x > 1 or info.binning_y > 1 or info.roi.width not in (0, info.width)):
                raise InputError(
                    f"{bag}{topic}: the pictures are binned or a part of the sensor's (binning {info.binning_x}x"
                    f"{info.binning_y}, region {info.roi.width}x{info.roi.height}), which its K is not of; give the "
                    "camera as a file"
                )
    if first is None or not any(first[3]):
        raise InputError(f"{bag}{topic}: its K is zero: that camera was never calibrated; leave --camera out")
    width, height, model, k, d = first
    return {
        "image_width": width,
        "image_height": height,
        "distortion_model": model or "plumb_bob",
        "K": [float(v) for v in k],
        "D": [float(v) for v in d],
    }
