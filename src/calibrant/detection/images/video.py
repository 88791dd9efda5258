"""Videos as images: a frame has a name like a file's, video.mp4/000120, and is read as one.

A video stands for its frames, or for the sharpest of every n frames: video.mp4@n. Without n, all frames of a short
video are taken and about MOST_FRAMES of a long one. Frames are read in order where possible: going back means decoding
from the start.
"""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrant.errors import InputError
from calibrant.opencv import cv2

EXTENSIONS = (".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".wmv")
MOST_FRAMES = 300
"""More views of a board that moves before a camera repeat what is known already."""
SHARPNESS_SIDE_PX = 320
"""Sharpness is compared in pictures of about this many pixels: focus and motion blur show, noise averages out."""

_EVERY = re.compile(r"(?P<file>.+)@(?P<every>\d+)")
_FRAME = re.compile(r"\d{6,}")


def video_of(path: Path) -> tuple[Path, int | None] | None:
    """The video and n of a path to a video, with or without @n; None when it is none."""
    if path.suffix.lower() in EXTENSIONS and path.is_file():
        return path, None
    match = _EVERY.fullmatch(str(path))
    if match is None or Path(match["file"]).suffix.lower() not in EXTENSIONS:
        return None
    if not Path(match["file"]).is_file():
        raise InputError(f"video {match['file']} does not exist")
    if int(match["every"]) < 1:
        raise InputError(f"{path}: the number after @ says of how many frames one is taken; it is at least 1")
    return Path(match["file"]), int(match["every"])


def frame_of(path: Path) -> tuple[Path, int] | None:
    """The video and frame number of a frame's name; None when it is none."""
    video = path.parent
    if not _FRAME.fullmatch(path.name) or video.suffix.lower() not in EXTENSIONS or not video.is_file():
        return None
    return video, int(path.name)


def frames(video: Path, every: int | None = None) -> list[Path]:
    """Names of a video's frames: the sharpest of every `every` in turn.

    Raises: InputError when the video cannot be read, or holds no frame.
    """
    if every == 1:
        return [_name(video, i) for i in range(_count(video))]
    if every is None:
        every = max(1, -(-_count(video) // MOST_FRAMES))
        if every == 1:
            return frames(video, 1)
    capture = _opened(video)
    best: list[tuple[float, int]] = []
    number = 0
    while True:
        ok, image = capture.read()
        if not ok:
            break
        here = (_sharpness(image), number)
        if number % every == 0:
            best.append(here)
        best[-1] = max(best[-1], here)
        number += 1
    return [_name(video, i) for _, i in best]


def read_frame(video: Path, number: int) -> NDArray[np.uint8]:
    """A frame (h, w, 3) BGR. Raises: InputError when the video cannot be read or ends before it."""
    image = _reader(str(video)).read(number)
    if image is None:
        raise InputError(f"video {video} has no frame {number} that can be decoded")
    return image


class _Reader:
    """A video that is open at some frame."""

    def __init__(self, video: Path) -> None:
        self.video = video
        self.capture = _opened(video)
        self.next = 0

    def read(self, number: int) -> NDArray[np.uint8] | None:
        # Positions asked of a decoder are rounded to what its index says; counting from the start is exact.
        if number < self.next:
            self.capture.release()
            self.capture, self.next = _opened(self.video), 0
        while self.next < number:
            if not self.capture.grab():
                return None
            self.next += 1
        ok, image = self.capture.read()
        self.next += 1
        return np.asarray(image, np.uint8) if ok else None


@lru_cache(maxsize=2)
def _reader(video: str) -> _Reader:
    return _Reader(Path(video))


def _opened(video: Path) -> cv2.VideoCapture:
    capture = cv2.VideoCapture(str(video))
    if not capture.isOpened():
        raise InputError(f"video {video} cannot be read: it is damaged, or its format is not known")
    return capture


@lru_cache(maxsize=16)
def _count(video: Path) -> int:
    """How many frames can be decoded; what the file says of itself is not always so."""
    capture = _opened(video)
    count = 0
    while capture.grab():
        count += 1
    if count == 0:
        raise InputError(f"video {video} holds no frame that can be decoded")
    return count


def _name(video: Path, number: int) -> Path:
    return video / f"{number:06d}"


def _sharpness(image: NDArray) -> float:
    """Variance of the Laplacian of the grey values."""
    factor = max(1, round(max(image.shape[:2]) / SHARPNESS_SIDE_PX))
    small = cv2.resize(image, (image.shape[1] // factor, image.shape[0] // factor), interpolation=cv2.INTER_AREA)
    return float(cv2.Laplacian(cv2.cvtColor(small, cv2.COLOR_BGR2GRAY), cv2.CV_32F).var())
