"""Views taken one after the other from a running camera: which frame is worth keeping, and which view is still missing.

A frame is kept when the board is found in it, stands still, is sharp, and shows something that no kept view shows.
Where the board is, how large and how skewed, are four numbers between 0 and 1 as in ROS's camera_calibration: X and Y
of its middle over the room that it has in the picture, the root of the part of the picture it covers, and twice the
deviation of a corner of its outline from a right angle, radians.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.detection.detection import Detection
from calibrant.detection.images.files import VIDEOS, expand
from calibrant.detection.images.images import load_grey, to_grey8
from calibrant.errors import InputError
from calibrant.geometry.projective import apply_homography, homography
from calibrant.opencv import cv2
from calibrant.targets.target import Target

STILL_PART = 0.002
"""Of the image's width: a board that moved less since the last frame blurs by less than a pixel or two."""
SHARP_PART = 0.5
"""Of the sharpness of the views kept so far (their median): less is motion or lost focus."""
DIFFERENT = 0.2
"""Sum of the differences of the four numbers from those of every kept view."""
WANTED = {"X": 0.7, "Y": 0.7, "size": 0.4, "skew": 0.5}
"""Range of each number over the kept views that counts as covered: positions to both sides, near and far, tilted."""


@dataclass(frozen=True)
class Frame:
    """A picture of a source: its name, its grey values (h, w), and whether the next one follows within moments."""

    name: str
    grey: NDArray[np.uint8]
    running: bool


@dataclass(frozen=True, eq=False)
class Session:
    """The state after some frames: numbers (n, 4) and sharpness (n,) of the kept views, and the last detection."""

    target: Target
    numbers: tuple[Array, ...] = ()
    sharpness: tuple[float, ...] = ()
    last: Detection | None = None

    def look(self, frame: Frame, detection: Detection) -> tuple[Session, str | None]:
        """The session after a frame, and why it was not kept; None when it was."""
        after = replace(self, last=detection)
        if not detection.found:
            return after, "no board"
        if frame.running and not self._still(detection, frame.grey.shape[1]):
            return after, "moving"
        sharp = sharpness(frame.grey, detection.uv)
        if self.sharpness and sharp < SHARP_PART * float(np.median(self.sharpness)):
            return after, "not sharp"
        here = view_numbers(self.target, detection, frame.grey.shape)
        if here is None:
            return after, "too few points"
        if any(float(np.abs(here - there).sum()) < DIFFERENT for there in self.numbers):
            return after, "seen before"
        return replace(after, numbers=(*self.numbers, here), sharpness=(*self.sharpness, sharp)), None

    def coverage(self) -> dict[str, float]:
        """How much of each wanted range the kept views cover, 0 to 1, by name. Size and skew count from 0."""
        if not self.numbers:
            return dict.fromkeys(WANTED, 0.0)
        numbers = np.array(self.numbers)
        low = np.where([name in ("size", "skew") for name in WANTED], 0.0, numbers.min(axis=0))
        spans = numbers.max(axis=0) - low
        return {name: float(min(1.0, span / WANTED[name])) for name, span in zip(WANTED, spans, strict=True)}

    def missing(self) -> str | None:
        """The view to take next, in words; None when all are covered."""
        coverage = self.coverage()
        worst = min(coverage, key=lambda name: coverage[name])
        if coverage[worst] >= 1.0:
            return None
        if worst not in ("X", "Y") or not self.numbers:
            words = {"size": "hold the board nearer", "skew": "tilt the board, by up to 45 degrees"}
            return words.get(worst, "show the board")
        middle = float(np.mean([n[list(WANTED).index(worst)] for n in self.numbers]))
        sides = ("left", "right") if worst == "X" else ("top", "bottom")
        return f"move the board to the {sides[0] if middle > 0.5 else sides[1]} of the picture"

    def _still(self, detection: Detection, width: int) -> bool:
        if self.last is None or not self.last.found:
            return False
        _, one, other = np.intersect1d(detection.point_ids, self.last.point_ids, return_indices=True)
        moved = np.abs(detection.uv[one] - self.last.uv[other])
        return len(one) > 0 and float(moved.max()) < STILL_PART * width


def view_numbers(target: Target, detection: Detection, shape: tuple[int, ...]) -> Array | None:
    """X, Y, size and skew of a view, (4,); None when its points do not give the board's outline."""
    row_of = {int(label): row for row, label in enumerate(target.point_ids)}
    points = target.points[[row_of[int(label)] for label in detection.point_ids]]
    if len(points) < 4:
        return None
    (x0, y0), (x1, y1) = target.points[:, :2].min(axis=0), target.points[:, :2].max(axis=0)
    try:
        H = homography(points[:, :2], detection.uv)
    except InputError:
        # Points on one line, or of a solid: they have no outline in the picture.
        return None
    outline = apply_homography(H, np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))
    height, width = shape[:2]
    area = 0.5 * abs(float(_cross(outline[2] - outline[0], outline[3] - outline[1])))
    border = np.sqrt(area)
    room = np.maximum(np.array([width, height]) - border, 1.0)
    x, y = np.clip((outline.mean(axis=0) - 0.5 * border) / room, 0.0, 1.0)
    a, b = outline[0] - outline[1], outline[2] - outline[1]
    angle = np.arctan2(abs(float(_cross(a, b))), float(a @ b))
    skew = min(1.0, 2.0 * abs(0.5 * np.pi - float(angle)))
    return np.array([x, y, np.sqrt(min(1.0, area / (width * height))), skew])


def sharpness(grey: NDArray[np.uint8], uv: Array) -> float:
    """Variance of the Laplacian over the box around the board's points."""
    low = np.maximum(np.floor(uv.min(axis=0)), 0).astype(int)
    high = np.ceil(uv.max(axis=0)).astype(int) + 2
    return float(cv2.Laplacian(grey[low[1] : high[1], low[0] : high[0]], cv2.CV_32F).var())


def frames_from(source: str) -> Iterator[Frame]:
    """Frames of a camera (its number), a video file, or pictures of a folder, which play the camera.

    Raises: InputError when there is nothing to read.
    """
    if not source.strip().isdigit() and Path(source).suffix.lower() not in VIDEOS:
        for file in expand(source):
            yield Frame(file.name, load_grey(file), running=False)
        return
    capture = open_capture(source)
    try:
        count = 0
        while True:
            ok, image = capture.read()
            if not ok:
                return
            yield Frame(f"{count:06d}.png", to_grey8(image), running=True)
            count += 1
    finally:
        capture.release()


def open_capture(source: str) -> cv2.VideoCapture:
    """OpenCV's capture of a camera (its number), a video file or a stream's address. Raises: InputError."""
    number = source.strip()
    capture = cv2.VideoCapture(int(number) if number.isdigit() else source)
    if not capture.isOpened():
        kind = f"camera {number}" if number.isdigit() else f"video {source}"
        raise InputError(f"{kind} cannot be opened; give a camera's number, a video file or a folder of pictures")
    return capture


def _cross(a: Array, b: Array) -> float:
    return float(a[0] * b[1] - a[1] * b[0])
