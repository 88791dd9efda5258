"""calib.io's nested JSON: models, transforms, unit and direction."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.formats.cameras.calibrators.rigs import assert_same, graph, rig, through

from calibrant.errors import InputError
from calibrant.formats.exchange.exchange_format import ReadOptions
from calibrant.formats.exchange.read import read_any
from calibrant.opencv import cv2
from calibrant.reading.notes import heard

TERMS = {"k1": -0.2, "k2": 0.05, "p1": 1e-3, "p2": -2e-3, "k3": 0.002, "k4": 0.03, "k5": 0.01, "k6": 0.003}
PRISM = {"s1": 1e-3, "s2": -2e-4, "s3": 3e-4, "s4": 1e-4, "tauX": 0.02, "tauY": -0.01}


def model(word: str, terms: dict[str, float]) -> dict[str, Any]:
    values = {"f": 800.0, "ar": 1.002, "cx": 641.0, "cy": 398.0} | terms
    return {
        "polymorphic_id": 2147483649,
        "polymorphic_name": f"libCalib::CameraModel{word}",
        "ptr_wrapper": {
            "valid": 1,
            "data": {
                "CameraModelCRT": {"CameraModelBase": {"imageSize": {"width": 1280, "height": 800}}},
                "parameters": {name: {"val": value, "state": 0} for name, value in values.items()},
            },
        },
    }


def calibration(word: str = "OpenCV", terms: dict[str, float] | None = None) -> dict[str, Any]:
    places = (
        ({"rx": 0.0, "ry": 0.0, "rz": 0.0}, {"x": 0.0, "y": 0.0, "z": 0.0}),
        (
            {"rx": 0.02, "ry": -0.3, "rz": 0.01},
            {"x": -120.0, "y": 2.0, "z": 3.5},
        ),
    )
    cameras = [
        {
            "model": model(word, TERMS | PRISM if terms is None else terms),
            "transform": {"rotation": r, "translation": t},
        }
        for r, t in places
    ]
    return {"Calibration": {"cameras": cameras, "poses": []}}


def put(tmp_path: Path, data: Any) -> Path:
    file = tmp_path / "calib.json"
    file.write_text(json.dumps(data))
    return file


def test_a_point_lands_where_opencv_puts_it(tmp_path: Path) -> None:
    file = put(tmp_path, calibration())
    with heard() as notes:
        found = read_any(file, ReadOptions(unit_m=1e-3))
    assert any("X_camera = R X_rig + t" in note for note in notes)
    X = np.array([0.2, -0.1, 1.5])
    K = np.array([[800.0, 0, 641], [0, 801.6, 398], [0, 0, 1]])
    D = np.array([*TERMS.values(), *PRISM.values()])
    by_opencv = cv2.projectPoints(X[None], np.array([0.02, -0.3, 0.01]), np.array([-0.12, 2e-3, 3.5e-3]), K, D)[0]
    T = graph(found).T("camera1", "rig")
    at = found.cameras["camera1"].project(T[:3, :3] @ X + T[:3, 3])
    np.testing.assert_allclose(at, by_opencv.ravel(), atol=1e-9)
    other = read_any(file, ReadOptions(unit_m=1e-3, answers={"direction": "camera-to-world"}))
    np.testing.assert_allclose(other.transform("rig", "camera1").matrix, T, atol=1e-12)


def test_the_unit_is_asked_where_places_matter(tmp_path: Path) -> None:
    file = put(tmp_path, calibration())
    with pytest.raises(InputError, match=r"calib\.json: .*do not say their unit.*--unit"):
        read_any(file)
    assert len(read_any(file, ReadOptions(places=False)).cameras) == 2


@pytest.mark.parametrize(
    ("word", "terms", "ours"),
    [
        ("OpenCV", {"k1": -0.1, "k2": 0.0}, "brown"),
        ("OpenCVFisheye", {"k1": 0.01, "k2": -0.002, "k3": 0.0, "k4": 0.0}, "kannala_brandt"),
        ("EnhancedUnified", {"alpha": 0.6, "beta": 1.1}, "extended_unified"),
        ("Matlab", {"k1": -0.1, "k2": 0.01, "k3": 0.002, "p1": 1e-3, "p2": 0.0, "skew": 0.0}, "brown"),
        ("Matlab", {"k1": 0.0, "k2": 0.0, "k3": 0.0, "p1": 0.0, "p2": 0.0, "skew": 0.4}, "pinhole_skew"),
    ],
)
def test_its_models(tmp_path: Path, word: str, terms: dict[str, float], ours: str) -> None:
    camera = read_any(put(tmp_path, calibration(word, terms)), ReadOptions(places=False)).cameras["camera0"]
    assert camera.model.name == ours
    kept = {k: v for k, v in terms.items() if k in camera.parameters}
    assert {k: camera.parameters[k] for k in kept} == kept
    assert camera.parameters["fy"] == 800 * 1.002


@pytest.mark.parametrize("models", [("pinhole", "brown", "rational"), ("kannala_brandt", "extended_unified")])
def test_there_and_back(tmp_path: Path, models: tuple[str, ...]) -> None:
    before = rig(*models, imu=False)
    target = tmp_path / "calib.json"
    with pytest.raises(InputError, match="do not say their unit"):
        through(before, target, "calib-io")
    assert_same(read_any(target, ReadOptions(unit_m=1.0)), before)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda c: c["model"].update(polymorphic_name="libCalib::CameraModelNew"),
            "the model is 'New', expected one of",
        ),
        (lambda c: c["model"].pop("ptr_wrapper"), "camera1: expected model with polymorphic_name"),
        (lambda c: c["model"]["ptr_wrapper"]["data"]["parameters"].update(q=7), "expected model with"),
        (lambda c: c["model"]["ptr_wrapper"]["data"]["parameters"].update(q={"val": 7}), "q is no parameter of OpenCV"),
        (lambda c: c["model"]["ptr_wrapper"]["data"].pop("CameraModelCRT"), "holds no image size"),
        (lambda c: c["transform"].pop("rotation"), "expected rotation and translation"),
        (lambda c: c["transform"]["translation"].update(x="far"), "x is 'far', expected numbers"),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path: Path, change: Any, words: str) -> None:
    data = calibration()
    change(data["Calibration"]["cameras"][1])
    with pytest.raises(InputError, match=rf"calib\.json: .*{words}"):
        read_any(put(tmp_path, data), ReadOptions(unit_m=1.0))
