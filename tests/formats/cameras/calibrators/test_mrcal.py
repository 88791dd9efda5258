"""mrcal's .cameramodel: lenses, where they are, and mrcal itself reading what is written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.peers import MRCAL

import calibrant as cb
from calibrant.cameras import camera_model
from calibrant.cameras.approximation.nearest import nearest
from calibrant.data import as_transform
from calibrant.data.result_file import write_result
from calibrant.errors import InputError
from calibrant.formats.cameras.calibrators.mrcal import FORMAT
from calibrant.formats.exchange.exchange_format import ReadOptions, WriteOptions
from calibrant.formats.exchange.read import read_any
from calibrant.geometry import se3
from calibrant.reading.notes import heard

# Of mrcal's own test/data/cam0.opencv8.cameramodel (version 1): its comments, its trailing commas.
OLD = """# generated on 2019-01-01
{
    'lens_model':  'LENSMODEL_OPENCV8',

    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....
    'intrinsics': [ 1761.181055, 1761.250444, 1965.706996, 1087.518797, -0.01266096516, 0.03590794372, -0.0002547,
        0.0005275929652, 0.01968883397, 0.01482863541, -0.0562239888, 0.0500223357,],

    # extrinsics are rt_fromref
    'extrinsics': [ 2e-2, -3e-1, -1e-2,  1., 2, -3., ],

    'imagersize': [ 4000, 2200 ]
}
"""
SIZE = (1280, 800)
F = {"fx": 640.25, "fy": 639.81, "cx": 643.17, "cy": 402.88}
TERMS = dict(
    zip(
        ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
        (-0.2, 0.05, 1e-3, -2e-3, 0.002, 0.03, 0.01, 0.003, 1e-3, -2e-4, 3e-4, 1e-4),
    )
)


def first(names: int) -> dict[str, float]:
    return dict(list(TERMS.items())[:names])


def splined() -> cb.Camera:
    kind = camera_model("splined:14x11:110deg")
    values = np.random.default_rng(3).normal(0, 0.02, len(kind.parameter_names))
    values[:4] = list(F.values())
    return cb.Camera(kind, SIZE, values)


LENSES = {
    "pinhole": cb.Camera.create("pinhole", F, image_size=SIZE),
    "brown": cb.Camera.create("brown", F | first(5), image_size=SIZE),
    "rational": cb.Camera.create("rational", F | first(8), image_size=SIZE),
    "thin_prism": cb.Camera.create("thin_prism", F | TERMS, image_size=SIZE),
    "splined": splined(),
}


def written(tmp_path: Path, camera: cb.Camera) -> Path:
    place = as_transform("world", "left", se3.exp(np.array([0.3, -0.2, 0.9, 0.1, -0.4, 2.0])))
    rig = cb.CalibrationResult("rig", "ok", cameras={"left": camera}, transforms=(place,))
    write_result(rig, tmp_path / "rig.json", force=True)
    cb.convert(tmp_path / "rig.json", tmp_path / "left.cameramodel")
    return tmp_path / "left.cameramodel"


def test_a_file_of_mrcals_own(tmp_path: Path) -> None:
    file = tmp_path / "cam0.opencv8.cameramodel"
    file.write_text(OLD)
    found = read_any(file)
    camera = found.cameras["cam0"]
    assert (camera.model.name, camera.image_size, camera.parameters["k6"]) == ("rational", (4000, 2200), 0.0500223357)
    # X_cam = R(r) X_ref + t by hand: Rodrigues' formula.
    r, t, X = np.array([2e-2, -3e-1, -1e-2]), np.array([1.0, 2, -3]), np.array([0.4, -0.2, 9.0])
    a = np.linalg.norm(r)
    k = r / a
    by_hand = X * np.cos(a) + np.cross(k, X) * np.sin(a) + k * (k @ X) * (1 - np.cos(a)) + t
    T_cam_ref = np.linalg.inv(found.transform("reference", "cam0").matrix)
    np.testing.assert_allclose(T_cam_ref[:3, :3] @ X + T_cam_ref[:3, 3], by_hand, atol=1e-12)


def test_the_inputs_that_mrcal_packs_beside_are_noted_and_bombs_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "cam0.cameramodel"
    packed = "'optimization_inputs': b'" + "P)h>@6aWAK2mk;8Apit<8ve" * 200_000 + "',\n    'imagersize'"
    file.write_text(OLD.replace("'imagersize'", packed))
    with heard() as notes:
        assert read_any(file).camera.model.name == "rational"
    assert any("not used: optimization_inputs" in note for note in notes)
    file.write_text(OLD.replace("'imagersize'", "'bomb': [" + "[]," * 1_000_000 + "],\n    'imagersize'"))
    with pytest.raises(InputError, match=r"cam0\.cameramodel: 3 MB of text, expected 2 MB at most"):
        read_any(file)


@pytest.mark.parametrize("name", list(LENSES))
def test_there_and_back(tmp_path: Path, name: str) -> None:
    found = read_any(written(tmp_path, LENSES[name]))
    np.testing.assert_allclose(found.cameras["left"].values, LENSES[name].values, rtol=1e-15)
    before = cb.read(tmp_path / "rig.json").transforms[0].matrix
    np.testing.assert_allclose(found.transforms[0].matrix, before, atol=1e-14)
    assert found.cameras["left"].model.name == LENSES[name].model.name


PROJECT = """
import mrcal, tempfile
def answer(text, points):
    with tempfile.NamedTemporaryFile("wb", suffix=".cameramodel") as file:
        file.write(text.tobytes())
        file.flush()
        model = mrcal.cameramodel(file.name)
    at = mrcal.transform_point_rt(getattr(model, "extrinsics_rt_fromref", None)(), points)
    return {"pixels": mrcal.project(at, *model.intrinsics()), "size": np.array(model.imagersize())}
