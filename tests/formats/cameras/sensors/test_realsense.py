"""RealSense's prints and JSON: streams, models, which way the rotation stands, what librealsense projects."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calibrant as cb
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

PRINT = """Device info:
    Name                          : \tIntel RealSense D435I

 Intrinsic of "Depth" / 640x360 / {Z16}
  Width:      \t640
  Height:     \t360
  PPX:        \t321.082885742188
  PPY:        \t177.282165527344
  Fx:         \t319.841674804688
  Fy:         \t319.841674804688
  Distortion: \tBrown Conrady
  Coeffs:     \t0  \t0  \t0  \t0  \t0
  FOV (deg):  \t90.03 x 58.74

 Intrinsic of "Color" / 640x360 / {YUYV/RGB8/BGR8/RGBA8/BGRA8/Y8/Y16}
  Width:      \t640
  Height:     \t360
  PPX:        \t325.301666259766
  PPY:        \t180.465133666992
  Fx:         \t456.511993408203
  Fy:         \t456.716552734375
  Distortion: \tInverse Brown Conrady
  Coeffs:     \t-0.0556738413870335  \t0.0655610412359238  \t-0.000339997815899551  \t0.000355891766957939  \t-0.0213657
  FOV (deg):  \t70.05 x 43.02

Extrinsic from "Depth"\t  To\t  "Color" :
 Rotation Matrix:
   0.99982          0.0182547        0.00521857
  -0.0182514        0.999833        -0.000682113
  -0.00523015       0.000586744      0.999986

 Translation Vector: 0.0148007115349174  0.000883136875927448  0.000735944486223161

Extrinsic from "Color"\t  To\t  "Depth" :
 Rotation Matrix:
   0.99982         -0.0182514       -0.00523015
   0.0182547        0.999833         0.000586744
   0.00521857      -0.000682113      0.999986

 Translation Vector: -0.0147  -0.0011  -0.0008
