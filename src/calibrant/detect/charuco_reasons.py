"""Why no ChArUco board was found: another dictionary, another size, too little of it, or nothing at all."""

from __future__ import annotations

from calibrant.detect.detection import Detection, Grey
from calibrant.detect.opencv import Markers
from calibrant.targets.charuco import Charuco


def why_not_found(grey: Grey, target: Charuco, markers: Markers) -> Detection:
    return Detection.nothing("x")
