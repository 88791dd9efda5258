"""What a projector shows: order, numbers of pictures, bits that neighbours share, cosines at their shifts."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.patterns.sequence import BIT, SHIFT, PatternSequence, gray_code, sizes_of_count


def test_the_order_is_opencvs() -> None:
    """Column bits, coarsest first, each before its inverse; row bits; white; black."""
    kinds = [(p.kind, p.axis, p.number) for p in PatternSequence((8, 4)).patterns]
    assert kinds[:4] == [("bit", "x", 0), ("inverse", "x", 0), ("bit", "x", 1), ("inverse", "x", 1)]
    assert kinds[6:8] == [("bit", "y", 0), ("inverse", "y", 0)]
    assert kinds[-2:] == [("white", "", 0), ("black", "", 0)]


@pytest.mark.parametrize(("size", "count"), [((1024, 768), 42), ((1920, 1080), 46), ((1280, 800), 44), ((2, 2), 6)])
def test_bits_for_any_size(size: tuple[int, int], count: int) -> None:
    assert len(PatternSequence(size).patterns) == count


def test_neighbours_differ_in_one_bit_and_no_two_columns_are_alike() -> None:
    sequence = PatternSequence((300, 10))
    bits = np.stack([sequence.level(p) for p in sequence.patterns if (p.kind, p.axis) == (BIT, "x")])
    assert np.all(np.abs(np.diff(bits, axis=1)).sum(axis=0) == 1)
    assert len({tuple(column) for column in bits.T}) == 300


def test_a_pair_lights_every_pixel_once() -> None:
    sequence = PatternSequence((40, 30))
    for k in range(0, len(sequence.patterns) - 2, 2):
        both = [sequence.picture(p).astype(int) for p in sequence.patterns[k : k + 2]]
        assert np.all(both[0] + both[1] == 255)


def test_gray_code() -> None:
    np.testing.assert_array_equal(gray_code(np.arange(8)), [0, 1, 3, 2, 6, 7, 5, 4])


@pytest.mark.parametrize("code", ["phase", "both"])
def test_cosines_tell_their_phase(code: str) -> None:
    sequence = PatternSequence((200, 100), code, 16, 5)
    shots = [sequence.level(p) for p in sequence.patterns if p.kind == SHIFT and (p.axis, p.period) == ("x", 16.0)]
    turn = 2 * np.pi * np.arange(5) / 5
    phase = np.arctan2(np.sin(turn) @ np.stack(shots), np.cos(turn) @ np.stack(shots))
    off = phase * 16 / (2 * np.pi) - np.arange(200)
    np.testing.assert_allclose(off - 16 * np.rint(off / 16), 0, atol=1e-9)


def test_the_coarsest_cosine_is_longer_than_the_picture() -> None:
    periods = PatternSequence((1920, 1080), "phase").periods("x")
    assert periods[0] >= 1.25 * 1920
    assert periods[-1] == 16
    assert all(a / b <= 10 + 1e-9 for a, b in itertools.pairwise(periods))


def test_file_names_sort_in_their_order() -> None:
    for code in ("gray", "phase", "both"):
        names = PatternSequence((640, 480), code).names
        assert sorted(names) == list(names)
        assert len(set(names)) == len(names)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(((1, 5),), "2 to"), (((8, 8), "grey"), "unknown patterns"), (((8, 8), "phase", 2), "period"),
     (((8, 8), "phase", 16, 2), "shifts")],
)  # fmt: skip
def test_what_cannot_be_is_said(arguments: tuple, words: str) -> None:
    with pytest.raises(InputError, match=words):
        PatternSequence(*arguments)


def test_sizes_that_a_count_fits() -> None:
    assert "513 to 1024 px wide and 513 to 1024 px high" in sizes_of_count(42)
    assert sizes_of_count(43) == ""
