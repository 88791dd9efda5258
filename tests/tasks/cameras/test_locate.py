"""`calibrant locate`: an object by colour and depth, its pictures, and what is missing named."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.perceive.boxes_on_a_table import Thing, camera_at, d435, exact_depth, looking_down, photograph

import calibrant as cb
from calibrant.cameras import Camera
from calibrant.cli.application import run
from calibrant.data import CalibrationResult, as_transform
from calibrant.data.details import LocatedObject
from calibrant.detection.images.depth_files import read_depth
from calibrant.errors import InputError, RefusedError
from calibrant.geometry import se3, so3
from calibrant.perceive.object_pose.poses import of_result

RED = "h:340-20 s:40-100 v:10-100"
SIDES = np.array([0.054, 0.037, 0.005])


class Files:
    def __init__(self, folder: Path, things: list[Thing]) -> None:
        self.camera, self.T, self.things = camera_at(308.0, (320, 240)), looking_down(0.24, 20.0), things
        self.colour, self.depth, self.known = folder / "colour.png", folder / "depth.png", folder / "camera.json"
        rng = np.random.default_rng(0)
        cv2.imwrite(str(self.colour), photograph(self.camera, self.T, things, rng))
        self.z = d435(exact_depth(self.camera, self.T, things), rng, f_b=15.4)
        cv2.imwrite(str(self.depth), np.rint(np.nan_to_num(1e4 * self.z) / 10).astype(np.uint16))
        CalibrationResult("intrinsics", "ok", cameras={"camera": self.camera}).write(self.known)


def _thing(x: float) -> Thing:
    return Thing(se3.make(so3.exp([0, 0, 0.5]), [x, 0.01, 0.0025]), SIDES)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    return Files(tmp_path_factory.mktemp("locate"), [_thing(0.01)])


def _ask(files: Files, **more: object) -> CalibrationResult:
    asked = {"depth": files.depth, "camera": files.known, "object": "box:54x37x5mm", "colour": RED}
    return cb.locate(files.colour, **(asked | more))  # type: ignore[arg-type]


def test_the_command_writes_pose_report_overlay_and_steps(files: Files, tmp_path: Path) -> None:
    out, page, steps = tmp_path / "o.json", tmp_path / "o.html", tmp_path / "steps"
    status = run(
        [
            *("locate", str(files.colour), "--depth", str(files.depth), "--camera", str(files.known)),
            *("--object", "box:54x37x5mm", "--colour", RED, "--out", str(out), "--report", str(page)),
            *("--overlay", str(tmp_path / "seen.png"), "--stages", str(steps)),
        ]
    )
    assert status == 0
    result = cb.read(out)
    (pose,) = of_result(result)
    truth = files.T @ files.things[0].T_table_box
    # Depth in whole millimetres has 0.3 mm of rounding a pixel; thousands of pixels and the edges remain.
    found = min(
        (se3.deviation(truth, T) for T in pose.matrix @ np.array(result.detail(LocatedObject).symmetries)),  # type: ignore[union-attr]
        key=lambda d: float(d[1]),
    )
    assert found[0] < 0.4
    assert found[1] < 0.5
    assert "Object pose" in page.read_text(encoding="utf-8")
    names = sorted(p.name for p in steps.iterdir())
    assert len(names) == 7
    assert all(cv2.imread(str(steps / n)).shape == (240, 320, 3) for n in names)
    # Corners are drawn over a copy: the smoothed picture has none.
    assert not np.array_equal(cv2.imread(str(steps / names[0])), cv2.imread(str(steps / names[5])))
    assert json.loads(out.read_text())["details"]["located_object"]["name"] == "box"


def test_without_a_colour_it_is_what_stands_out(files: Files) -> None:
    by_depth, by_colour = _ask(files, colour=None), _ask(files)
    away = by_depth.transforms[0].matrix[:3, 3] - by_colour.transforms[0].matrix[:3, 3]
    assert np.linalg.norm(away) < 5e-4


def test_a_colour_picked_from_a_pixel_and_depth_as_array(files: Files, tmp_path: Path) -> None:
    u, v = _ask(files).detail(LocatedObject).segment_px  # type: ignore[union-attr]
    array = tmp_path / "depth.npy"
    np.save(array, files.z)
    found = _ask(files, colour=f"pixel:{u:.0f},{v:.0f}", depth=array)
    assert found.transforms[0].matrix == pytest.approx(_ask(files).transforms[0].matrix, abs=3e-3)


def test_depth_of_a_camera_of_its_own(tmp_path: Path) -> None:
    files = Files(tmp_path, [_thing(0.01)])
    T_colour_depth = se3.make(so3.exp([0.01, -0.02, 0.005]), [0.015, 0.0, 0.001])
    depth_camera = Camera.create("pinhole", {"fx": 260.0, "fy": 260.0, "cx": 160, "cy": 118}, image_size=(320, 240))
    z = exact_depth(depth_camera, se3.inverse(T_colour_depth) @ files.T, files.things)
    np.save(tmp_path / "z.npy", d435(z, np.random.default_rng(3), f_b=13.0))
    spread = np.diag([1e-4] * 3 + [1e-4] * 3) ** 2
    pair = CalibrationResult(
        "rig",
        "ok",
        cameras={"colour": files.camera, "infra": depth_camera},
        transforms=(as_transform("colour", "infra", T_colour_depth, spread),),
    ).write(tmp_path / "pair.json")
    found = _ask(files, depth=tmp_path / "z.npy", camera=pair, depth_camera="infra").transforms[0]
    truth = files.T @ files.things[0].T_table_box
    assert np.linalg.norm(found.matrix[:3, 3] - truth[:3, 3]) < 4e-4
    other = CalibrationResult(
        "rig",
        "ok",
        cameras={"infra": depth_camera, "colour": files.camera},
        transforms=(as_transform("infra", "colour", se3.inverse(T_colour_depth), spread),),
    ).write(tmp_path / "other.json")
    again = _ask(files, depth=tmp_path / "z.npy", camera=other, depth_camera="infra").transforms[0]
    assert again.matrix == pytest.approx(found.matrix, abs=1e-6)
    with pytest.raises(InputError, match="colour, infra"):
        _ask(files, depth=tmp_path / "z.npy", camera=pair, depth_camera="left")


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"depth": None}, "depth.png"),
        ({"object": None}, "looked for"),
        ({"object": "box:54x37x5"}, "with a unit"),
        ({"colour": "red"}, "no range of colours"),
        ({"near": "12"}, "no pixel"),
        ({"sigma_scale": "0.5"}, "per cent"),
        ({"baseline": "50"}, "no unit"),
    ],
)
def test_what_cannot_be_used_is_named(files: Files, more: dict[str, object], says: str) -> None:
    with pytest.raises(InputError, match=says):
        _ask(files, **more)


def test_an_object_that_is_missing_and_two_of_them_are_refused(files: Files, tmp_path: Path) -> None:
    with pytest.raises(RefusedError, match="not found"):
        _ask(files, colour="h:100-140 s:40-100")
    two = Files(tmp_path, [_thing(-0.05), _thing(0.05)])
    with pytest.raises(RefusedError, match="2 parts"):
        _ask(two)
    right = two.camera.project(se3.apply(two.T, [0.05, 0.01, 0.005]))
    found = _ask(two, near=f"{right[0]:.0f},{right[1]:.0f}")
    truth = two.T @ two.things[1].T_table_box
    assert np.linalg.norm(found.transforms[0].matrix[:3, 3] - truth[:3, 3]) < 5e-4


def test_depth_files_that_are_none(files: Files, tmp_path: Path) -> None:
    grey = tmp_path / "grey.png"
    cv2.imwrite(str(grey), np.full((240, 320), 90, np.uint8))
    with pytest.raises(InputError, match="8 bits"):
        read_depth(grey)
    with pytest.raises(InputError, match="one number a pixel"):
        read_depth(files.colour)
    np.save(tmp_path / "small.npy", files.z[::2, ::2])
    with pytest.raises(InputError, match="160 x 120"):
        _ask(files, depth=tmp_path / "small.npy")
    np.save(tmp_path / "mm.npy", 1e3 * files.z)
    with pytest.raises(InputError, match="millimetres"):
        _ask(files, depth=tmp_path / "mm.npy")
    (tmp_path / "no.npy").write_bytes(b"not an array")
    with pytest.raises(InputError, match="no NumPy array"):
        read_depth(tmp_path / "no.npy")
