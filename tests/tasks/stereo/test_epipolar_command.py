"""`calibrant epipolar`: from features of rendered pictures, from matches, against a calibration; bad input by name."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.perceive.stereo.made import pixels_of, seen_points, small_eyes
from tests.perceive.stereo.rendered import photograph, scene

from calibrant.data import CalibrationResult, as_transform
from calibrant.geometry import se3
from calibrant.perceive.stereo.points import points_from_matches

EYES = small_eyes()


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """left.png, right.png, their cameras, and the pair as a result."""
    folder = tmp_path_factory.mktemp("epipolar")
    rng = np.random.default_rng(2)
    for name, camera, T in zip(EYES.names, EYES.cameras, EYES.T_first_camera):
        image = photograph(scene(1.0), camera, T, grain=8 / 265, rng=rng, noise=2.0)
        cv2.imwrite(str(folder / f"{name}.png"), image)
        CalibrationResult("intrinsics", "ok", cameras={"camera": camera}).write(folder / f"{name}.json")
    place = as_transform("left", "right", EYES.T_first_camera[1])
    CalibrationResult("rig", "ok", cameras=dict(zip(EYES.names, EYES.cameras)), transforms=(place,)).write(
        folder / "stereo.json"
    )
    return folder


def test_the_relative_pose_from_features(calibrant, pair: Path, tmp_path: Path) -> None:
    T_true = EYES.T_first_camera[1]
    sides = ["--left", pair / "left.png", "--right", pair / "right.png"]
    known = ["--camera", pair / "left.json", pair / "right.json", "--baseline", f"{EYES.baseline}m"]
    done = calibrant("epipolar", *sides, *known, "--drawing", tmp_path / "lines.png", "--json")
    assert done.status == 0, done.err
    found = json.loads(done.out)
    mm, deg = se3.deviation(np.array(found["transforms"][0]["matrix"]), T_true)
    assert mm < 4
    assert deg < 0.5
    assert max(found["transforms"][0]["sigma_translation_mm"]) < 4
    assert cv2.imread(str(tmp_path / "lines.png")).shape == (240, 640, 3)
    assert "Essential matrix E" in calibrant("epipolar", *sides, *known).out
    assert "1000 mm" not in calibrant("epipolar", *sides, *known).out
    assert "put down as 1000 mm" in " ".join(calibrant("epipolar", *sides, *known[:3]).out.split())


def test_pictures_alone_and_against_a_calibration(calibrant, pair: Path, tmp_path: Path) -> None:
    sides = ["--left", pair / "left.png", "--right", pair / "right.png"]
    alone = calibrant("epipolar", *sides, "--drawing", tmp_path / "a.png", "--json")
    assert alone.status == 0, alone.err
    assert len(json.loads(alone.out)["details"]["epipolar_matrices"]["F"]) == 3
    assert "Fundamental matrix F" in calibrant("epipolar", *sides).out
    holds = calibrant("epipolar", *sides, "--stereo", pair / "stereo.json", "--drawing", tmp_path / "b.png")
    assert holds.status == 0, holds.err
    assert "GOOD" in holds.out
    exchanged = ["--left", pair / "right.png", "--right", pair / "left.png"]
    wrong = calibrant("epipolar", *exchanged, "--stereo", pair / "stereo.json")
    assert wrong.status == 1
    assert "are the sides exchanged" in " ".join(wrong.err.split())


def test_points_of_matches_with_their_sigma(calibrant, pair: Path, tmp_path: Path) -> None:
    X = seen_points(EYES, 30, np.random.default_rng(3))
    uv = pixels_of(EYES, X)
    matches, points = tmp_path / "matches.csv", tmp_path / "points.csv"
    rows = np.column_stack([uv[0], uv[1]])
    np.savetxt(matches, rows, delimiter=",", header="u_left,v_left,u_right,v_right", comments="", fmt="%.12g")
    sides = ["--left", pair / "left.png", "--right", pair / "right.png", "--stereo", pair / "stereo.json"]
    done = calibrant("epipolar", *sides, "--matches", matches, "--points", points)
    assert done.status == 0, done.err
    found = np.genfromtxt(points, delimiter=",", names=True)
    np.testing.assert_allclose(np.column_stack([found[n] for n in "xyz"]), X, atol=1e-7)
    expected = points_from_matches(EYES, uv, sigma_px=0.5)
    np.testing.assert_allclose(found["sigma_z"], expected.sigma_z, rtol=1e-6)
    assert np.all(found["sigma_z_calibration"] == 0)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--points", "p.csv"], "give --stereo"),
        (["--baseline", "120mm"], "give --camera too"),
        (["--camera", "a.json", "--stereo", "b.json"], "leave out --camera"),
        (["--sigma-px", "1"], "--sigma-px takes"),
    ],
)
def test_bad_input_is_named(calibrant, pair: Path, more: list[str], words: str) -> None:
    done = calibrant("epipolar", "--left", pair / "left.png", "--right", pair / "right.png", *more)
    assert done.status == 2
    assert words in " ".join(done.err.split()) or "a.json" in done.err
