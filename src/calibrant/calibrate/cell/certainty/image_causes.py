"""Have images that err as a whole a cause that repeats from one to the next?

What points of a view share by themselves (blur, paper that moves, a detector's habits) the robot's noise and the lens's
clusters hold, and sigma with them. A lens that its model does not follow, a board that is bent or of other squares, a
camera that changed err alike in all images: the views are asked for these (`review`), and sigma is only said to hold
the rest where each was asked, could be told, and was not found.
"""

from __future__ import annotations

from collections.abc import Collection

from calibrant.calibrate.cell.certainty.checks import BY_OTHERS, BY_ROBOT
from calibrant.calibrate.review import board_shape
from calibrant.data import CalibrationResult

ASKED = (board_shape.FLATNESS, board_shape.SQUARES, "one-camera", "residual-structure")
"""Checks that every camera must have passed."""
CAUSES = (*ASKED, board_shape.POINTS, board_shape.LENS, "image-shear", BY_ROBOT, BY_OTHERS, "given-lens")
UNTOLD = (board_shape.FLATNESS_UNTOLD, board_shape.SQUARES_UNTOLD)


def no_cause_repeats(result: CalibrationResult, given: Collection[str] = ()) -> bool:
    """Whether every camera's views were asked for each cause, and show none.

    given: cameras that came with their uncertainty. They are not asked, as the answers would be those of other photos:
    of them it is enough that nothing contradicts them.
    """
    mine = {c.name: c for c in result.checks if c.name.startswith(CAUSES)}
    several = len(result.cameras) > 1
    asked = [
        f"{name}-{camera}" if several else name for name in ASKED for camera in result.cameras if camera not in given
    ]
    if not (asked or given) or any(name not in mine for name in asked):
        return False
    return all(c.status == "ok" and c.message not in UNTOLD for c in mine.values())