"""
R, T = so3.exp([0.01, 0.02, -0.03]), np.array([0.0148, 0.0009, 0.0007])
COEFFS = [-0.0556, 0.0655, -0.00034, 0.00036, -0.0213]


def stream(**more: Any) -> dict[str, Any]:
    plain = {"width": 640, "height": 480, "ppx": 326.66, "ppy": 247.33, "fx": 386.7, "fy": 386.3}
    return {**plain, "model": "distortion.brown_conrady", "coeffs": COEFFS} | more


def written(folder: Path, value: Any, name: str = "realsense.json") -> Path:
    (folder / name).write_text(value if isinstance(value, str) else json.dumps(value))
    return folder / name


def test_what_the_tool_prints(tmp_path: Path) -> None:
    found = cb.convert(written(tmp_path, PRINT, "out.txt"))
    assert (found.cameras["Depth"].model.name, found.cameras["Color"].model.name) == ("pinhole", "inverse_brown")
    T_color_depth = se3.inverse(found.transform("Depth", "Color").matrix)
    X = np.array([0.1, 0.2, 1.0])
    expected = [
        0.99982 * 0.1 + 0.0182547 * 0.2 + 0.00521857 + 0.0148007,
        -0.0182514 * 0.1 + 0.999833 * 0.2 - 0.000682113 + 0.000883,
    ]
    np.testing.assert_allclose(se3.apply(T_color_depth, X)[:2], expected, atol=1e-5)
    assert len(found.transforms) == 1
    assert any("inverse=forward" in n for n in found.notes)


@pytest.mark.parametrize(
    "line",
    [
        "[ 640x480  p[326.66 247.33]  f[386.7 386.3]  Brown Conrady [-0.0556 0.0655 -0.00034 0.00036 -0.0213] ]",
        "width: 640, height: 480, ppx: 326.66, ppy: 247.33, fx: 386.7, fy: 386.3, model: Brown Conrady, "
        "coeffs: [-0.0556, 0.0655, -0.00034, 0.00036, -0.0213]",
    ],
)
def test_what_python_prints(tmp_path: Path, line: str) -> None:
    camera = cb.convert(written(tmp_path, f"{line}\n", "print.txt")).cameras["camera"]
    assert (camera.model.name, camera.parameters["cx"], camera.parameters["k3"]) == ("brown", 326.66, -0.0213)


@pytest.mark.parametrize("flat", [True, False])
def test_json_of_two_streams(tmp_path: Path, flat: bool) -> None:
    rotation = R.T.ravel().tolist() if flat else R.tolist()
    extrinsics = {"depth_to_color": {"rotation": rotation, "translation": T.tolist()}}
    value = {"depth": {"intrinsics": stream(coeffs=[0] * 5)}, "color_intrinsics": stream(), "extrinsics": extrinsics}
    found = cb.convert(written(tmp_path, value))
    assert set(found.cameras) == {"depth", "color"}
    np.testing.assert_allclose(se3.inverse(found.transform("depth", "color").matrix), se3.make(R, T), atol=1e-12)
    assert any("rotation=rows" in n for n in found.notes)
    other = cb.convert(tmp_path / "realsense.json", answer=[f"rotation={'rows' if flat else 'columns'}"])
    np.testing.assert_allclose(se3.inverse(other.transform("depth", "color").matrix)[:3, :3], R.T, atol=1e-12)


@pytest.mark.parametrize("options", [{}, {"answer": ["inverse=forward", "approximate=yes"]}])
def test_the_inverse_model_both_ways(tmp_path: Path, options: dict) -> None:
    value = {"color": stream(model="Inverse Brown Conrady")}
    camera = cb.convert(written(tmp_path, value), **options).cameras["color"]
    k1, k2, p1, p2, k3 = COEFFS
    x, y = 0.3, -0.2
    r2 = x * x + y * y
    g = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    if not options:  # documented: the pixel is corrected
        ray = [x * g + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * g + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y, 1.0]
        np.testing.assert_allclose(camera.project(ray), [386.7 * x + 326.66, 386.3 * y + 247.33], atol=1e-8)
        return
    a, b = x * g, y * g  # rs2_project_point_to_pixel
    u, v = a + 2 * p1 * a * b + p2 * (r2 + 2 * a * a), b + 2 * p2 * a * b + p1 * (r2 + 2 * b * b)
    np.testing.assert_allclose(camera.project([x, y, 1.0]), [386.7 * u + 326.66, 386.3 * v + 247.33], atol=0.02)


def test_names_as_people_write_them(tmp_path: Path) -> None:
    pose = {"rotation_row_major": R.tolist(), "translation_mm": (1e3 * T).tolist()}
    value = {"serial": "12", "depth_intrinsics": stream(), "color_intrinsics": stream()}
    found = cb.convert(written(tmp_path, value | {"depth_to_color_extrinsics": pose}))
    np.testing.assert_allclose(se3.inverse(found.transform("depth", "color").matrix), se3.make(R, T), atol=1e-12)
    assert any("not used: serial" in n for n in found.notes)


def test_one_stream_alone_is_a_camera_of_named_values(tmp_path: Path) -> None:
    assert cb.convert(written(tmp_path, stream())).cameras["camera"].model.name == "brown"


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ({"color": stream(model="distortion.ftheta"), "depth": stream()}, "none of librealsense's"),
        ({"color": stream(coeffs=[1, 2]), "depth": stream()}, "coeffs holds 2"),
        ({"color": stream(width=0)}, "image size"),
        ({"color": stream(fx="wide")}, "fx"),
        ({"color": stream(), "depth_to_color": {"rotation": [1, 0], "translation": [0, 0, 0]}}, "2 numbers"),
        ({"color": stream(), "depth_to_color": {"rotation": [2.0] * 9, "translation": [0, 0, 0]}}, "rotation"),
        ({"color": stream(), "depth_to_color": {"position": [0, 0, 0]}}, "expected rotation"),
        (PRINT.replace("  Fx:         \t319.841674804688\n", ""), "no fx"),
        (PRINT.replace("0.99982          0.0182547        0.00521857", "0.99982"), "not whole"),
    ],
)
def test_bad_files(tmp_path: Path, value: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        cb.convert(written(tmp_path, value, "r.json" if isinstance(value, dict) else "r.txt"))
