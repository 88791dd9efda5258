"""`calibrant rectify`: pictures whose matches share rows, maps that give the same, and bad input by name."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import calibrant as cb
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, as_transform
from calibrant.geometry import se3, so3
from calibrant.simulate.render import Look, render
from calibrant.simulate.scenes import look_at_board
from calibrant.targets.registry import parse_target
from calibrant.tasks.stereo.pairs import common_points

TARGET = "chessboard:7x6:30mm"
LEFT = Camera.create("brown", {"fx": 430.0, "fy": 428.0, "cx": 241.0, "cy": 178.0, "k1": -0.1}, image_size=(480, 360))
RIGHT = Camera.create("brown", {"fx": 440.0, "fy": 441.0, "cx": 236.0, "cy": 181.0, "k1": -0.15}, image_size=(480, 360))
T_LEFT_RIGHT = se3.make(so3.exp([0.01, -0.05, 0.02]), [0.08, 0.002, 0.003])
REAL = Path(__file__).parents[4] / "shared" / "data" / "opencv_stereo_9x6"


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with left/ and right/ pictures of a board and the pair's truth as a result file."""
    folder = tmp_path_factory.mktemp("pair")
    rng = np.random.default_rng(4)
    target = parse_target(TARGET)
    poses = look_at_board(LEFT, target.points, 2, rng=rng, distance=(0.5, 0.6), tilt_deg=30)
    for side, camera, T in (("left", LEFT, np.eye(4)), ("right", RIGHT, se3.inverse(T_LEFT_RIGHT))):
        (folder / side).mkdir()
        for i, pose in enumerate(poses):
            image = render(target.artwork(), camera, T @ pose, rng=rng, look=Look(clutter=0, noise_grey=2.0))
            cv2.imwrite(str(folder / side / f"{i}.png"), image)
    cameras = {"left": LEFT, "right": RIGHT}
    CalibrationResult("rig", "ok", cameras=cameras, transforms=(as_transform("left", "right", T_LEFT_RIGHT),)).write(
        folder / "stereo.json"
    )
    return folder


def test_rectified_pictures_show_the_board_on_common_rows(calibrant, pair: Path, tmp_path: Path) -> None:
    out, rows, maps = tmp_path / "out", tmp_path / "rows", tmp_path / "maps.npz"
    sides = ["--left", pair / "left", "--right", pair / "right"]
    done = calibrant(
        "rectify", pair / "stereo.json", *sides, "--out", out, "--rows", rows, "--maps", maps, "--target", TARGET
    )
    assert done.status == 0, done.err
    assert "share a row to" in done.out
    views = [cb.detect(sorted((out / s).glob("*.png")), target=TARGET).views for s in ("left", "right")]
    for a, b in zip(*views, strict=True):
        (one, other), _ = common_points(a, b)
        assert np.sqrt(np.mean((one - other)[:, 1] ** 2)) < 0.2  # what the finder errs by on pictures of this size
        assert (one - other)[:, 0].min() > 20
    saved = np.load(maps)
    photo = cv2.imread(str(pair / "left" / "0.png"), -1)
    own = cv2.remap(photo, saved["left_map_u"], saved["left_map_v"], cv2.INTER_LINEAR)
    turned = cv2.imread(str(out / "left" / "0.png"), -1)
    assert np.abs(own.astype(int) - turned).max() <= 2  # 1/32 px steps
    assert saved["Q"].shape == (4, 4)
    assert cv2.imread(str(rows / "0-rows.png")).shape == (720, 960, 3)
    again = cb.read(out / "rectified.json")
    assert again.cameras["left"].parameters == again.cameras["right"].parameters
    assert again.figures["row_error"].value < 0.1
    # What was written is a rectified pair of its own: nothing turns a second time.
    second = calibrant("rectify", out / "rectified.json", "--maps", tmp_path / "again.yml.gz", "--json")
    R = np.array(json.loads(second.out)["details"]["rectified_pair"]["R_rectified_camera"])
    np.testing.assert_allclose(R, [np.eye(3)] * 2, atol=1e-12)


def test_cylinders_are_written_too(calibrant, pair: Path, tmp_path: Path) -> None:
    sides = ["--left", pair / "left", "--right", pair / "right"]
    done = calibrant(
        *("rectify", pair / "stereo.json", *sides, "--out", tmp_path / "o", "--projection", "cylinder"),
        *("--size", "600x400", "--alpha", "1", "--principal", "own"),
    )
    assert done.status == 0, done.err
    assert cv2.imread(str(tmp_path / "o" / "right" / "1.png")).shape == (400, 600, 3)
    assert "cylinder" in done.out


def test_a_width_alone_keeps_the_shape_of_the_pictures(calibrant, pair: Path, tmp_path: Path) -> None:
    done = calibrant("rectify", pair / "stereo.json", "--maps", tmp_path / "m.npz", "--size", "240", "--json")
    assert json.loads(done.out)["cameras"]["left"]["image_size"] == [240, 180]


