"""`calibrant detect` and `calibrant report`: points in a file, pictures of them, and results shown again."""

from __future__ import annotations

import json
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrant.data.result_file import read_observations

TARGET = "chessboard:7x6:30mm"


def test_points_pictures_and_a_table(calibrant, cell, tmp_path: Path, untouched) -> None:
    blank = tmp_path / "blank.png"
    cv2.imwrite(str(blank), np.full((360, 480), 128, np.uint8))
    out, pictures = tmp_path / "observations.json", tmp_path / "seen"
    outcome = calibrant("detect", *cell.photos, blank, "--target", TARGET, "--out", out, "--overlays", pictures)
    assert (outcome.status, outcome.err) == (0, "")
    assert "found in 8 of 9 photos" in outcome.out
    assert "42 of 42" in outcome.out
    (line,) = [line for line in outcome.out.splitlines() if line.startswith("blank.png")]
    assert "not found: " in line
    found = read_observations(out)
    # The picture's edge cuts the outermost square of one board; the corner beside it may be left out.
    assert sorted(len(v) for v in found.views)[1:] == [42] * 7
    assert min(len(v) for v in found.views) >= 41
    assert [m.id for m in found.missed] == ["blank.png"]
    assert sorted(os.listdir(pictures)) == [f"{i:02d}-seen.png" for i in range(8)]
    assert cv2.imread(str(pictures / "00-seen.png")).shape == (360, 480, 3)
    untouched()


def test_existing_pictures_are_left_alone(calibrant, cell, tmp_path: Path) -> None:
    (tmp_path / "00-seen.png").write_text("mine")
    out = tmp_path / "observations.json"
    outcome = calibrant("detect", cell.images, "--target", TARGET, "--overlays", tmp_path, "--out", out)
    assert outcome.status == 2
    assert "00-seen.png exists already" in outcome.err
    assert os.listdir(tmp_path) == ["00-seen.png"]


def test_json_alone_on_standard_output(calibrant, cell) -> None:
    outcome = calibrant("detect", cell.photos[0], "--target", TARGET, "--json")
    assert (outcome.status, outcome.err) == (0, "")
    assert json.loads(outcome.out)["kind"] == "observations"


def test_nothing_found_is_said_and_nothing_written(calibrant, cell, tmp_path: Path) -> None:
    outcome = calibrant(
        "detect", cell.images, "--target", "chessboard:5x4:30mm",
        "--out", tmp_path / "o.json", "--overlays", tmp_path / "seen",
    )  # fmt: skip
    assert (outcome.status, outcome.out) == (2, "")
    assert "0 of 8 boards found; the images look like 7x6 inner corners" in outcome.err
    assert os.listdir(tmp_path) == []


def test_a_result_is_shown_again(calibrant, found: Path, tmp_path: Path) -> None:
    camera = tmp_path / "camera.json"
    first = calibrant("intrinsics", "--observations", found, "--out", camera)
    second = calibrant("report", camera, "--out", tmp_path / "camera.html")
    assert second.status == 0
    assert first.out.split("Written")[0] == second.out.split("Written")[0]
    assert "<html" in (tmp_path / "camera.html").read_text().lower()
    assert calibrant("report", found, "-q").status == 0


@pytest.mark.parametrize(("content", "words"), [("{}", "format"), ("no json", "not JSON"), (None, "does not exist")])
def test_what_is_no_result(calibrant, tmp_path: Path, content: str | None, words: str) -> None:
    path = tmp_path / "result.json"
    if content is not None:
        path.write_text(content)
    outcome = calibrant("report", path, "--out", tmp_path / "page.html")
    assert (outcome.status, outcome.out) == (2, "")
    assert words in outcome.err
    assert not (tmp_path / "page.html").exists()


def test_points_of_another_board_are_not_mixed_up(calibrant, found: Path) -> None:
    outcome = calibrant("intrinsics", "--observations", found, "--target", "chessboard:7x6:25mm")
    assert outcome.status == 2
    assert "points of chessboard:7x6:30mm, --target says chessboard:7x6:25mm" in outcome.err


