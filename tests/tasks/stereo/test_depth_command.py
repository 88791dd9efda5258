"""`calibrant depth`: a cloud, a map and a picture of a rendered pair, and bad input by name."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.perceive.stereo.made import small_eyes
from tests.perceive.stereo.rendered import photograph, scene

from calibrant.data import CalibrationResult, as_transform
from calibrant.formats.clouds import read_ply
from calibrant.geometry import se3


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """left.png, right.png of a wall, a sphere and a box at a metre, and the pair's result file with a covariance."""
    folder = tmp_path_factory.mktemp("depth")
    eyes = small_eyes()
    rng = np.random.default_rng(2)
    for name, camera, T in zip(eyes.names, eyes.cameras, eyes.T_first_camera):
        image = photograph(scene(1.0), camera, T, grain=5 / 265, rng=rng, noise=2.0)
        cv2.imwrite(str(folder / f"{name}.png"), np.stack([image // 2, image, image], axis=-1))
    C = np.diag([1e-4**2] * 3 + [1e-4**2] * 3)
    place = as_transform("left", "right", eyes.T_first_camera[1], C)
    cameras = dict(zip(eyes.names, eyes.cameras))
    CalibrationResult("rig", "ok", cameras=cameras, transforms=(place,)).write(folder / "stereo.json")
    return folder


def test_a_cloud_with_colours_and_the_sigma_of_every_depth(calibrant, pair: Path, tmp_path: Path) -> None:
    cloud, maps, picture = tmp_path / "c.ply", tmp_path / "m.npz", tmp_path / "d.png"
    sides = ["--left", pair / "left.png", "--right", pair / "right.png"]
    done = calibrant(
        "depth", pair / "stereo.json", *sides, "--cloud", cloud, "--maps", maps, "--picture", picture, "--json"
    )
    assert done.status == 0, done.err
    figures = json.loads(done.out)["figures"]
    points = read_ply(cloud)
    assert len(points) == figures["points"]["value"]
    assert points.frame == "left"
    assert points.colours is not None
    red, green, blue = points.colours.astype(int).T
    np.testing.assert_array_equal(red, green)
    assert np.abs(blue - red / 2).max() <= 1
    total = np.hypot(points.values["sigma_matches"], points.values["sigma_calibration"])
    np.testing.assert_allclose(points.values["sigma_z"], total, rtol=1e-5)
    assert 0.8 < np.median(points.points[:, 2]) < 1.3
    assert np.load(maps)["points"].shape == (240, 320, 3)
    assert np.isfinite(np.load(maps)["points"][..., 2]).any()
    drawn = cv2.imread(str(picture))
    assert drawn.shape[0] == 480
    assert 380 < drawn.shape[1] < 520  # the scales in mm at the right
    unknown = np.isnan(np.load(maps)["points"][..., 2])
    np.testing.assert_array_equal(drawn[:240, :320].max(axis=2) == 0, unknown)


def test_opencvs_stereo_file_serves_and_the_report_shows_the_picture(calibrant, pair: Path, tmp_path: Path) -> None:
    given, yml, report = pair / "stereo.json", tmp_path / "stereo.yml", tmp_path / "depth.html"
    eyes = small_eyes()
    T = se3.inverse(eyes.T_first_camera[1])
    lens = "".join(
        f"K{i}: [[{c.K[0, 0]}, 0, {c.K[0, 2]}], [0, {c.K[1, 1]}, {c.K[1, 2]}], [0, 0, 1]]\n"
        f"D{i}: {[c.parameters[n] for n in ('k1', 'k2', 'p1', 'p2', 'k3')]}\n"
        for i, c in enumerate(eyes.cameras, 1)
    )
    place = f"R: {T[:3, :3].tolist()}\nT: {(1e3 * T[:3, 3]).tolist()}\nT_unit: mm\nimage_size: [320, 240]\n"
    yml.write_text(lens + place)
    sides = ["--left", pair / "left.png", "--right", pair / "right.png"]
    by_file = [calibrant("depth", file, *sides, "--json", "--report", report, "--force") for file in (given, yml)]
    assert [done.status for done in by_file] == [0, 0], by_file[1].err
    ours, theirs = (json.loads(done.out)["figures"] for done in by_file)
    assert theirs["median_depth"]["value"] == pytest.approx(ours["median_depth"]["value"], rel=1e-6)
    assert "it states no uncertainty" in by_file[1].out
    assert 'alt="Depth in colours"' in report.read_text()


@pytest.mark.parametrize(
    ("sides", "more", "words", "status"),
    [
        ("right left", [], "the sides are exchanged", 1),
        ("left left", [], "given as the left and as the right picture", 2),
        ("left right", ["--cloud", "c.xyz"], "it is written as .ply", 2),
        ("left right", ["--near", "2m", "--far", "1m"], "0 < near < far", 2),
        ("left right", ["--near", "20"], "has no unit", 2),
        ("left right", ["--confidence", "2"], "--confidence is 0", 2),
        ("left right", ["--near", "0.05m", "--far", "0.1m"], "the cloud is empty", 1),
    ],
)
def test_bad_input_is_named(calibrant, pair: Path, sides: str, more: list[str], words: str, status: int) -> None:
    left, right = (pair / f"{side}.png" for side in sides.split())
    done = calibrant("depth", pair / "stereo.json", "--left", left, "--right", right, *more)
    assert words in " ".join(done.err.split())
    assert done.status == status


def test_pictures_of_another_size_are_named(calibrant, pair: Path, tmp_path: Path) -> None:
    small = tmp_path / "small.png"
    cv2.imwrite(str(small), np.zeros((100, 100), np.uint8))
    done = calibrant("depth", pair / "stereo.json", "--left", small, "--right", pair / "right.png")
    assert "is 100x100 px, the left camera is for images of 320x240 px" in " ".join(done.err.split())
