"""`calibrant undistort`: pictures, the camera they are of, the maps, and what is said of bad input."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.data import CalibrationResult
from calibrant.data.result_file import write_result
from calibrant.formats.cameras.read import read_camera

TARGET = "chessboard:7x6:30mm"


@pytest.fixture
def camera_file(cell, tmp_path: Path) -> Path:
    result = CalibrationResult("intrinsics", "ok", cameras={"camera": cell.camera})
    return write_result(result, tmp_path / "camera.json")


def test_pictures_and_a_camera_that_later_commands_use(calibrant, cell, camera_file, tmp_path: Path, untouched) -> None:
    out = tmp_path / "straight"
    outcome = calibrant("undistort", *cell.photos, "--camera", camera_file, "--out", out, "--alpha", "0.5")
    assert (outcome.status, outcome.err) == (0, "")
    assert "Output camera: pinhole, 480 x 360 px" in outcome.out
    assert "% of the picture has no source and is black; the largest rectangle" in outcome.out
    assert "Written: 8 pictures and camera.json" in outcome.out
    assert sorted(p.name for p in out.iterdir()) == [*(f"{i:02d}.png" for i in range(8)), "camera.json"]
    output = read_camera(out / "camera.json")
    photo, straight = cv2.imread(cell.photos[0], -1), cv2.imread(str(out / "00.png"), -1)
    terms = np.array([cell.camera.parameters[k] for k in ("k1", "k2", "p1", "p2", "k3")])
    np.testing.assert_array_equal(straight, cv2.undistort(photo, cell.camera.K, terms, None, output.K))
    again = tmp_path / "again.json"
    outcome = calibrant(
        *("intrinsics", out, "--target", TARGET, "--model", "pinhole", "--initial", out / "camera.json"),
        *("--out", again, "-q"),
    )
    assert outcome.status == 0, outcome.err
    found = read_camera(again)
    # The pictures' own calibration is the camera that was written, within its uncertainty.
    for name, value in output.parameters.items():
        assert abs(found.parameters[name] - value) < 5 * found.sigma[name], name
    untouched()


def test_sixteen_bits_stay_and_a_bad_photo_costs_itself(calibrant, cell, camera_file, tmp_path: Path) -> None:
    photos, out = tmp_path / "photos", tmp_path / "out"
    photos.mkdir()
    deep = cv2.imread(cell.photos[0], cv2.IMREAD_GRAYSCALE).astype(np.uint16) * 257
    cv2.imwrite(str(photos / "deep.png"), deep)
    cv2.imwrite(str(photos / "small.png"), deep[:100])
    (photos / "broken.jpg").write_text("no image")
    outcome = calibrant("undistort", photos, "--camera", camera_file, "--out", out)
    assert (outcome.status, outcome.err) == (0, "")
    assert "the image is 480x100 px, the camera is for images of 480x360 px" in outcome.out
    assert "broken.jpg is not an image" in outcome.out
    straight = cv2.imread(str(out / "deep.png"), cv2.IMREAD_UNCHANGED)
    assert (straight.dtype, straight.shape) == (np.uint16, (360, 480))
    assert sorted(p.name for p in out.iterdir()) == ["camera.json", "deep.png"]
    outcome = calibrant("undistort", photos / "small.png", "--camera", camera_file, "--out", tmp_path / "none")
    assert outcome.status == 2
    assert "none of the photos could be used: " in outcome.err


@pytest.mark.parametrize("name", ["maps.npz", "maps.yml", "maps.yml.gz"])
def test_maps_are_for_remap(calibrant, cell, camera_file, tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    outcome = calibrant("undistort", "--camera", camera_file, "--maps", path, "--focal", "300px", "--size", "320x200")
    assert (outcome.status, outcome.err) == (0, "")
    if name.endswith(".npz"):
        with np.load(path) as archive:
            u, v, K = archive["map_u"], archive["map_v"], archive["K"]
    else:
        text = gzip.decompress(path.read_bytes()) if name.endswith(".gz") else path.read_bytes()
        storage = cv2.FileStorage(text.decode(), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        u, v, K = (storage.getNode(key).mat() for key in ("map_u", "map_v", "camera_matrix"))
    assert u.shape == v.shape == (200, 320)
    np.testing.assert_array_equal(K, [[300, 0, 159.5], [0, 300, 99.5], [0, 0, 1]])
    p = [(7 - 159.5) / 300, (11 - 99.5) / 300, 1.0]
    np.testing.assert_allclose([u[11, 7], v[11, 7]], cell.camera.project(p), atol=1e-4)


def test_json_and_a_camera_of_another_file(calibrant, cell, camera_file, tmp_path: Path) -> None:
    to = Camera.create("pinhole", {"fx": 200.0, "fy": 200.0, "cx": 99.0, "cy": 79.0}, image_size=(200, 160))
    other = write_result(CalibrationResult("intrinsics", "ok", cameras={"camera": to}), tmp_path / "other.json")
    outcome = calibrant(
        *("undistort", cell.photos[0], "--camera", camera_file, "--out", tmp_path / "o", "--to", other, "--json")
    )
    assert (outcome.status, outcome.err) == (0, "")
    data = json.loads(outcome.out)
    assert data["cameras"]["camera"]["parameters"] == to.parameters
    assert data["options"]["to"] == str(other)
    assert data["figures"]["without_source"]["value"] == 0
    assert data["details"]["valid_region"] == {"x": 0, "y": 0, "width": 200, "height": 160}
    assert cv2.imread(str(tmp_path / "o" / "00.png"), -1).shape[:2] == (160, 200)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--out", "o"], "which camera took the photos"),
        (["--camera", "C"], "where shall the pictures go"),
        (["--camera", "C", "--out", "o", "--alpha", "1.5"], "alpha is 1.5; expected 0"),
        (["--camera", "C", "--out", "o", "--alpha", "1", "--focal", "300px"], "leave out --alpha or --focal"),
        (["--camera", "C", "--out", "o", "--to", "C", "--size", "10x10"], "--to gives the whole camera"),
        (["--camera", "C", "--out", "o", "--size", "640"], "--size takes WIDTHxHEIGHT"),
        (["--camera", "C", "--out", "o", "--size", "99999x2"], "each 1 to 32767"),
        (["--camera", "C", "--out", "o", "--focal", "300"], "--focal takes a length in pixels with its unit"),
        (["--camera", "C", "--out", "o", "--maps", "m.txt"], "the name says the format"),
        (["--camera", "C", "--out", "C"], "is a file; give a folder"),
        (["--camera", "C", "--out", "x/y"], "there is no folder"),
    ],
)
def test_unusable_arguments_are_named(
    calibrant, cell, camera_file, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    given = [str(camera_file) if a == "C" else a for a in arguments]
    outcome = calibrant("undistort", cell.photos[0], *given)
    assert outcome.status == 2
    assert message in outcome.err
    assert not (tmp_path / "o").exists()


def test_nothing_is_written_over(calibrant, cell, camera_file, tmp_path: Path, untouched) -> None:
    outcome = calibrant("undistort", cell.photos[0], "--camera", camera_file, "--out", cell.images, "--force")
    assert outcome.status == 2
    assert "is an input of this command and is left alone" in outcome.err
    (tmp_path / "o").mkdir()
    (tmp_path / "o" / "00.png").write_text("mine")
    outcome = calibrant("undistort", cell.photos[0], "--camera", camera_file, "--out", tmp_path / "o")
    assert outcome.status == 2
    assert "00.png exists already" in outcome.err
    copy = tmp_path / "copy"
    copy.mkdir()
    (copy / "00.png").write_bytes(Path(cell.photos[0]).read_bytes())
    outcome = calibrant(
        *("undistort", cell.photos[0], copy / "00.png", "--camera", camera_file, "--out", tmp_path / "two")
    )
    assert outcome.status == 2
    assert "two photos would become" in outcome.err
    untouched()
