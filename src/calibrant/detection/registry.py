"""Which detector finds which kind of target: one line each, imported when first asked for."""

from __future__ import annotations

from importlib import import_module

from calibrant.arrays import Grey
from calibrant.detection.detection import Detection, Detector
from calibrant.detection.subpixel.refinement import DEFAULT, Refinement
from calibrant.errors import InputError
from calibrant.targets.target import Target

DETECTORS = {
    "chessboard": "calibrant.detection.chessboard.detector:ChessboardDetector",
    "charuco": "calibrant.detection.charuco.detector:CharucoDetector",
    "circles": "calibrant.detection.circles.detector:CirclesDetector",
    "aprilgrid": "calibrant.detection.tags.aprilgrid:AprilGridDetector",
    "marker": "calibrant.detection.tags.detector:TagDetector",
    "bundle": "calibrant.detection.tags.detector:TagDetector",
}


REFINED = ("chessboard", "charuco")
"""Kinds whose corners can be measured by several methods."""


SECOND_LOOKS = {"chessboard": "calibrant.detection.charuco.not_a_chessboard:named"}
"""What another kind's room has to say of an image in which a target of this kind was looked for."""
DRAWN_IN_SQUARES = "calibrant.detection.chessboard.patterned:squares_hold_patterns"


def check_choice(kind: str, refinement: Refinement) -> None:
    """Raises: InputError listing the kinds that can be detected, or for a refinement of a kind that has no choice."""
    if kind not in DETECTORS:
        raise InputError(f"no detector for targets of kind {kind!r}; there are detectors for: {', '.join(DETECTORS)}")
    if refinement != DEFAULT and kind not in REFINED:
        raise InputError(
            f"refinement, window and zero zone are for the corners of {' and '.join(REFINED)} targets; the points of "
            f"{kind} are measured in their own way: leave the choice out"
        )


def detector_for(kind: str, refinement: Refinement = DEFAULT) -> Detector:
    """The detector of a kind of target. refinement: how the corners of chessboards and ChArUco boards are measured.

    Raises: as `check_choice`.
    """
    check_choice(kind, refinement)
    module, name = DETECTORS[kind].split(":")
    found = getattr(import_module(module), name)
    detector: Detector = found(refinement) if kind in REFINED else found()
    return detector


def second_look(grey: Grey, target: Target, detection: Detection) -> Detection:
    """A detection with the name of the target that the image shows in the place of the one asked for."""
    if target.kind not in SECOND_LOOKS or (detection.found and not _may_hold_markers(grey, target, detection)):
        return detection
    module, name = SECOND_LOOKS[target.kind].split(":")
    named: Detection = getattr(import_module(module), name)(grey, target, detection)
    return named


def _may_hold_markers(grey: Grey, target: Target, found: Detection) -> bool:
    """Whether something is drawn in the light squares of a chessboard that was found; else no other room is loaded."""
    module, name = DRAWN_IN_SQUARES.split(":")
    return bool(getattr(import_module(module), name)(grey, found, target, "light"))
