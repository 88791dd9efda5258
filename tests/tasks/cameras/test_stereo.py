"""`calibrant stereo` on real images: the figures that OpenCV's best does not reach, files, marks, what is refused."""

from __future__ import annotations

import contextlib
import io
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.cli.application import run
from calibrant.data import CalibrationResult
from calibrant.data.details import EpipolarErrors, MarkedPoints, StereoGeometry, TriangulatedEdges
from calibrant.errors import InputError, RefusedError
from calibrant.opencv import cv2

TARGET = "chessboard:9x6:25mm"


@pytest.fixture(scope="module")
def images(shared_data: Callable[[str], Path]) -> Path:
    return shared_data("opencv_stereo_9x6")


@pytest.fixture(scope="module")
def result(images: Path) -> CalibrationResult:
    return cb.stereo(left=images / "left*.jpg", right=images / "right*.jpg", target=TARGET)


def said(arguments: list[str]) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run(arguments)
    return status, out.getvalue(), err.getvalue()


def test_figures_on_real_images(result: CalibrationResult) -> None:
    """Beside OpenCV's best on these images: 0.203 px, 83.19 mm, edges to 0.166 mm."""
    assert result.rms_px is not None
    assert result.rms_px <= 0.185
    assert result.figures["baseline"].value == pytest.approx(83.20, abs=0.10)
    assert result.figures["baseline"].sigma < 0.1
    edges, errors = result.detail(TriangulatedEdges), result.detail(EpipolarErrors)
    assert edges is not None
    assert edges.rms_mm <= 0.13
    assert abs(edges.mean_mm) < 0.02
    assert errors is not None
    assert len(errors.pairs) == 13
    assert errors.rms_px < 0.13
    assert {v.id: v.used for v in result.views}["right09.jpg"]
    # Oriented wrongly, a board of 200 mm is seen half a turn away: hundreds of pixels.
    assert errors.pairs[next(m for m in errors.pairs if m.endswith("left09"))].max_px < 1
    assert result.check("pairing").message == "13 pairs by name"


def test_the_pair_in_opencvs_file(images: Path, tmp_path: Path, result: CalibrationResult) -> None:
    left, right = (sorted(map(str, images.glob(f"{side}*.jpg"))) for side in ("left", "right"))
    status, _, err = said(
        ["stereo", "--left", *left, "--right", *right, "--target", TARGET, "--out", str(tmp_path / "pair.json")]
    )
    assert status == 0, err
    storage = cv2.FileStorage(str(tmp_path / "stereo.yml"), cv2.FILE_STORAGE_READ)
    value = {key: storage.getNode(key).mat() for key in ("K1", "M1", "D1", "K2", "M2", "D2", "R", "T", "E", "F")}
    assert storage.getNode("T_unit").string() == "mm"
    T = np.linalg.inv(result.transform("left", "right").matrix)
    np.testing.assert_allclose(value["R"], T[:3, :3], atol=1e-12)
    np.testing.assert_allclose(value["T"].ravel(), 1e3 * T[:3, 3], atol=1e-9)
    for number, side in ((1, "left"), (2, "right")):
        camera = result.cameras[side]
        np.testing.assert_allclose(value[f"K{number}"], camera.K, atol=1e-9)
        np.testing.assert_array_equal(value[f"K{number}"], value[f"M{number}"])
        wanted = [camera.parameters[k] for k in ("k1", "k2", "p1", "p2", "k3")]
        np.testing.assert_allclose(value[f"D{number}"].ravel(), wanted, atol=1e-12)
    pair = result.detail(StereoGeometry)
    assert pair is not None
    np.testing.assert_allclose(value["F"], pair.F, atol=1e-12)
    np.testing.assert_allclose(value["E"], 1e3 * np.array(pair.E), atol=1e-9)
    again = cb.read(tmp_path / "pair.json")
    assert again.summary() == result.summary()