@pytest.mark.parametrize("options", [("--refine", "radon"), ("--refine", "foerstner", "--window", "30%")])
def test_corners_are_measured_as_asked(calibrant, cell, tmp_path: Path, options: tuple[str, ...]) -> None:
    both = []
    for name, given in (("ours", ()), ("other", options)):
        out = tmp_path / f"{name}.json"
        assert calibrant("detect", *cell.photos, "--target", TARGET, "--out", out, *given).status == 0
        both.append({(v.id, int(i)): uv for v in read_observations(out).views for i, uv in zip(v.point_ids, v.uv)})
    away = [np.linalg.norm(both[0][key] - both[1][key]) for key in both[0].keys() & both[1].keys()]
    assert len(away) > 300
    # Another method, the same corners: a tenth of a pixel is what small pictures with noise leave.
    assert 0 < np.median(away) < 0.1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--refine", "harris"), "there are: saddle, foerstner, radon"),
        (("--window", "40"), "such as 40%"),
        (("--zero-zone", "1"), "such as 1.0px"),
    ],
)
def test_bad_refinements_are_named(calibrant, cell, options: tuple[str, ...], words: str) -> None:
    outcome = calibrant("detect", *cell.photos[:1], "--target", TARGET, *options)
    assert outcome.status == 2
    assert words in outcome.err


def test_bad_images_cost_themselves_alone(calibrant, cell, tmp_path: Path) -> None:
    photo = cv2.imread(str(cell.photos[0]))
    folder = tmp_path / "photos"
    folder.mkdir()
    cv2.imwrite(str(folder / "good.png"), photo)
    cv2.imwrite(str(folder / "four_channels.png"), cv2.cvtColor(photo, cv2.COLOR_BGR2BGRA))
    cv2.imwrite(str(folder / "one_bit.png"), photo[..., 0] // 128 * 255, [cv2.IMWRITE_PNG_BILEVEL, 1])
    picture = b"\x21\xf9\x04\0\0\0\0\0\x2c\0\0\0\0\x02\0\x02\0\0\x02\x03\x04\x02\x05\0"
    head = b"GIF89a\x02\0\x02\0\x80\0\0\0\0\0\xff\xff\xff"
    (folder / "moving.gif").write_bytes(head + 2 * picture + b";")
    (folder / "nothing.png").touch()
    (folder / "no_size.pgm").write_bytes(b"P5\n0 0\n255\n")
    (folder / "cut.png").write_bytes((folder / "good.png").read_bytes()[:300])
    outcome = calibrant("detect", folder, "--target", TARGET, "--cache", "none")
    assert outcome.status == 0, outcome.err
    said = {line.split()[0]: line for line in outcome.out.splitlines() if line and "." in line.split()[0]}
    for name in ("good.png", "four_channels.png", "one_bit.png"):
        assert "of 42" in said[name]
    assert "holds 2 pictures" in outcome.out
    assert "is empty" in outcome.out
    assert "is cut off" in outcome.out
    assert "not found" in said["no_size.pgm"]
    for name in ("good.png", "four_channels.png", "one_bit.png"):
        (folder / name).unlink()
    alone = calibrant("detect", folder, "--target", TARGET, "--cache", "none")
    assert (alone.status, alone.out) == (2, "")
    assert "none of 4 images can be read" in alone.err


def test_sources_without_pictures_are_named(calibrant, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken.mp4").write_bytes(b"no video")
    for source, words in (
        ("empty", "holds no images"),
        ("broken.mp4", "cannot be read"),
        ("gone.png", "does not exist"),
    ):
        outcome = calibrant("detect", tmp_path / source, "--target", TARGET)
        assert (outcome.status, outcome.out) == (2, ""), source
        assert words in outcome.err
        assert source in outcome.err


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("charuco:5x7:30mm:40mm:DICT_6X6_250", "marker"),
        ("chessboard:1x1:25mm", "1x1"),
        ("charuco:5x7:30mm:20mm:DICT_3X3_9", "DICT_3X3_9"),
        ("chessboard:9x6:25", "25"),
        ("marker:50mm:DICT_4X4_50:999", "999"),
        ("circles:1x1:20mm", "1x1"),
        ("aprilgrid:6x6:88:0.3:36h11", "88"),
    ],
)
def test_impossible_boards_are_named(calibrant, cell, spec: str, words: str) -> None:
    outcome = calibrant("detect", cell.photos[0], "--target", spec)
    assert (outcome.status, outcome.out) == (2, "")
    assert words in outcome.err
    assert "Traceback" not in outcome.err
