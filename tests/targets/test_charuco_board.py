"""ChArUco boards against OpenCV's own, and what is refused."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrant.errors import InputError
from calibrant.targets.charuco import Charuco
from calibrant.targets.dictionaries import DICTIONARIES, dictionary_name
from calibrant.targets.registry import parse_target
from calibrant.targets.target import MarkerArt, Polygon


def board(columns: int, rows: int, *, legacy: bool = False, inverted: bool = False) -> Charuco:
    return Charuco(columns, rows, 0.04, 0.024, "DICT_5X5_100", legacy=legacy, inverted=inverted)


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize(("columns", "rows"), [(5, 7), (4, 5), (5, 6), (4, 4), (5, 4), (2, 2), (3, 2)])
def test_points_markers_and_ids_are_those_of_opencv(columns: int, rows: int, legacy: bool) -> None:
    ours = board(columns, rows, legacy=legacy)
    theirs = cv2.aruco.CharucoBoard(
        (columns, rows), 0.04, 0.024, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    )
    theirs.setLegacyPattern(legacy)
    # OpenCV keeps single precision.
    np.testing.assert_allclose(ours.points, theirs.getChessboardCorners(), atol=1e-7)
    assert ours.point_ids.tolist() == list(range(len(theirs.getChessboardCorners())))
    assert theirs.getIds().ravel().tolist() == list(range(ours.marker_count))
    np.testing.assert_allclose(ours.marker_corners, np.array(theirs.getObjPoints())[..., :2], atol=1e-7)


def test_the_dictionary_table_is_opencvs() -> None:
    for name, size in DICTIONARIES.items():
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
        assert (dictionary.markerSize, len(dictionary.bytesList)) == (size.bits, size.capacity), name
    known = {n.upper() for n in dir(cv2.aruco) if n.startswith("DICT_")}
    assert {n.upper() for n in DICTIONARIES} == known


def test_dictionary_names_are_read_in_any_capitals() -> None:
    assert dictionary_name("dict_apriltag_36H11") == "DICT_APRILTAG_36h11"
    assert dictionary_name("6x6_250") == "DICT_6X6_250"


@pytest.mark.parametrize(
    "spec",
    [
        "charuco:5x7:36.195mm:18.256mm:DICT_6X6_250",
        "charuco:4x6:54mm:40.5mm:DICT_4X4_1000:legacy",
        "charuco:4x5:54mm:40.5mm:DICT_4X4_1000:inverted",
        "charuco:4x6:54mm:40.5mm:DICT_APRILTAG_36h11:legacy:inverted",
    ],
)
def test_a_spec_is_read_back(spec: str) -> None:
    target = parse_target(spec)
    assert target.spec == spec
    assert parse_target(target.spec) == target


def test_scaling_changes_every_length() -> None:
    twice = board(5, 7).scaled(2.0)
    assert (twice.square, twice.marker) == (0.08, 0.048)
    np.testing.assert_allclose(twice.points, 2.0 * board(5, 7).points)


@pytest.mark.parametrize("inverted", [False, True])
def test_artwork_colours_every_square_once(inverted: bool) -> None:
    art = board(5, 6, inverted=inverted).artwork()
    squares = [s for s in art.shapes if isinstance(s, Polygon)]
    markers = [s for s in art.shapes if isinstance(s, MarkerArt)]
    assert (len(squares), len(markers)) == (15, 15)
    assert {s.grey for s in squares} == {1.0 if inverted else 0.0}
    assert art.background == (0.0 if inverted else 1.0)
    assert all(m.inverted is inverted for m in markers)
    assert art.bounds == pytest.approx((-0.02, -0.02, 0.22, 0.26))


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("charuco:5x7:20mm:30mm:DICT_6X6_250", "must be smaller than the square"),
        ("charuco:1x7:40mm:20mm:DICT_6X6_250", "at least 2x2"),
        ("charuco:5x7:40mm:20mm:DICT_9X9_9", "unknown marker dictionary.*DICT_4X4_50"),
        ("charuco:5x7:40:20mm:DICT_6X6_250", "no unit; write 40mm"),
        ("charuco:12x9:40mm:20mm:DICT_4X4_50", "needs 54 markers, DICT_4X4_50 has only 50"),
        ("charuco:5x7:40mm:20mm", "needs a size, two lengths and a dictionary"),
        ("charuco:5x7:40mm:20mm:DICT_6X6_250:mirrored", "unknown option 'mirrored'"),
        ("charuco:57:40mm:20mm:DICT_6X6_250", "COLUMNSxROWS"),
        ("charucco:5x7:40mm:20mm:DICT_6X6_250", "unknown kind of target 'charucco'.*did you mean charuco:COLUMNSxROWS"),
        ("", "unknown kind of target"),
    ],
)
def test_an_impossible_spec_is_refused(spec: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_target(spec)
