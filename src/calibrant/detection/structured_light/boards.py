"""Boards in captures: their corners in the camera's picture of white light, carried into the projector."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.data import View
from calibrant.detection.structured_light.capture import Capture
from calibrant.detection.structured_light.corners import carried_view
from calibrant.detection.structured_light.decode import Decoded, decode
from calibrant.detection.structured_light.judged import CaptureFigures, board_mask, capture_figures
from calibrant.detection.structured_light.light_checks import MOST_BEND
from calibrant.errors import InputError

CAMERA, PROJECTOR = "camera", "projector"
FEWEST_CORNERS = 12
LEAST_SHARE = 0.4
"""Of the corners found by the camera: fewer in the projector's light are a board half outside it, or badly lit."""
MOST_BEYOND = 0.05
"""Share of lit pixels with numbers that the projector has not: fewer are noise."""


@dataclass(frozen=True, eq=False)
class LitBoard:
    """A board in camera and projector (None, and why not), and the figures of its capture."""

    seen: View
    lit: View | None
    reason: str
    figures: CaptureFigures


def lit_board(capture: Capture, seen: View) -> LitBoard:
    """The board of a capture, whose camera view is given, in the projector. Raises: InputError for another size."""
    decoded = decode(capture)
    figures = capture_figures(capture, decoded, board_mask(seen.uv, capture.white.shape))
    check_size(capture, decoded, bend=figures.bend)
    lit = carried_view(seen, decoded, camera=CAMERA, projector=PROJECTOR)
    count = 0 if lit is None else len(lit)
    if count >= max(FEWEST_CORNERS, LEAST_SHARE * len(seen)):
        return LitBoard(seen, lit, "", figures)
    reason = (
        f"{count} of {len(seen)} corners are lit well enough to be decoded ({figures.decoded:.0%} of the board's "
        f"pixels are): {_cause(figures)}"
    )
    return LitBoard(seen, None, reason, figures)


def _cause(figures: CaptureFigures) -> str:
    if figures.saturated > 0.2:
        return f"{figures.saturated:.0%} of them are saturated; expose for less time"
    if figures.direct < 0.5:
        return f"only {figures.direct:.0%} of their light is direct; focus, or shade what throws light back"
    return "the projector's light is weak, or does not reach the whole board; expose for longer, move the board"


def check_size(capture: Capture, decoded: Decoded, *, bend: float = 0.0) -> None:
    """Raises: InputError where the patterns count more pixels than the projector was said to have. bend: of the light,
    as `CaptureFigures` has it; where cosines are bent their numbers are wrong whatever the size."""
    for axis, share, side, word in zip("xy", decoded.beyond, capture.sequence.projector_size, ("wide", "high")):
        if share > MOST_BEYOND:
            if capture.sequence.code == "phase" and abs(bend) > MOST_BEND:
                raise InputError(
                    f"{capture.name}: the cosines' second harmonic is {abs(bend):.0%} of the first, and their numbers "
                    f"are wrong by it ({share:.0%} beyond the projector's {side} px along {axis}): the camera or the "
                    "projector does not answer in proportion; turn off its gamma and contrast curves"
                )
            turned = ""
            if capture.sequence.bits("x") == capture.sequence.bits("y"):
                turned = ", or the patterns that number rows and those that number columns came in the other order"
            raise InputError(
                f"{capture.name}: {share:.0%} of what is lit has pixel numbers of {side} or more along {axis}, and "
                f"--projector-size says {side} px {word}: the patterns were made for another size{turned}"
            )


def check_upright(boards: Sequence[LitBoard]) -> None:
    """Raises: InputError where the projector's picture is seen mirrored."""
    turned = {
        b.seen.id: float(np.median(np.linalg.det(b.lit.carried.slope))) < 0
        for b in boards
        if b.lit is not None and b.lit.carried is not None
    }
    named = [name for name, mirrored in turned.items() if mirrored]
    if named:
        where = "" if len(named) == len(turned) else f"{', '.join(named)}: "
        raise InputError(
            f"{where}the camera sees the projector's picture mirrored: either rows and columns were shown in the other "
            "order, or the first bit of one after its inverse, or camera or projector mirror their picture (rear "
            "projection; --mirror-x flips the camera's)"
        )
