"""Which detector finds which kind of target: one line each, imported when first asked for."""

from __future__ import annotations

from importlib import import_module

from calibrant.detect.detection import Detector
from calibrant.errors import InputError

DETECTORS = {
    "chessboard": "calibrant.detect.chessboard:ChessboardDetector",
    "charuco": "calibrant.detect.charuco:CharucoDetector",
    "circles": "calibrant.detect.circles:CirclesDetector",
    "aprilgrid": "calibrant.detect.aprilgrid:AprilGridDetector",
    "marker": "calibrant.detect.tags:TagDetector",
    "bundle": "calibrant.detect.tags:TagDetector",
}


def detector_for(kind: str) -> Detector:
    """The detector of a kind of target. Raises: InputError listing the kinds that can be detected."""
    if kind not in DETECTORS:
        raise InputError(f"no detector for targets of kind {kind!r}; there are detectors for: {', '.join(DETECTORS)}")
    module, name = DETECTORS[kind].split(":")
    detector: Detector = getattr(import_module(module), name)()
    return detector
