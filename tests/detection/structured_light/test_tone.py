"""Light that does not add up is told from pictures out of order: saturation and tone curves by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.detection.lit_captures import PAIR, POINTS, POSE, capture

from calibrant.data import View
from calibrant.detection.structured_light.boards import check_upright, lit_board
from calibrant.detection.structured_light.capture import Capture
from calibrant.detection.structured_light.order import check_order
from calibrant.errors import InputError


def seen() -> View:
    """The board's exact corners in the camera."""
    uv, _ = PAIR.lit(POSE, POINTS)
    return View("pose", POINTS, uv, np.arange(len(POINTS)), "camera")


def curved(shot: Capture, gamma: float) -> Capture:
    """As a camera with a tone curve saves it."""
    return replace(shot, pictures=np.rint(255 * (shot.pictures / 255.0) ** gamma).astype(np.uint8))


@pytest.mark.parametrize(("code", "white"), [("gray", 300.0), ("gray", 1500.0), ("phase", 1500.0)])
def test_saturated_pictures_are_said_to_be_saturated(code: str, white: float) -> None:
    with pytest.raises(InputError, match=r"of what is lit is saturated in white light .* expose for less time"):
        check_order(capture(code, white=white))


def test_saturated_pictures_that_are_out_of_order_too_are_said_to_be_out_of_order() -> None:
    shot = capture("gray", white=300.0)
    order = list(range(len(shot.pictures)))
    order[7], order[14] = order[14], order[7]
    with pytest.raises(InputError, match="is not the inverse"):
        check_order(replace(shot, pictures=shot.pictures[order]))


@pytest.mark.parametrize(("gamma", "word"), [(1 / 2.2, "brighter"), (2.2, "darker")])
def test_a_tone_curve_of_the_camera_is_named(gamma: float, word: str) -> None:
    with pytest.raises(InputError, match=f"half-lit pixels are {word} than half .* Turn off its gamma"):
        check_order(curved(capture("gray"), gamma))


@pytest.mark.long
def test_a_projectors_gamma_does_not_move_gray_code() -> None:
    shot = check_order(capture("gray", gamma=2.2))
    assert lit_board(shot, seen()).lit is not None


@pytest.mark.long
def test_cosines_under_a_tone_curve_name_it_and_no_other_projector() -> None:
    with pytest.raises(InputError, match=r"second harmonic is \d+% of the first, .* turn off its gamma"):
        lit_board(check_order(curved(capture("phase"), 1 / 2.2)), seen())


@pytest.mark.long
def test_captures_whose_camera_mirrors_are_named_where_others_do_not() -> None:
    right = capture()
    mirrored = replace(right, pictures=right.pictures[:, :, ::-1].copy())
    view = seen()
    flipped = replace(view, id="02", uv=np.stack([479 - view.uv[:, 0], view.uv[:, 1]], axis=1))
    boards = [lit_board(check_order(right), view), lit_board(check_order(mirrored), flipped)]
    with pytest.raises(InputError, match=r"^02: the camera sees the projector's picture mirrored"):
        check_upright(boards)
    with pytest.raises(InputError, match=r"^the camera sees the projector's picture mirrored"):
        check_upright(boards[1:])
