"""Videos as images: a frame has a name like a file's, video.mp4/000120, and is read as one.

A video stands for its frames, or for the sharpest of every n frames: video.mp4@n. Without n, all frames of a short
video are taken and about MOST_FRAMES of a long one. Frames are read in order where possible: going back means decoding
from the start.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrant.detection.images.sharpness import sharpest_together, sharpness
from calibrant.errors import InputError
from calibrant.formats.images.picture_bytes import MOST_PIXELS
from calibrant.opencv import cv2
from calibrant.reading.files import open_file

MOST_FRAMES = 300
"""More views of a board that moves before a camera repeat what is known already."""


def frames(video: Path, every: int | None = None) -> list[Path]:
    """Names of a video's frames: the sharpest of every `every` in turn.

    Raises: InputError when the video cannot be read, or holds no frame.
    """
    if every == 1:
        return [_name(video, i) for i in range(frame_count(video))]
    if every is None:
        every = max(1, -(-frame_count(video) // MOST_FRAMES))
        if every == 1:
            return frames(video, 1)
    capture = _opened(video)
    best: list[tuple[float, int]] = []
    number = 0
    while True:
        ok, image = capture.read()
        if not ok:
            break
        here = (sharpness(image), number)
        if number % every == 0:
            best.append(here)
        best[-1] = max(best[-1], here)
        number += 1
    return [_name(video, i) for _, i in best]


def frames_together(videos: Sequence[Path], every: int | None = None) -> list[list[Path]]:
    """Names of the frames of videos whose frames of one number were taken at once: the same numbers of each.

    Of every `every` in turn the one is taken whose least sharp picture is the sharpest, each beside its own video.
    Raises: InputError when a video cannot be read, or holds no frame.
    """
    count = min(map(frame_count, videos))
    every = max(1, -(-count // MOST_FRAMES)) if every is None else every
    numbers = list(range(count))
    if every > 1:
        sharp = np.array([_sharpnesses(video, count) for video in videos])
        numbers = sharpest_together(sharp, every)
    return [[_name(video, i) for i in numbers] for video in videos]


def frame_rate(video: Path) -> float | None:
    """Frames a second that a video states; None where it states none. Raises: InputError when it cannot be read."""
    rate = float(_opened(video).get(cv2.CAP_PROP_FPS))
    return rate if 0 < rate < float("inf") else None


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
    open_file(video, what="video").close()  # the decoder would wait for a pipe
    capture = cv2.VideoCapture(str(video))
    if not capture.isOpened():
        raise InputError(f"video {video} cannot be read: it is damaged, or its format is not known")
    width, height = (int(capture.get(side)) for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    if width * height > MOST_PIXELS:
        raise InputError(
            f"video {video} states frames of {width}x{height} px; expected {MOST_PIXELS / 1e6:g} megapixels at most"
        )
    return capture


def _sharpnesses(video: Path, count: int) -> list[float]:
    capture = _opened(video)
    return [sharpness(np.asarray(capture.read()[1])) for _ in range(count)]


@lru_cache(maxsize=16)
def frame_count(video: Path) -> int:
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
