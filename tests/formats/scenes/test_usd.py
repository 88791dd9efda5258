"""USD scenes: written by hand's arithmetic, read through usd-core, whose own frustum projects to the same pixels."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calibrant as cb
from calibrant.data.results import as_transform
from calibrant.errors import InputError
from calibrant.formats.exchange.exchange_format import read_cameras
from calibrant.geometry import se3, so3

LENS = {"fx": 610.25, "fy": 605.5, "cx": 300.75, "cy": 260.0}
T_WORLD_LEFT = se3.make(so3.exp([0.3, -0.4, 0.5]), [0.5, 0.1, 0.2])
T_WORLD_RIGHT = se3.make(so3.exp([2.1, 0.2, -0.3]), [-0.5, 0.3, 1.2])
POINTS = np.array([[0.0, 0.0, 1.0], [0.2, -0.1, 0.8], [-0.3, 0.2, 1.5]])
NESTED = """#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Y"
)
def Xform "Rig"
{
    double3 xformOp:translate = (10, 20, 30)
    float3 xformOp:rotateXYZ = (10, 20, 30)
    float3 xformOp:scale = (2, 2, 2)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:scale"]
    def Camera "Cam"
    {
        float focalLength = 24
        float horizontalAperture = 20.955
        float verticalAperture = 15.71625
        float horizontalApertureOffset = 2
        float verticalApertureOffset = 1
        double3 xformOp:translate = (1, 2, 3)
        quatf xformOp:orient = (0.5, 0.5, -0.5, 0.5)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]
    }
}
"""


def rig() -> cb.CalibrationResult:
    camera = cb.Camera.create("pinhole", LENS, image_size=(640, 480))
    places = (as_transform("world", "left", T_WORLD_LEFT), as_transform("world", "2nd eye", T_WORLD_RIGHT))
    return read_cameras({"left": camera, "2nd eye": camera}, transforms=places)


def written(folder: Path) -> Path:
    file = folder / "rig.usda"
    cb.convert(rig().write(folder / "rig.json"), file)
    return file


def test_what_is_written_projects_by_usds_equations(tmp_path: Path) -> None:
    text = written(tmp_path).read_text()
    block = text[text.index('def Camera "left"') :]
    said = {key: float(value) for key, value in re.findall(r"float (\w+) = (\S+)", block)[:5]}
    rows = np.array(
        re.findall(r"-?[\d.]+(?:e-?\d+)?", block[block.index("transform = (") : block.index("uniform")]), float
    )
    X = se3.apply(T_WORLD_LEFT, POINTS)
    right, up, back, _ = (np.c_[X, np.ones(3)] @ np.linalg.inv(rows.reshape(4, 4))).T  # a point is a row
    x = right / -back * said["focalLength"] - said["horizontalApertureOffset"]
    y = up / -back * said["focalLength"] - said["verticalApertureOffset"]
    u = (0.5 + x / said["horizontalAperture"]) * 640 - 0.5
    v = (0.5 - y / said["verticalAperture"]) * 480 - 0.5
    np.testing.assert_allclose(np.stack([u, v], axis=-1), rig().cameras["left"].project(POINTS), atol=1e-9)
    assert ("metersPerUnit = 1" in text, 'displayName = "2nd eye"' in text, 'def Camera "_2nd_eye"' in text) == (
        True,
    ) * 3


def pixels_of_usd(file: Path, path: str, X_scene: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Through the view and projection matrices of usd-core's own frustum."""
    pxr = pytest.importorskip("pxr", reason="usd-core is in the extra `usd`")
    from pxr import Usd, UsdGeom

    assert pxr
    stage: Any = Usd.Stage.Open(str(file))
    frustum = UsdGeom.Camera(stage.GetPrimAtPath(path)).GetCamera(Usd.TimeCode.Default()).frustum
    matrix = np.array(frustum.ComputeViewMatrix()) @ np.array(frustum.ComputeProjectionMatrix())
    clip = np.c_[X_scene, np.ones(len(X_scene))] @ matrix
    ndc = clip[:, :2] / clip[:, 3:]
    return np.stack([(ndc[:, 0] + 1) / 2 * size[0] - 0.5, (1 - ndc[:, 1]) / 2 * size[1] - 0.5], axis=-1)


@pytest.mark.parametrize("suffix", ["usda", "usdc", "usdz"])
def test_there_and_back_through_usd_core(tmp_path: Path, suffix: str) -> None:
    pytest.importorskip("pxr", reason="usd-core is in the extra `usd`")
    from pxr import Usd, UsdUtils

    file = tmp_path / f"again.{suffix}"
    if suffix == "usdz":
        UsdUtils.CreateNewUsdzPackage(str(written(tmp_path)), str(file))
    else:
        Usd.Stage.Open(str(written(tmp_path))).Export(str(file))
    found = cb.convert(file)
    for name, T in (("left", T_WORLD_LEFT), ("2nd eye", T_WORLD_RIGHT)):
        np.testing.assert_allclose(found.transform("world", name).matrix, T, atol=1e-12)
        assert found.cameras[name].parameters == pytest.approx(LENS, rel=1e-6)  # floats of 32 bits
        assert found.cameras[name].image_size == (640, 480)
    seen = pixels_of_usd(file, "/World/left", se3.apply(T_WORLD_LEFT, POINTS), (640, 480))
    np.testing.assert_allclose(seen, found.cameras["left"].project(POINTS), atol=1e-3)


def test_places_units_scales_and_offsets_are_those_of_usds_frustum(tmp_path: Path) -> None:
    pytest.importorskip("pxr", reason="usd-core is in the extra `usd`")
    file = tmp_path / "nested.usda"
    file.write_text(NESTED)
    found = cb.convert(file, image_size="640x480")
    X = se3.apply(found.transform("world", "Cam").matrix, POINTS)
    seen = pixels_of_usd(file, "/Rig/Cam", X / 0.01, (640, 480))
    np.testing.assert_allclose(found.camera.project(POINTS), seen, atol=1e-3)
    assert any("scales by 2, 2, 2" in note for note in found.notes)
    assert any("y is up" in note for note in found.notes)


def test_what_the_scene_leaves_open_is_asked(tmp_path: Path) -> None:
    pytest.importorskip("pxr", reason="usd-core is in the extra `usd`")
    file = tmp_path / "nested.usda"
    file.write_text(NESTED)
    with pytest.raises(InputError, match="Cam: the file holds no image size"):
        cb.convert(file)
    with pytest.raises(InputError, match=r"apertures of 20\.955 x 15\.716. for images of 640x360 px"):
        cb.convert(file, image_size="640x360")
    wide = cb.convert(file, image_size="640x360", answer=["aperture=horizontal"]).camera.parameters
    assert (wide["fx"], wide["fy"]) == pytest.approx((24 / 20.955 * 640,) * 2, rel=1e-6)
    file.write_text(NESTED.replace("focalLength = 24", "focalLength = 0"))
    with pytest.raises(InputError, match="expected lengths above 0"):
        cb.convert(file, image_size="640x480")
    file.write_text(NESTED[:300])
    with pytest.raises(InputError, match="usd-core does not read it"):
        cb.convert(file, image_size="640x480")


def test_without_usd_core_it_is_said_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(InputError, match=r"pip install \"calibrant\[usd\]\""):
        cb.convert(written(tmp_path))
