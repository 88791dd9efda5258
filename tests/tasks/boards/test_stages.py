"""`detect --stages`: what the search for markers saw, of photos that show the board and those that do not."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrant.cameras.camera import Camera
from calibrant.errors import DetectionError, InputError
from calibrant.geometry import se3
from calibrant.simulate.render import Look, render
from calibrant.targets.registry import parse_target
from calibrant.tasks.boards import detect
from calibrant.tasks.options.images import PhotoOptions

CAMERA = Camera.create("pinhole", {"fx": 600.0, "fy": 600.0, "cx": 319.5, "cy": 239.5}, image_size=(640, 480))
STAGES = ("1-grey", "2-threshold", "3-quads", "4-decoded", "5-corners")


def request_for(folder: Path, spec: str) -> detect.Request:
    return detect.Request(photos=PhotoOptions(images=(str(folder / "photos"),), target=spec), stages=folder / "stages")


def green(picture: np.ndarray) -> int:
    """Pixels that are mostly green: smooth lines mix it with what lies below."""
    blue, level, red = picture.astype(int).transpose(2, 0, 1)
    return int(np.count_nonzero(level - np.maximum(blue, red) > 50))


@pytest.mark.long
@pytest.mark.parametrize(
    "spec", ["charuco:5x4:30mm:22mm:DICT_4X4_50", "aprilgrid:3x3:40mm:0.3:36h11", "marker:100mm:DICT_4X4_50:3"]
)
def test_five_pictures_of_each_photo(tmp_path: Path, spec: str) -> None:
    target = parse_target(spec)
    middle = np.asarray(target.points).mean(axis=0)
    T = se3.make(np.eye(3), np.array([0.0, 0.0, 0.35]) - middle)
    (tmp_path / "photos").mkdir()
    image = render(target.artwork(), CAMERA, T, rng=np.random.default_rng(1), look=Look(clutter=0))
    cv2.imwrite(str(tmp_path / "photos" / "board.png"), image)
    cv2.imwrite(str(tmp_path / "photos" / "blank.png"), np.full((480, 640), 128, np.uint8))
    documents = list(detect.run(request_for(tmp_path, spec)).documents)
    names = {f"{name}-stage-{stage}.png" for name in ("board", "blank") for stage in STAGES}
    assert {d.path.name for d in documents} == names
    pictures = {d.path.name: cv2.imdecode(np.frombuffer(d.bytes(), np.uint8), cv2.IMREAD_COLOR) for d in documents}
    decoded, quads = (pictures[f"board-stage-{stage}.png"] for stage in ("4-decoded", "3-quads"))
    assert green(decoded) > 100
    assert green(quads) == 0


def test_photos_that_show_no_board_have_stages_and_say_where_it_was_lost(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    other = parse_target("marker:100mm:DICT_4X4_50:3").artwork()
    T = se3.make(np.eye(3), np.array([0.0, 0.0, 0.35]))
    image = render(other, CAMERA, T, rng=np.random.default_rng(1), look=Look(clutter=0))
    cv2.imwrite(str(tmp_path / "photos" / "other.png"), image)
    cv2.imwrite(str(tmp_path / "photos" / "blank.png"), np.full((480, 640), 128, np.uint8))
    outcome = detect.run(request_for(tmp_path, "marker:100mm:DICT_6X6_50:3"))
    assert isinstance(outcome.refusal, DetectionError)
    assert "blank.png lost at stage 2-threshold: nothing is dark" in str(outcome.refusal)
    assert "other.png lost at stage 4-decoded: " in str(outcome.refusal)
    assert len(list(outcome.documents)) == 10
    assert outcome.result is None
    again = detect.run(request_for(tmp_path, "marker:100mm:DICT_4X4_50:4"))
    assert "other.png lost at stage 5-corners: of DICT_4X4_50 read (3)" in str(again.refusal)


def test_a_board_without_markers_has_no_stages(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--stages shows how markers are found"):
        detect.run(request_for(tmp_path, "chessboard:9x6:25mm"))
