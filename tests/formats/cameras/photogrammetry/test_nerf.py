"""NeRF's transforms.json: OpenGL's axes, pixels from the corner, one camera or many, the field of view alone."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calibrant as cb
from calibrant.errors import InputError
from calibrant.formats.exchange.exchange_format import ReadOptions
from calibrant.formats.exchange.read import read_any
from calibrant.geometry import se3, so3
from calibrant.reading.notes import heard

M = se3.make(so3.exp([0.3, -0.4, 2.0]), [0.5, -1.0, 2.0])
X = (M @ [0.2, 0.1, -1.5, 1])[:3]
"""A point before the camera, which looks along -z: x = 0.2 right, y = 0.1 up, 1.5 away."""
OWN: dict[str, Any] = {
    "camera_model": "OPENCV",
    "fl_x": 900.0,
    "fl_y": 910.0,
    "cx": 641.0,
    "cy": 358.5,
    "w": 1280,
    "h": 720,
    "k1": -0.1,
    "k2": 0.02,
    "p1": 1e-3,
    "p2": -2e-3,
}


def written(folder: Path, lens: dict[str, Any], **frame: Any) -> Path:
    frames = [{"file_path": "./images/a.png", "transform_matrix": M.tolist()} | frame]
    (folder / "transforms.json").write_text(json.dumps({**lens, "frames": frames}))
    return folder / "transforms.json"


def seen(file: Path, **options: Any) -> np.ndarray:
    found = cb.convert(file, **options)
    view = found.views[0]
    return found.cameras[str(view.camera)].project(se3.apply(view.T_camera_target, X))


def test_a_point_lands_where_the_equations_say(tmp_path: Path) -> None:
    x, y = 0.2 / 1.5, -0.1 / 1.5
    r2 = x * x + y * y
    g = 1 - 0.1 * r2 + 0.02 * r2**2
    u = x * g + 2e-3 * x * y - 2e-3 * (r2 + 2 * x * x)
    v = y * g + 1e-3 * (r2 + 2 * y * y) - 4e-3 * x * y
    np.testing.assert_allclose(seen(written(tmp_path, OWN)), [900 * u + 640.5, 910 * v + 358.0], atol=1e-9)


def test_a_field_of_view_alone_needs_the_size(tmp_path: Path) -> None:
    file = written(tmp_path, {"camera_angle_x": 0.6911112070083618}, rotation=0.01)
    with pytest.raises(InputError, match="image size"):
        cb.convert(file)
    f = 0.5 * 800 / np.tan(0.5 * 0.6911112070083618)
    uv = seen(file, image_size="800x800")
    np.testing.assert_allclose(uv, [399.5 + f * 0.2 / 1.5, 399.5 - f * 0.1 / 1.5], atol=1e-9)


def test_a_fisheye(tmp_path: Path) -> None:
    lens = OWN | {"camera_model": "OPENCV_FISHEYE", "p1": 0, "p2": 0, "k3": 0.003, "k4": -0.001}
    theta = np.arctan(np.hypot(0.2, 0.1) / 1.5)
    d = theta * (1 - 0.1 * theta**2 + 0.02 * theta**4 + 0.003 * theta**6 - 0.001 * theta**8)
    right, down = d * np.array([0.2, -0.1]) / np.hypot(0.2, 0.1)
    uv = seen(written(tmp_path, lens))
    np.testing.assert_allclose(uv, [900 * right + 640.5, 910 * down + 358.0], atol=1e-9)


def test_a_camera_a_frame(tmp_path: Path) -> None:
    frames = [
        {"file_path": f"{i}.png", "transform_matrix": M.tolist(), **OWN, "fl_x": 900.0 + (i > 1)} for i in range(4)
    ]
    (tmp_path / "t.json").write_text(json.dumps({"frames": frames, "aabb_scale": 16}))
    found = cb.convert(tmp_path / "t.json")
    assert [v.camera for v in found.views] == ["camera", "camera", "camera_1", "camera_1"]
    assert any("aabb_scale" in n for n in found.notes)
    assert any("--unit" in n for n in found.notes)


@pytest.mark.parametrize("cameras", [1, 2])
def test_round_trip(tmp_path: Path, cameras: int) -> None:
    file = written(tmp_path, OWN)
    if cameras == 2:
        data = json.loads(file.read_text())
        data["frames"].append({**OWN, "fl_x": 901.0, "file_path": "b.png", "transform_matrix": M.tolist()})
        file.write_text(json.dumps(data))
    before = cb.convert(file, unit="mm")
    cb.convert(file, tmp_path / "again.json", to="nerf", unit="mm")
    after = cb.convert(tmp_path / "again.json", unit="mm")
    for a, b in zip(before.views, after.views, strict=True):
        assert (a.id, a.camera) == (b.id, b.camera)
        np.testing.assert_allclose(a.T_camera_target, b.T_camera_target, atol=1e-12)
    assert after.cameras["camera"].parameters == pytest.approx(before.cameras["camera"].parameters, abs=1e-12)
    assert json.loads((tmp_path / "again.json").read_text())["frames"][0]["transform_matrix"][2][3] == pytest.approx(2)


@pytest.mark.parametrize(
    ("lens", "frame", "words"),
    [
        ({"k4": 0.1}, {}, "k4 0.1"),
        ({"camera_model": "EQUIRECTANGULAR"}, {}, "EQUIRECTANGULAR"),
        ({"camera_model": "OPENCV_FISHEYE"}, {}, "p1"),
        ({"fl_x": None, "fl_y": None}, {}, "focal length"),
        ({"fl_x": None, "fl_y": None, "camera_angle_x": 4.0}, {}, "camera_angle_x"),
        ({"w": 0}, {}, "image size"),
        ({}, {"transform_matrix": [[1, 0], [0, 1]]}, "shape"),
        ({}, {"transform_matrix": "x"}, "numbers"),
        ({}, {"transform_matrix": (np.diag([2.0, 2, 2, 1]) @ M).tolist()}, "transform_matrix"),
        ({}, {"transform_matrix": np.diag([1.0, 1, -1, 1]).tolist()}, "mirrors"),
        ({"fl_x": "wide"}, {}, "fl_x"),
    ],
)
def test_bad_files(tmp_path: Path, lens: dict[str, Any], frame: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        cb.convert(written(tmp_path, OWN | lens, **frame))


def test_a_scene_scaled_by_dividing_whole_matrices(tmp_path: Path) -> None:
    file = tmp_path / "transforms.json"
    lens = {"fl_x": 640.0, "fl_y": 641.0, "cx": 642.0, "cy": 366.0, "w": 1280, "h": 720}
    file.write_text(json.dumps(lens | {"frames": [{"file_path": "a.png", "transform_matrix": M.tolist()}]}))
    plain = cb.convert(file, unit="m").views[0].T_camera_target
    file.write_text(json.dumps(lens | {"frames": [{"file_path": "a.png", "transform_matrix": (M / 844.4).tolist()}]}))
    with heard() as notes:
        divided = read_any(file, ReadOptions(unit_m=1.0)).views[0].T_camera_target
    np.testing.assert_allclose(divided, plain, atol=1e-12)
    assert any("divided by its last number" in note for note in notes)
