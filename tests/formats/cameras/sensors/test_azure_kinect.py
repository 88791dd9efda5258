"""Azure Kinect's calibration: what the SDK gives for its modes, the two kinds of tangential terms, places in metres."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calibrant as cb
from calibrant.errors import InputError
from calibrant.geometry import se3, so3

DEPTH = [
    *(0.5122697949409485, 0.49451231956481934, 0.4921168386936188, 0.4921667277812958, 3.1305770874023438),
    *(2.324939012527466, 0.1304156482219696, 3.458651542663574, 3.350114583969116, 0.6629416346549988, 0.0, 0.0),
    *(-5.11557373101823e-05, 8.132171933539212e-05),
]
COLOR = [
    *(0.4967627227306366, 0.5108628273010254, 0.470907062292099, 0.6274453997612, 0.7227460145950317),
    *(-2.8855903148651123, 1.6327226161956787, 0.6021990180015564, -2.7196261882781982, 1.565053105354309, 0.0, 0.0),
    *(-0.0001431911950930953, 0.0007828465895727277),
]
"""Of one device, as the SDK printed its modes: 640x576 with cx 332.064270, fx 503.927643; 1920x1080 with …"""
R, T = so3.exp([0.1, 0.002, 0.001]), np.array([-0.032, -0.002, 0.004])


def camera(purpose: str, values: list[float], size: tuple[int, int], **more: Any) -> dict[str, Any]:
    return {
        "Intrinsics": {
            "ModelParameterCount": 14,
            "ModelParameters": values,
            "ModelType": "CALIBRATION_LensDistortionModelBrownConrady",
        },
        "Purpose": f"CALIBRATION_CameraPurpose{purpose}",
        "MetricRadius": 1.74,
        "Rt": {"Rotation": np.eye(3).ravel().tolist(), "Translation": [0, 0, 0]},
        "SensorWidth": size[0],
        "SensorHeight": size[1],
    } | more


def data() -> dict[str, Any]:
    places = {"Rt": {"Rotation": R.ravel().tolist(), "Translation": T.tolist()}, "MetricRadius": 0}
    both = [camera("Depth", DEPTH, (1024, 1024)), camera("PhotoVideo", COLOR, (4096, 3072), **places)]
    return {"CalibrationInformation": {"Cameras": both, "InertialSensors": []}}


def written(folder: Path, value: Any) -> Path:
    (folder / "calibration.json").write_text(json.dumps(value))
    return folder / "calibration.json"


@pytest.mark.parametrize(
    ("name", "size", "expected"),
    [
        ("depth", "640x576", {"cx": 332.064270, "cy": 325.880615, "fx": 503.927643, "fy": 503.978729}),
        ("color", "1920x1080", {"cx": 953.284424, "cy": 555.142456, "fx": 904.141541, "fy": 903.521362}),
    ],
)
def test_modes_are_the_sdks(tmp_path: Path, name: str, size: str, expected: dict[str, float]) -> None:
    found = cb.convert(written(tmp_path, data()), camera=name, image_size=size).cameras[name]
    assert {key: found.parameters[key] for key in expected} == pytest.approx(expected, abs=1e-4)
    assert found.parameters["p1"] == {"depth": DEPTH, "color": COLOR}[name][13]
    assert found.image_size == tuple(map(int, size.split("x")))


def test_places_and_notes(tmp_path: Path) -> None:
    found = cb.convert(written(tmp_path, data()))
    X = np.array([0.2, 0.1, 1.0])
    T_color_depth = se3.inverse(found.transform("depth", "color").matrix)
    np.testing.assert_allclose(se3.apply(T_color_depth, X), R @ X + T, atol=1e-12)
    assert found.cameras["color"].image_size == (4096, 3072)
    assert any("MetricRadius" in n for n in found.notes)


def test_tangential_terms_that_count_once(tmp_path: Path) -> None:
    value = data()
    lens = value["CalibrationInformation"]["Cameras"][1]["Intrinsics"]
    lens["ModelType"] = "CALIBRATION_LensDistortionModelRational6KT"
    lens["ModelParameters"] = [*COLOR[:4], 0, 0, 0, 0, 0, 0, 0, 0, 0.002, 0.001]
    file = written(tmp_path, value)
    with pytest.raises(InputError, match=r"px RMS.*approximate=yes"):
        cb.convert(file)
    found = cb.convert(file, answer=["approximate=yes"]).cameras["color"]
    x, y = 0.1, 0.2
    r2 = x * x + y * y
    u = x + (r2 + 2 * x * x) * 0.002 + x * y * 0.001  # intrinsic_transformation.c: without the factor 2
    v = y + (r2 + 2 * y * y) * 0.001 + x * y * 0.002
    expected = np.array([COLOR[2] * u + COLOR[0], COLOR[3] * v + COLOR[1]]) * [4096, 3072] - 0.5
    assert np.linalg.norm(found.project([x, y, 1.0]) - expected) < 1.0
    lens["ModelParameters"][12:] = [0.0, 0.0]
    assert cb.convert(written(tmp_path, value)).cameras["color"].parameters["p1"] == 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"SensorWidth": 0}, "image size"),
        ({"Intrinsics": {"ModelType": "CALIBRATION_LensDistortionModelTheta"}}, "ModelType"),
        ({"Rt": {"Rotation": [1, 2], "Translation": [0, 0, 0]}}, "Rt holds 2"),
        ({"Rt": {"Rotation": [2, 0, 0, 0, 2, 0, 0, 0, 2], "Translation": [0, 0, 0]}}, "Rt"),
        ({"Purpose": "CALIBRATION_CameraPurposePhotoVideo"}, "two cameras"),
        ({"Intrinsics": 3}, "Intrinsics|no camera"),
    ],
)
def test_bad_files(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    value = copy.deepcopy(data())
    value["CalibrationInformation"]["Cameras"][0] |= change
    with pytest.raises(InputError, match=words):
        cb.convert(written(tmp_path, value))


def test_a_size_that_no_mode_has(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="color 1920x1080"):
        cb.convert(written(tmp_path, data()), image_size="100x100")
