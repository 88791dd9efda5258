"""When the moments of several cameras were, in seconds: by a video's frame rate, time stamps in names, or --fps."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from calibrant.errors import InputError
from calibrant.tasks.inputs.image_moments import ImageMoments, Lists, moment_names, stamp_s

_SAME_RATE = 0.01
"""Rates of one clock as containers round them: 29.97 and 30 are one."""


def moment_times(lists: Lists, found: ImageMoments, *, fps: float | None) -> dict[str, float]:
    """Seconds by the moment's name; empty where nothing tells them.

    fps: pictures a second of numbered images, or of videos that state another rate.
    Raises: InputError for a rate that is none, images without numbers, videos of several rates.
    """
    if fps is not None and not 0 < fps < float("inf"):
        raise InputError(f"--fps takes pictures a second, above 0; got {fps:g}")
    rate = fps or _rate_of_videos(lists)
    firsts = [
        [(files[i], i) for files, i in zip(lists.values(), row) if i is not None] for row in found.rows
    ]  # fmt: skip
    if rate is not None:
        seconds: Sequence[float | None] = [_number(*row[0], found) / rate for row in firsts]
    elif found.rule == "time":
        stamps = [[stamp_s(file.stem) or 0.0 for file, _ in row] for row in firsts]
        first = min((s[0] for s in stamps), default=0.0)
        seconds = [sum(t - first for t in s) / len(s) for s in stamps]
    else:
        return {}
    return {name: s for name, s in zip(moment_names(lists, found), seconds) if s is not None}


def _rate_of_videos(lists: Lists) -> float | None:
    """The frame rate of all cameras' videos; None where images are no frames, or no rate is stated."""
    from calibrant.detection.images.files import frame_of

    places = [frame_of(file) for files in lists.values() for file in files]
    videos = {place[0] for place in places if place is not None}
    if not videos or None in places:
        return None
    from calibrant.detection.images.recordings import source_of

    rates = {video: source_of(video).frame_rate(video) for video in sorted(videos)}
    told = {video: rate for video, rate in rates.items() if rate is not None}
    if len(told) < len(rates):
        return None
    low, high = min(told, key=lambda v: told[v]), max(told, key=lambda v: told[v])
    if told[high] > (1 + _SAME_RATE) * told[low]:
        raise InputError(
            f"{low} states {told[low]:g} frames a second and {high} {told[high]:g}: frames of one number are no "
            "moment; give videos that were taken together, or --fps where the files state it wrongly"
        )
    return told[low]


def _number(file: Path, position: int, found: ImageMoments) -> int:
    """The number of a picture in its series: the last one in its name; by order, where it stands."""
    if found.rule == "order":
        return position
    numbers = re.findall(r"\d+", file.stem)
    if not numbers:
        raise InputError(f"--fps: {file.name} has no number that says which picture of its series it is; number them")
    return int(numbers[-1])