def test_exchanged_sides_are_named(calibrant, pair: Path, tmp_path: Path) -> None:
    sides = ["--left", pair / "right", "--right", pair / "left"]
    done = calibrant("rectify", pair / "stereo.json", *sides, "--rows", tmp_path / "r", "--target", TARGET)
    assert done.status == 1
    assert "the sides are exchanged" in done.err
    assert not (tmp_path / "r").exists()
    wrong = cb.read(pair / "stereo.json")
    exchanged = tmp_path / "exchanged.json"
    CalibrationResult(
        "rig",
        "ok",
        cameras=wrong.cameras,
        transforms=(as_transform("left", "right", se3.inverse(T_LEFT_RIGHT)),),
    ).write(exchanged)
    done = calibrant("rectify", exchanged, "--maps", tmp_path / "m.npz")
    assert "--cameras right,left" in " ".join(done.out.split())


def test_opencvs_file_of_the_pair_gives_the_same_maps(calibrant, pair: Path, tmp_path: Path) -> None:
    opencv = tmp_path / "stereo.yml"
    T = se3.inverse(T_LEFT_RIGHT)
    file = cv2.FileStorage(str(opencv), cv2.FILE_STORAGE_WRITE)
    for number, camera in ((1, LEFT), (2, RIGHT)):
        file.write(f"image_width_{number}", 480)
        file.write(f"image_height_{number}", 360)
        file.write(f"K{number}", camera.K)
        file.write(f"D{number}", np.array([[camera.parameters["k1"], 0, 0, 0, 0]]))
    file.write("R", T[:3, :3])
    file.write("T", 1e3 * T[:3, 3:])
    file.release()
    arguments = ["--maps", tmp_path / "of_opencv.npz"]
    refused = calibrant("rectify", opencv, *arguments)
    assert refused.status == 2
    assert "T_unit: mm" in " ".join(refused.err.split())
    opencv.write_text(opencv.read_text() + "T_unit: mm\n")
    assert calibrant("rectify", opencv, *arguments).status == 0
    assert calibrant("rectify", pair / "stereo.json", "--maps", tmp_path / "ours.npz").status == 0
    theirs, ours = (np.load(tmp_path / f"{name}.npz") for name in ("of_opencv", "ours"))
    for key in ours.files:
        np.testing.assert_allclose(theirs[key], ours[key], rtol=1e-5, atol=1e-4)


def test_pictures_of_another_size_are_refused_by_name_and_side(calibrant, pair: Path, tmp_path: Path) -> None:
    small = tmp_path / "0.png"
    cv2.imwrite(str(small), cv2.imread(str(pair / "right" / "0.png"))[::2, ::2])
    sides = ["--left", pair / "left" / "0.png", "--right", small]
    done = calibrant("rectify", pair / "stereo.json", *sides, "--out", tmp_path / "out")
    assert done.status == 2
    words = " ".join(done.err.split())
    assert f"{small}, a right picture (camera right): the image is 240x180 px" in words
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--left", "{left}/0.png", "--right", "{right}", "--out", "{out}"], "1 of the right camera without a partner"),
        (["--left", "{left}/0.png", "--right", "{left}/0.png", "--out", "{out}"], "as a left and as a right picture"),
        (["--left", "{left}", "--right", "{right}"], "where shall the pictures go"),
        ([], "what shall be rectified"),
        (["--maps", "m.txt"], "the name says the format"),
        (["--maps", "{out}.npz", "--cameras", "left"], "the names of two cameras"),
        (["--maps", "{out}.npz", "--alpha", "3"], "alpha is 3"),
        (["--maps", "{out}.npz", "--size", "9x"], "--size takes WIDTHxHEIGHT"),
    ],
)
def test_bad_input_is_named(calibrant, pair: Path, tmp_path: Path, more: list[str], words: str) -> None:
    names = {"left": pair / "left", "right": pair / "right", "out": tmp_path / "o"}
    done = calibrant("rectify", pair / "stereo.json", *[m.format(**names) for m in more])
    assert words in " ".join((done.err + done.out).split())


@pytest.mark.skipif(not REAL.is_dir(), reason="the shared data set opencv_stereo_9x6 is not there")
@pytest.mark.long
def test_rows_of_the_stereo_set_that_opencv_ships(calibrant, tmp_path: Path) -> None:
    stereo = tmp_path / "stereo.json"
    sides = [*("--left", *sorted(REAL.glob("left*.jpg"))), *("--right", *sorted(REAL.glob("right*.jpg")))]
    assert calibrant("stereo", *sides, "--target", "chessboard:9x6:25mm", "--out", stereo).status == 0
    done = calibrant("rectify", stereo, "--maps", tmp_path / "maps.npz", "--json")
    assert json.loads(done.out)["figures"]["row_error"]["value"] <= 0.12