@pytest.mark.long
def test_points_are_marked_and_then_left_out(images: Path, tmp_path: Path, result: CalibrationResult) -> None:
    given = {"left": images / "left*.jpg", "right": images / "right*.jpg", "target": TARGET}
    marked = cb.stereo(**given, mark_left="0.4px", mark_epipolar="0.3px")
    assert marked.rms_px == result.rms_px
    marks = marked.detail(MarkedPoints)
    assert marks is not None
    assert marks.limits_px == {"left": 0.4, "epipolar": 0.3}
    count = sum(map(len, marks.points.values()))
    assert count > 4
    marked.write(tmp_path / "marked.json")
    without = cb.stereo(**given, without_marked=tmp_path / "marked.json")
    before = result.observations
    after = without.observations
    assert before is not None
    assert after is not None
    assert sum(map(len, before.views)) - sum(map(len, after.views)) == count
    errors = without.detail(EpipolarErrors)
    assert errors is not None
    assert errors.max_px < 0.5


def test_the_options_of_each_side(images: Path, tmp_path: Path) -> None:
    own = cb.intrinsics(images / "left*.jpg", target=TARGET)
    own.write(tmp_path / "left.json")
    found = cb.stereo(
        left=images / "left*.jpg",
        right=images / "right*.jpg",
        target=TARGET,
        camera=[f"left={tmp_path / 'left.json'}"],
        model=["right:rational"],
        fix=["right:k4,right:k5,right:k6,right:k3"],
    )
    assert found.cameras["right"].model.name == "rational"
    assert all(found.cameras["right"].parameters[k] == 0 for k in ("k3", "k4", "k5", "k6"))
    assert found.decided["camera left"] == "given with its covariance, refined jointly"
    off = found.cameras["left"].values - own.camera.values
    assert own.camera.covariance is not None
    assert np.all(np.abs(off) < 4 * np.sqrt(np.diag(own.camera.covariance)))


def test_excluding_one_image_drops_its_pair(images: Path) -> None:
    found = cb.stereo(left=images / "left*.jpg", right=images / "right*.jpg", target=TARGET, exclude=["left03.jpg"])
    assert {v.id for v in found.views}.isdisjoint({"left03.jpg", "right03.jpg"})
    assert len(found.views) == 24


def test_points_found_before_serve_again(tmp_path: Path, result: CalibrationResult) -> None:
    result.write(tmp_path / "pair.json")
    again = cb.stereo(observations=tmp_path / "pair.json")
    np.testing.assert_array_equal(again.transforms[0].matrix, result.transforms[0].matrix)


def test_what_contradicts_itself_is_refused(images: Path, tmp_path: Path) -> None:
    left, right = str(images / "left*.jpg"), str(images / "right*.jpg")
    for given, words in (
        ({"left": left, "target": TARGET}, "no images of the right camera"),
        ({"left": left, "right": right}, "photos need the board"),
        ({"left": left, "right": right, "target": TARGET, "camera": ["cam.json"]}, "say of which camera"),
        ({"left": left, "right": right, "target": TARGET, "fix": ["left:k3,p1"]}, "of the left camera or of both"),
        ({"left": left, "right": right, "target": TARGET, "pairs": "luck"}, "choose auto, name, order, time"),
        ({"left": left, "right": left, "target": TARGET}, "is a photo of left and of right"),
    ):
        with pytest.raises(InputError, match=words):
            cb.stereo(**given)


def test_the_answer_as_json(images: Path) -> None:
    status, out, _ = said(
        ["stereo", "--left", str(images / "left*.jpg"), "--right", str(images / "right*.jpg"), "-t", TARGET, "--json"]
    )
    assert status == 0
    assert json.loads(out)["kind"] == "stereo"


def test_a_thermal_and_a_visual_camera(images: Path, tmp_path: Path, result: CalibrationResult) -> None:
    """The right camera has half the resolution and sees the board's colours the other way round."""
    for file in sorted(images.glob("right*.jpg")):
        grey = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        half = cv2.resize(255 - grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(tmp_path / f"{file.stem}.png"), half)
    found = cb.stereo(left=images / "left*.jpg", right=tmp_path / "right*.png", target=TARGET)
    assert "right sees a negative" in found.check("board-numbering").message
    assert found.cameras["right"].image_size == (320, 240)
    assert found.figures["baseline"].value == pytest.approx(result.figures["baseline"].value, abs=0.3)
    assert found.check("sides").status == "ok"