"""


@pytest.mark.parametrize("name", list(LENSES))
def test_mrcal_reads_what_is_written_and_projects_the_same(tmp_path: Path, name: str) -> None:
    file, camera = written(tmp_path, LENSES[name]), LENSES[name]
    T_world_left = cb.read(tmp_path / "rig.json").transforms[0].matrix
    uv = np.random.default_rng(0).uniform((100, 80), (1179, 719) if name == "splined" else (1279, 799), (10_000, 2))
    rays = camera.unproject(uv)
    assert np.isfinite(rays).all()
    world = 3 * rays @ T_world_left[:3, :3].T + T_world_left[:3, 3]
    text = np.frombuffer(file.read_bytes(), dtype=np.uint8)
    told = MRCAL.arrays(PROJECT, text=text, points=np.ascontiguousarray(world))
    assert tuple(told["size"]) == SIZE
    assert np.abs(told["pixels"] - camera.project(rays)).max() < 1e-6


def test_a_stereographic_lens_is_the_unified_one(tmp_path: Path) -> None:
    file = tmp_path / "wide.cameramodel"
    file.write_text(
        "{'lensmodel': 'LENSMODEL_STEREOGRAPHIC', 'intrinsics': [300., 301., 640, 400], 'imagersize': [1280, 800]}"
    )
    theta = 1.9
    at = read_any(file).camera.project(np.array([np.sin(theta), 0, np.cos(theta)]))
    np.testing.assert_allclose(at, [640 + 300 * 2 * np.tan(theta / 2), 400], atol=1e-9)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (OLD.replace("OPENCV8", "CAHVOR"), "LENSMODEL_CAHVOR, which no model here can say.*mrcal-convert-lensmodel"),
        (OLD.replace("OPENCV8", "OPENCV5"), "12 numbers, a LENSMODEL_OPENCV5 has 9"),
        (OLD[:300], "not a dictionary in Python's words"),
        (OLD.replace("1., 2, -3., ]", "1., 2 ]"), "extrinsics holds 5 numbers"),
        (OLD.replace("4000, 2200", "4000"), "imagersize holds 1 numbers"),
        (OLD.replace("'imagersize'", "'unknown'"), "holds no image size"),
        (OLD.replace("1., 2, -3.,", "1e999, 2, -3.,"), "extrinsics holds numbers that are not finite"),
        (OLD.replace("OPENCV8", "SPLINED_STEREOGRAPHIC_order=2_Nx=16_Ny=12_fov_x_deg=120"), "order 2"),
        ("{'lensmodel': 'LENSMODEL_PINHOLE', 'x': " + "[" * 5000 + "]" * 5000 + "}", "not a dictionary"),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "bad.cameramodel"
    file.write_text(text)
    with pytest.raises(InputError, match=rf"bad\.cameramodel: .*{words}"):
        read_any(file, ReadOptions())


def test_a_fisheye_is_near_a_spline_that_can_be_written() -> None:
    wide = cb.Camera.create("kannala_brandt", F | {"fx": 400.0, "fy": 400.0, "k1": 0.02, "k2": -0.004}, image_size=SIZE)
    assert "splined" in FORMAT.models
    found = nearest(wide, "splined")
    assert found.camera.model.name.startswith("splined:16x12:")
    assert (found.outside, found.most_px < 0.01) == (0, True)
    text = FORMAT.write(cb.CalibrationResult("cameras", "ok", cameras={"wide": found.camera}), WriteOptions())
    assert b"LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=16_Ny=12_fov_x_deg=" in text
