"""Printed sheets: true size, and found again by the detector."""

from __future__ import annotations

import re
import struct
import zlib

import cv2
import numpy as np
import pytest

from calibrant.detection.charuco.detector import CharucoDetector
from calibrant.errors import InputError
from calibrant.reports.artwork import pdf, pixels, png, resolution_dpi, svg
from calibrant.reports.sheet import PAGES, DiscFill, Fill, Sheet, sheet_of
from calibrant.targets.charuco import Charuco
from calibrant.targets.registry import parse_target

BOARD = parse_target("charuco:4x5:30mm:18mm:DICT_5X5_100")


@pytest.mark.parametrize(
    "spec", ["charuco:4x5:30mm:18mm:DICT_5X5_100", "charuco:4x6:30mm:20mm:DICT_4X4_50:legacy:inverted"]
)
def test_a_printed_board_is_found_at_its_true_size(spec: str) -> None:
    target = parse_target(spec)
    sheet = sheet_of(target)
    dpi = 200
    found = CharucoDetector().detect(cv2.GaussianBlur(pixels(sheet, dpi), (0, 0), 0.7), target)
    assert len(found.point_ids) == len(target.points)
    assert found.notes == ()
    truth = (np.array(sheet.target_origin) + 1e3 * target.points[:, :2]) * dpi / 25.4 - 0.5
    # Edges are where they should be, by grey levels, and not on the nearest dot.
    assert np.abs(found.uv - truth).max() < 0.05


def test_a_png_tells_its_resolution() -> None:
    sheet = sheet_of(BOARD)
    data = png(sheet)
    at = data.index(b"pHYs")
    assert struct.unpack(">IIB", data[at + 4 : at + 13]) == (23622, 23622, 1)  # 600 dots per inch
    assert struct.unpack(">I", data[at + 13 : at + 17])[0] == zlib.crc32(data[at : at + 13])
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image.shape == (7016, 4961)


def test_a_huge_sheet_gets_a_png_that_can_be_opened() -> None:
    wall = Charuco(10, 12, 0.2, 0.15, "DICT_6X6_250")
    sheet = sheet_of(wall)
    assert sheet.page == "fit"
    assert resolution_dpi(sheet) == 100


def test_vector_files_have_the_pages_size() -> None:
    sheet = sheet_of(BOARD)
    assert sheet.page == "a4"
    assert 'width="210mm" height="297mm" viewBox="0 0 210 297"' in svg(sheet).decode()
    box = re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", pdf(sheet))
    assert box is not None
    assert [float(n) * 25.4 / 72 for n in box.groups()] == pytest.approx([210.0, 297.0], abs=1e-4)


def test_pdf_offsets_point_at_their_objects() -> None:
    data = pdf(sheet_of(BOARD))
    table = re.findall(rb"(\d{10}) 00000 n", data)
    for number, offset in enumerate(table, start=1):
        assert data[int(offset) :].startswith(b"%d 0 obj" % number)
    start = int(re.search(rb"startxref\n(\d+)", data)[1])  # type: ignore[index]
    assert data[start:].startswith(b"xref")


def test_vector_files_hold_every_square_and_cell() -> None:
    sheet = sheet_of(BOARD)
    rings = sum(len(item.rings) for item in sheet.items if isinstance(item, Fill))
    assert svg(sheet).decode().count("Z") == rings
    stream = re.search(rb"stream\n(.*)\nendstream", pdf(sheet), re.DOTALL)
    assert stream is not None
    assert zlib.decompress(stream[1]).split().count(b"h") == rings


def test_discs_are_round_in_every_format() -> None:
    sheet = Sheet("fit", (20.0, 20.0), (DiscFill((10.0, 10.0), 6.0, 0.0),), (0.0, 0.0))
    inked = 1.0 - pixels(sheet, 254) / 255.0  # 10 pixels a millimetre
    assert inked.sum() == pytest.approx(np.pi * 60.0**2, rel=5e-4)
    assert '<circle cx="10.00000" cy="10.00000" r="6.00000" fill="#000000"/>' in svg(sheet).decode()
    stream = re.search(rb"stream\n(.*)\nendstream", pdf(sheet), re.DOTALL)
    assert stream is not None
    assert zlib.decompress(stream[1]).count(b" c") == 4 + 1  # four arcs, and the page's transform


def test_the_ruler_is_100_mm() -> None:
    sheet = sheet_of(BOARD)
    fills = [item for item in sheet.items if isinstance(item, Fill)]
    # The ruler is drawn last: its base line, then a mark every 10 mm.
    marks = [np.mean([x for x, _ in item.rings[0]]) for item in fills[-11:]]
    np.testing.assert_allclose(np.diff(marks), 10.0, atol=1e-9)


@pytest.mark.parametrize("page", ["auto", "a4", "a3", "letter", "fit"])
def test_everything_lies_on_the_page(page: str) -> None:
    sheet = sheet_of(BOARD, page=page)
    assert sheet.page == ("a4" if page == "auto" else page)
    for item in sheet.items:
        if isinstance(item, Fill) and item.rings:
            corners = np.concatenate([np.array(ring) for ring in item.rings])
            assert corners.min() >= 0
            assert np.all(corners.max(axis=0) <= sheet.size)


def test_a_page_too_small_is_refused() -> None:
    large = Charuco(8, 10, 0.04, 0.03, "DICT_6X6_250")
    assert sheet_of(large).size == PAGES["a2"]
    with pytest.raises(InputError, match=r"more than a4; the smallest ISO page for it is a2"):
        sheet_of(large, page="a4")
    with pytest.raises(InputError, match="unknown page 'a9'; known pages: auto, fit, a4"):
        sheet_of(large, page="a9")
