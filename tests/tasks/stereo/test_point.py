"""`calibrant point`: two pictures of a board and a stick give the spot; bad input is named."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibrant.cameras import Camera
from calibrant.geometry import se3
from calibrant.simulate.render import Look, render
from calibrant.targets.registry import parse_target

TARGET = "chessboard:9x6:40mm"
SPOT = np.array([0.21, 0.12, 0.0])
HAND = np.array([0.33, 0.27, -0.30])
"""Above the board: its z looks away from the cameras."""


def _looking(eye: np.ndarray, at: np.ndarray) -> np.ndarray:
    z = (at - eye) / np.linalg.norm(at - eye)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return se3.inverse(se3.make(np.stack([x, np.cross(z, x), z], axis=1), eye))


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A board on the table and a green stick above it that points at SPOT, by two cameras."""
    folder = tmp_path_factory.mktemp("pointing")
    rng = np.random.default_rng(1)
    target = parse_target(TARGET)
    out = []
    for name, eye, f in (("left", [-0.25, -0.2, -0.8], 640.0), ("right", [0.6, -0.1, -0.75], 600.0)):
        camera = Camera.create("pinhole", {"fx": f, "fy": f, "cx": 322.0, "cy": 238.0}, image_size=(640, 480))
        T = _looking(np.array(eye), target.points.mean(axis=0))
        image = render(target.artwork(), camera, T, rng=rng, look=Look(clutter=0, noise_grey=2.0))
        colour = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
        stick = camera.project(se3.apply(T, np.stack([HAND, SPOT + 0.35 * (HAND - SPOT)])))
        ends = [tuple(int(c) for c in np.rint(16 * p)) for p in stick]
        cv2.line(colour, *ends, (60, 190, 60), 7, cv2.LINE_AA, 4)
        out.append(folder / f"{name}.png")
        cv2.imwrite(str(out[-1]), colour)
    return out


def test_the_spot_on_a_board_with_a_stick_found_by_its_colour(calibrant, pictures, tmp_path: Path) -> None:
    seen = tmp_path / "spot.png"
    options = ["--left", pictures[0], "--right", pictures[1], "--target", TARGET, "--hue", "90..150deg"]
    outcome = calibrant("point", *options, "--overlay", seen, "--json")
    assert outcome.status == 0, outcome.err
    found = json.loads(outcome.out)["figures"]
    for name, truth in zip("xy", SPOT):
        assert abs(found[name]["value"] - truth) < 3.5 * found[name]["sigma"]
        assert found[name]["sigma"] < 0.004
    assert cv2.imread(str(seen)).shape == (480, 1280, 3)
    told = calibrant("point", *options).out
    assert "spot, x" in told
    assert "mm" in told


def test_what_nothing_says_is_a_pointer_is_doubted(calibrant, pictures, tmp_path: Path) -> None:
    """A screen's edge, of no hue, beside the board; by its colour the stick is what was asked for."""
    files = []
    for file, edge in zip(pictures, (np.s_[-30:-20, 20:-20], np.s_[20:-20, -30:-20])):
        image = cv2.imread(str(file))
        image[edge] = 255
        image[10:20, 20:200] = 255
        files.append(tmp_path / file.name)
        cv2.imwrite(str(files[-1]), image)
    options = ["--left", files[0], "--right", files[1], "--target", TARGET, "--json"]
    axes = ["--left-axis", "320,20", "330,90", "--right-axis", "300,20", "280,90"]
    by_hue, by_length, given = (
        json.loads(calibrant("point", *options, *more).out) for more in (["--hue", "90..150deg"], [], axes)
    )
    checks = [{c["name"]: c for c in found["checks"]} for found in (by_hue, by_length, given)]
    assert checks[0]["pointer"]["status"] == "ok"
    assert checks[1]["pointer"]["status"] == "warn"
    assert "times as long as the next one" in checks[1]["pointer"]["message"]
    assert "pointer" not in checks[2]


def test_a_spot_outside_of_the_corners_is_warned_of(calibrant) -> None:
    square = ["--left-corners", "0,0", "0,100", "100,0", "100,100", "--left-axis", "125,0", "125,50"]
    other = ["--right-corners", "10,10", "10,90", "90,10", "90,90", "--right-axis", "0,30", "50,30"]
    checks = json.loads(calibrant("point", *square, *other, "--json").out)["checks"]
    inside = next(c for c in checks if c["name"] == "inside")
    assert inside["status"] == "warn"
    assert "outside of the corners, by 0.25 of" in inside["message"]


def test_corners_and_axes_by_their_pixels(calibrant) -> None:
    square = ["--left-corners", "0,0", "0,100", "100,0", "100,100", "--left-axis", "25,0", "25,50"]
    other = ["--right-corners", "10,10", "10,90", "90,10", "90,90", "--right-axis", "0,30", "50,30"]
    outcome = calibrant("point", *square, *other, "--json")
    found = json.loads(outcome.out)["figures"]
    assert found["x"]["value"] == pytest.approx(0.25, abs=1e-9)
    assert "unit" not in found["x"] or found["x"]["unit"] == ""
    outcome = calibrant("point", *square, *other, "--plane", "600mmx400mm", "--json")
    assert json.loads(outcome.out)["figures"]["x"] | {"sigma": 0} == {
        "value": pytest.approx(0.15),
        "sigma": 0,
        "unit": "m",
    }
    parallel = [*other[:-2], "30,0", "30,50"]
    outcome = calibrant("point", *square, *parallel)
    assert outcome.status == 1
    assert "pointer in one plane with both cameras" in outcome.err or "pointer parallel to the plane" in outcome.err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--left-corners", "0,0", "1"], "--left-corners takes pixels as U,V"),
        (["--left-corners", "0,0", "0,9", "9,0", "9,9"], "--right-corners has 0 points, the plane 4"),
        (["--plane", "600x400"], "600mm or 600m"),
        (["--target", TARGET], "give the left camera's picture"),
        (["--overlay", "a.png"], "--overlay draws over two pictures"),
        (["--sigma-px", "0.5"], "0.5"),
    ],
)
def test_bad_input_is_named(calibrant, options: list[str], words: str) -> None:
    outcome = calibrant("point", *options)
    assert outcome.status == 2
    assert words in outcome.err.replace("\n", " ")
