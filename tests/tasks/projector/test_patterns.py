"""The patterns' pictures and the page that shows them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.errors import InputError
from calibrant.opencv import cv2
from calibrant.patterns.sequence import PatternSequence


def test_pictures_are_the_sequences_and_the_page_holds_all_of_them(tmp_path: Path) -> None:
    cb.projector_patterns(projector_size="40x30", code="both", out=tmp_path)
    sequence = PatternSequence((40, 30), "both")
    for name, pattern in zip(sequence.names, sequence.patterns):
        np.testing.assert_array_equal(cv2.imread(str(tmp_path / name), 0), sequence.picture(pattern))
    page = (tmp_path / "patterns.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == len(sequence.patterns)
    assert f"{len(sequence.patterns)} patterns for a projector of 40 × 30 px" in page
    assert "http" not in page


@pytest.mark.parametrize("size", ["1024", "", "0x5", "axb"])
def test_a_size_that_is_none_is_said(size: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="projector"):
        cb.projector_patterns(projector_size=size, out=tmp_path)


def test_captures_without_a_folder_are_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no folder of that name"):
        cb.projector_calibrate(captures=str(tmp_path / "none"), projector_size="40x30", target="chessboard:9x7:30mm")