def test_a_camera_that_delivers_mirror_images(images: Path, tmp_path: Path, result: CalibrationResult) -> None:
    for file in sorted(images.glob("left*.jpg")):
        grey = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        cv2.imwrite(str(tmp_path / f"{file.stem}.png"), grey[:, ::-1])
    found = cb.stereo(left=tmp_path / "left*.png", right=images / "right*.jpg", target=TARGET, mirror_left=True)
    np.testing.assert_allclose(found.transforms[0].matrix, result.transforms[0].matrix, atol=1e-6)
    assert found.options["mirror_x"] == ["left"]


def test_sides_that_are_swapped_are_said(images: Path) -> None:
    found = cb.stereo(left=images / "right*.jpg", right=images / "left*.jpg", target=TARGET)
    assert found.check("sides").status == "warn"


@pytest.mark.long
def copied(images: Path, folder: Path, right: list[str], left: list[str] | None = None) -> dict[str, Path]:
    """The images of both sides in this order, numbered anew, as the options have them."""
    folder.mkdir()
    for k, names in enumerate(zip(left or sorted(f.name for f in images.glob("left*.jpg")), right)):
        for side, name in zip(("left", "right"), names):
            shutil.copy(images / name, folder / f"{side}{k:02d}.jpg")
    return {"left": folder / "left*.jpg", "right": folder / "right*.jpg"}


@pytest.mark.parametrize(
    ("order", "words"),
    [
        ([*range(6), *range(7, 13)], "pairs-shifted: from right06.jpg on right's pictures come one place too early"),
        ([*range(1, 13)], "pairs-shifted: right's pictures come one place too early: left01.jpg goes with right00.jpg"),
        ([*range(12, -1, -1)], "pairs-backwards"),
    ],
)
def test_lists_out_of_step_are_refused_as_the_doctor_names_them(
    images: Path, tmp_path: Path, order: list[int], words: str
) -> None:
    names = sorted(f.name for f in images.glob("right*.jpg"))
    with pytest.raises(RefusedError, match=words):
        cb.stereo(**copied(images, tmp_path / "pairs", [names[k] for k in order]), target=TARGET)


def test_sides_that_are_swapped_in_some_pairs_are_refused(images: Path, tmp_path: Path) -> None:
    left, right = (sorted(f.name for f in images.glob(f"{side}*.jpg")) for side in ("left", "right"))
    some = copied(images, tmp_path / "pairs", [*left[:4], *right[4:]], [*right[:4], *left[4:]])
    with pytest.raises(RefusedError, match=r"cameras-exchanged: 4 of 13 .* left00.jpg is by right and right00.jpg by"):
        cb.stereo(**some, target=TARGET)


def test_a_hidden_part_is_numbered_by_the_other_camera(images: Path, tmp_path: Path, result: CalibrationResult) -> None:
    """What a hand leaves of two boards counts, under the numbers that it has where all is seen."""
    assert result.observations is not None
    whole = {v.id: v for v in result.observations.views}
    for file in images.glob("*.jpg"):
        picture = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        if file.name in ("right03.jpg", "left05.jpg"):
            view = whole[file.name]
            hull = cv2.convexHull(view.uv[view.point_ids % 9 < 3].astype(np.float32)).reshape(-1, 2)
            hull = hull.mean(axis=0) + 1.9 * (hull - hull.mean(axis=0))
            cv2.fillConvexPoly(picture, np.rint(hull).astype(np.int32), 128)
        cv2.imwrite(str(tmp_path / f"{file.stem}.png"), picture)
    found = cb.stereo(left=tmp_path / "left*.png", right=tmp_path / "right*.png", target=TARGET)
    assert found.observations is not None
    assert found.check("pairs").value == 13
    assert any(note.endswith("left05.png, right03.png.") for note in found.notes)
    views = {v.id: v for v in found.observations.views}
    for name in ("right03", "left05"):
        part, all_of_it = views[f"{name}.png"], whole[f"{name}.jpg"]
        where = dict(zip(all_of_it.point_ids.tolist(), all_of_it.uv))
        assert 20 <= len(part) < 54
        np.testing.assert_allclose(part.uv, [where[i] for i in part.point_ids.tolist()], atol=0.05)
    assert found.figures["baseline"].value == pytest.approx(83.20, abs=0.15)
