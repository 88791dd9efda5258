"""3D-EasyCalib's projects: its manual's equations, both counts of i, any camera as the world, what cannot be."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import calibrant as cb
from calibrant.errors import InputError
from calibrant.formats.documents.opencv_storage import Storable, json_text, yaml_text
from calibrant.geometry import se3, so3

K = (
    np.array([[1200.0, 0, 640.5], [0, 1210.0, 511.25], [0, 0, 1]]),
    np.array([[1300.0, 0, 635.5], [0, 1310.0, 506.25], [0, 0, 1]]),
)
KC = np.array([[-0.21, 0.1, 1e-4, -2e-4, 0.03]])
R = so3.exp([0.1, -0.4, 0.05])
T_MM = np.array([[-120.0], [3.0], [4.0]])
SIZE = "1280x1024"


def project(first: int = 0, *, world: str = "Left", swapped: bool = False) -> dict[str, Storable]:
    """Two cameras, the first of them the world."""
    poses = [(np.eye(3), np.zeros((3, 1))), (R, T_MM)]
    values: dict[str, Storable] = {"ISODate": "2019-08-01", "Sensors": ["Left", "Right"], "World": world}
    for k, (rotation, translation) in enumerate(poses[::-1] if swapped else poses):
        i = first + k
        values |= {f"K_{i}": K[k], f"kc_{i}": KC, f"R_{i}": rotation, f"T_{i}": translation}
    return values


def written(folder: Path, values: dict[str, Storable], name: str = "project.yml") -> Path:
    file = folder / name
    file.write_text(json_text(values) if name.endswith(".json") else yaml_text(values))
    return file


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("name", ["project.yml", "project.json"])
def test_a_point_lands_where_the_manual_says(tmp_path: Path, first: int, name: str) -> None:
    found = cb.convert(written(tmp_path, project(first), name), image_size=SIZE)
    X_world = np.array([0.05, -0.02, 1.0])
    x, y, z = R @ (1e3 * X_world) + T_MM[:, 0]  # 4.3: X_C = R X + t, millimetres
    x, y = x / z, y / z
    k1, k2, p1, p2, k3 = KC[0]
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    expected = (K[1] @ [u, v, 1])[:2]
    T_right_left = se3.inverse(found.transform("Left", "Right").matrix)
    np.testing.assert_allclose(found.cameras["Right"].project(se3.apply(T_right_left, X_world)), expected, atol=1e-9)


@pytest.mark.parametrize("index", ["0", "1"])
@pytest.mark.parametrize("form", ["easycalib", "easycalib-json"])
def test_the_world_changed_and_saved_keeps_every_number(tmp_path: Path, index: str, form: str) -> None:
    before = cb.convert(written(tmp_path, project()))
    file = tmp_path / ("moved.json" if form.endswith("json") else "moved.yml")
    cb.convert(tmp_path / "project.yml", file, to=form, choose=["world=Right", f"index={index}"])
    after = cb.convert(file)
    T = after.transform("Right", "Left").matrix
    np.testing.assert_allclose(T, se3.inverse(before.transform("Left", "Right").matrix), atol=1e-12)
    for name in ("Left", "Right"):
        assert after.cameras[name].parameters == pytest.approx(before.cameras[name].parameters, rel=1e-12)
        assert after.cameras[name].image_size == before.cameras[name].image_size
    text = file.read_text()
    assert (f"K_{int(index) + 1}" in text, "World" in text) == (True, True)


def test_the_other_direction_is_read_when_said(tmp_path: Path) -> None:
    found = cb.convert(written(tmp_path, project()), answer=["direction=camera-to-world"])
    np.testing.assert_allclose(found.transform("Left", "Right").matrix[:3, 3], 1e-3 * T_MM[:, 0], atol=1e-15)


def test_sizes_that_the_file_does_not_hold_are_said(tmp_path: Path) -> None:
    found = cb.convert(written(tmp_path, project()))
    assert found.cameras["Left"].image_size == (1282, 1024)
    assert any("no image size in the project" in note for note in found.notes)
    asked = cb.convert(tmp_path / "project.yml", image_size=SIZE)
    assert asked.cameras["Left"].image_size == (1280, 1024)
    assert not any("no image size" in note for note in asked.notes)


def test_a_sensor_without_a_lens_is_a_frame(tmp_path: Path) -> None:
    values = project()
    del values["K_1"], values["kc_1"]
    found = cb.convert(written(tmp_path, values))
    assert list(found.cameras) == ["Left"]
    assert [(t.parent, t.child) for t in found.transforms] == [("Left", "Right")]
    cb.convert(tmp_path / "project.yml", tmp_path / "again.yml", to="easycalib")
    again = cb.convert(tmp_path / "again.yml")
    np.testing.assert_allclose(again.transforms[0].matrix, found.transforms[0].matrix, atol=1e-15)


def test_keys_that_fit_both_counts_are_told_by_the_world_or_asked(tmp_path: Path) -> None:
    """Three sensors of which one has numbers: i may count from 0 or from 1."""
    values: dict[str, Storable] = {"Sensors": ["A", "B", "C"], "World": "B", "K_1": K[0], "kc_1": KC}
    at_itself = values | {"R_1": np.eye(3), "T_1": np.zeros((3, 1))}
    assert list(cb.convert(written(tmp_path, at_itself)).cameras) == ["B"]
    with pytest.raises(InputError, match=r"counted from 0 and from 1: say .*answer"):
        cb.convert(written(tmp_path, values))
    assert list(cb.convert(tmp_path / "project.yml", answer=["index=1"]).cameras) == ["A"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"World": "Right"}, "its own R_1, T_1 are not the identity"),
        ({"Sensors": ["Left"]}, "1 sensors, but the numbers of their keys do not fit"),
        ({"Sensors": ["Left", "Left"]}, "two sensors are called 'Left'"),
        ({"Sensors": []}, "expected a list of names"),
        ({"R_1": 2 * np.eye(3)}, "no rotation"),
        ({"T_1": np.zeros((2, 1))}, "no rotation"),
        ({"K_1": np.zeros((2, 2))}, "K_1 holds 4 numbers"),
        ({"K_1": "wide"}, "K_1"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, changes: dict[str, Storable], message: str) -> None:
    with pytest.raises(InputError, match=message):
        cb.convert(written(tmp_path, project() | changes))


def test_its_json_is_opencvs(tmp_path: Path) -> None:
    file = written(tmp_path, project(), "project.json")
    assert json.loads(file.read_text())["K_0"]["type_id"] == "opencv-matrix"
