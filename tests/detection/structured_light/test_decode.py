"""Decoding: every pixel's projector pixel within its sigma, corners carried to hundredths, spoilt light named."""

from __future__ import annotations

import numpy as np
import pytest
from tests.detection.lit_captures import BOARD, PAIR, POINTS, POSE, SIZE, capture, truth

from calibrant.data import View
from calibrant.detection.structured_light.boards import check_size, check_upright, lit_board
from calibrant.detection.structured_light.capture import Capture
from calibrant.detection.structured_light.corners import carried_view
from calibrant.detection.structured_light.decode import decode
from calibrant.detection.structured_light.judged import board_mask, capture_figures
from calibrant.detection.structured_light.light_checks import light_checks
from calibrant.errors import InputError
from calibrant.opencv import cv2
from calibrant.patterns.sequence import PatternSequence

U, Q = PAIR.lit(POSE, POINTS)
SEEN = View("pose", POINTS, U, np.arange(len(POINTS)))


def inside_squares() -> np.ndarray:
    """Pixels of white squares, away from all edges, where no blur mixes light."""
    white = (capture().white > 60).astype(np.uint8)
    white[[0, 1, -2, -1]] = white[:, [0, 1, -2, -1]] = 0
    return cv2.erode(white, np.ones((5, 5), dtype=np.uint8)) > 0


@pytest.mark.parametrize("code", ["gray", "phase", "both"])
def test_pixels_within_their_sigma(code: str) -> None:
    decoded = decode(capture(code))
    clear = inside_squares()
    assert decoded.known[clear].mean() > 0.97  # but for the rim of the projector's picture
    true = truth().pixels.reshape(*clear.shape, 2)
    use = clear & decoded.known
    z = (decoded.pixels - true)[use] / decoded.sigma[use]
    # Several hundred pixels, not all independent; of whole numbers the error is uniform.
    assert 0.5 < np.mean(z**2) < 1.4
    assert np.abs(decoded.pixels - true)[use].max() < (1.2 if code == "gray" else 0.5)


@pytest.mark.parametrize(("code", "worst_px"), [("gray", 0.1), ("phase", 0.05), ("both", 0.05)])
def test_corners_are_carried_to_hundredths_of_a_pixel(code: str, worst_px: float) -> None:
    lit = carried_view(SEEN, decode(capture(code)), camera="camera", projector="projector")
    assert lit is not None
    assert len(lit) == len(POINTS)
    assert np.abs(lit.uv - Q).max() < worst_px
    assert lit.carried is not None
    np.testing.assert_allclose(lit.carried.slope, PAIR.slope(POSE, POINTS), atol=0.03)


def test_an_error_of_the_corner_is_carried_along() -> None:
    """That is what `Carried` says of it."""
    decoded, e = decode(capture()), np.array([0.4, -0.3])
    off = View("pose", POINTS, U + e, np.arange(len(POINTS)))
    here, there = (carried_view(v, decoded, camera="camera", projector="projector") for v in (SEEN, off))
    assert here is not None
    assert there is not None
    assert here.carried is not None
    np.testing.assert_allclose(there.uv - here.uv, here.carried.slope @ e, atol=0.05)


def figures(**lighting: object) -> dict[str, str]:
    """The status of every check of a capture's light."""
    shot = capture(**lighting)  # type: ignore[arg-type]
    board = board_mask(U, shot.white.shape)
    found = capture_figures(shot, decode(shot), board)
    return {c.name: c.status for c in light_checks([("pose", found)], shot.sequence.code)}


def test_good_light_passes() -> None:
    assert set(figures().values()) == {"ok"}


@pytest.mark.parametrize(
    ("lighting", "check"),
    [
        ({"white": 500.0}, "light-saturated"),
        ({"indirect": 0.6}, "light-direct"),
        ({"scaling": (0.93, 5.0)}, "projector-resampled"),
        ({"scaling": (1.07, 0.0)}, "projector-resampled"),
        ({"code": "phase", "gamma": 2.2}, "light-gamma"),
    ],
)
def test_spoilt_light_is_named(lighting: dict[str, object], check: str) -> None:
    assert figures(**lighting)[check] == "warn"


def changed(pictures: np.ndarray) -> dict[str, str]:
    shot = Capture("pose", PatternSequence(SIZE), pictures, capture().names)
    found = capture_figures(shot, decode(shot), board_mask(U, shot.white.shape))
    return {c.name: c.status for c in light_checks([("pose", found)], "gray")}


def test_a_cameras_gamma_is_named() -> None:
    bent = np.rint(255 * (capture().pictures / 255.0) ** (1 / 2.2)).astype(np.uint8)
    assert changed(bent)["light-gamma"] == "warn"


def test_a_resampled_capture_is_named() -> None:
    there, back = (420, 315), (480, 360)
    again = [cv2.resize(cv2.resize(p, there), back) for p in capture().pictures]
    assert changed(np.stack(again))["camera-resampled"] == "warn"


def test_another_size_is_named() -> None:
    shot = capture()
    # The board is lit by the middle of the picture: a projector of half the width has no such pixels.
    narrow = PatternSequence((129, 192))
    with pytest.raises(InputError, match="made for another size"):
        check_size(shot, decode(Capture("pose", narrow, shot.pictures, shot.names)))


def test_mirrored_pictures_are_named() -> None:
    """Rows shown before columns."""
    shot = capture()
    n = len(shot.pictures)
    order = [*range(16, n - 2), *range(16), n - 2, n - 1]
    swapped = Capture("pose", PatternSequence((192, 256)), shot.pictures[order], shot.names)
    board = lit_board(swapped, SEEN)
    assert board.lit is not None
    with pytest.raises(InputError, match="mirrored"):
        check_upright([board])


def test_a_board_in_the_dark_is_refused_by_name() -> None:
    dark = capture(white=2.5)
    board = lit_board(dark, SEEN)
    assert board.lit is None
    assert "expose for longer" in board.reason
    assert BOARD.squares is not None
