"""Pictures that are missing, doubled or out of place are named by their files; the right ones pass."""

from __future__ import annotations

import numpy as np
import pytest
from tests.detection.lit_captures import SIZE, capture

from calibrant.detection.structured_light.capture import Capture
from calibrant.detection.structured_light.order import check_count, check_order
from calibrant.errors import InputError
from calibrant.patterns.sequence import PatternSequence

SEQUENCE = PatternSequence(SIZE)
N = len(SEQUENCE.patterns)
FILES = tuple(f"photo_{k:02d}.png" for k in range(N))


def shown(order: list[int]) -> Capture:
    return Capture("pose", SEQUENCE, capture().pictures[order], FILES)


@pytest.mark.parametrize("code", ["gray", *(pytest.param(c, marks=pytest.mark.long) for c in ("phase", "both"))])
def test_pictures_in_their_order_pass(code: str) -> None:
    shot = capture(code)
    assert check_order(shot).names == shot.names


@pytest.mark.parametrize("first", ["white", "black"])
def test_white_and_black_may_come_first(first: str) -> None:
    ends = [N - 2, N - 1] if first == "white" else [N - 1, N - 2]
    found = check_order(shown([*ends, *range(N - 2)]))
    np.testing.assert_array_equal(found.pictures, capture().pictures)


@pytest.mark.parametrize("k", range(2, 16, 2))
def test_an_inverse_that_came_first_is_named(k: int) -> None:
    order = list(range(N))
    order[k], order[k + 1] = order[k + 1], order[k]
    with pytest.raises(InputError, match=f"photo_{k:02d}.png and photo_{k + 1:02d}.png have changed places"):
        check_order(shown(order))


def test_two_bits_that_changed_places_are_named() -> None:
    order = [*range(8), 10, 11, 8, 9, *range(12, N)]
    with pytest.raises(InputError, match=r"photo_08.png, photo_09.png and photo_10.png, photo_11.png have changed"):
        check_order(shown(order))


def test_a_picture_beside_another_bits_inverse_is_named() -> None:
    order = list(range(N))
    order[7], order[14] = order[14], order[7]
    with pytest.raises(InputError, match=r"photo_07.png is not the inverse of photo_06.png; its inverse is photo_14"):
        check_order(shown(order))


def test_a_pattern_taken_twice_is_named() -> None:
    order = list(range(N))
    order[9] = 8
    with pytest.raises(InputError, match=r"photo_08.png and photo_09.png show the same pattern"):
        check_order(shown(order))


def test_white_in_the_middle_is_named() -> None:
    order = [*range(4), N - 2, *range(4, N - 2), N - 1]
    with pytest.raises(InputError, match="white and black are expected last"):
        check_order(shown(order))


def test_shifts_out_of_order_are_named() -> None:
    shot = capture("phase")
    order = list(range(len(shot.pictures)))
    order[2], order[6] = order[6], order[2]
    with pytest.raises(InputError, match="no shifted cosine"):
        check_order(Capture("pose", shot.sequence, shot.pictures[order], shot.names))


def test_a_missing_picture_is_named_by_its_number_or_by_its_neighbours() -> None:
    kept = [k for k in range(N) if k != 7]
    pictures = capture().pictures[kept]
    with pytest.raises(InputError, match="without 7: was it lost"):
        check_count("pose", [FILES[k] for k in kept], SEQUENCE, pictures)
    with pytest.raises(InputError, match=r"photo_07.png is not the inverse of photo_06.png"):
        check_count("pose", FILES[: N - 1], SEQUENCE, pictures)


def test_one_too_many_is_named() -> None:
    order = [*range(8), 7, *range(8, N)]
    names = [f"photo_{k:02d}.png" for k in range(N + 1)]
    with pytest.raises(InputError, match=r"photo_07.png and photo_08.png show the same pattern"):
        check_count("pose", names, SEQUENCE, capture().pictures[order])


def test_a_size_that_the_count_cannot_be_of_is_named() -> None:
    with pytest.raises(InputError, match=r"patterns for 1920x1080 px are 46.*34 pictures fit 129 to 256 px wide"):
        check_count("pose", FILES, PatternSequence((1920, 1080)), None)


@pytest.mark.parametrize("light", [0.0, 6.0])
def test_no_light_is_named(light: float) -> None:
    """Single pixels of a noisy camera are brighter than white's least light; their neighbours are not."""
    rng = np.random.default_rng(0)
    shown = capture().pictures / 255.0
    dark = np.clip(10 + light * shown + rng.normal(0, 3, shown.shape), 0, 255).astype(np.uint8)
    with pytest.raises(InputError, match=r"nothing changes by more than \d of 255 grey levels"):
        check_order(Capture("pose", SEQUENCE, dark, FILES))
