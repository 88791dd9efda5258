"""Photos against a reference picture of the same camera, with or without a target: what became of the picture."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.data.details import ReferencePicture
from calibrant.detection.images.images import load_grey
from calibrant.errors import InputError
from calibrant.opencv import cv2
from calibrant.verification.unchanged.consensus import Motion, motion
from calibrant.verification.unchanged.features import WIDEST, Features, features, matched, reduced

KEPT = 640
"""Pixels of the longer side of the copy that a result keeps: some 60 kB, and 5 px of the full picture are 1 to 2."""
QUALITY = 90


@dataclass(frozen=True, eq=False)
class Reference:
    """A picture of then: what it is called, its greys (h, w), and the size (width, height) of the full picture."""

    name: str
    grey: NDArray[np.uint8]
    image_size: tuple[int, int]

    @property
    def longest(self) -> int:
        """The side that this picture and those compared with it are worked on."""
        return min(WIDEST, max(self.grey.shape))


def reference_of(path: str | Path, *, mirror_x: bool = False) -> Reference:
    """The picture in a file, flipped left to right for a camera that delivers mirror images. Raises: InputError as
    `load_grey`."""
    grey = np.ascontiguousarray(load_grey(path)[:, :: -1 if mirror_x else 1])
    return Reference(Path(path).name, grey, (grey.shape[1], grey.shape[0]))


def kept_reference(record: ReferencePicture) -> Reference:
    """The reference that a result keeps. Raises: InputError where its picture is damaged."""
    try:
        data = np.frombuffer(base64.b64decode(record.jpeg, validate=True), dtype=np.uint8)
        grey = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    except (ValueError, cv2.error):
        grey = None
    if grey is None:
        raise InputError("the reference picture in the result is damaged; keep it again (--keep-reference)")
    return Reference(record.name, np.asarray(grey, dtype=np.uint8), record.image_size)


def record_of(reference: Reference) -> ReferencePicture:
    """A small copy to be kept."""
    small = reduced(reference.grey, KEPT)
    jpeg = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
    return ReferencePicture(reference.name, reference.image_size, base64.b64encode(jpeg.tobytes()).decode("ascii"))


def became(reference: Reference, now: Reference, *, without: Sequence[Array] = ()) -> Motion:
    """What became of the reference's picture. Args: without, outlines (k, 2) of what is left out of both: a target,
    which may have been moved by itself. Raises: InputError as `matched` and `motion`."""
    then, today = (features(r.grey, r.image_size, longest=reference.longest) for r in (reference, now))
    return motion(*matched(_outside(then, without), _outside(today, without)), reference.image_size)


def _outside(found: Features, outlines: Sequence[Array]) -> Features:
    keep = np.ones(len(found.places), dtype=np.bool_)
    for outline in outlines:
        middle = outline.mean(axis=0)
        hull = cv2.convexHull((middle + 1.35 * (outline - middle)).astype(np.float32))
        keep &= np.array([cv2.pointPolygonTest(hull, (float(u), float(v)), False) < 0 for u, v in found.places], bool)
    return Features(found.image_size, found.places[keep], found.looks[keep])
