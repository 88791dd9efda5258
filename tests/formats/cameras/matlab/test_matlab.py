"""MATLAB's structs and Bouguet's files: pixels from 1 and from 0, matrices that lie transposed, files that lie."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat

import calibrant as cb
from calibrant.errors import InputError
from calibrant.formats.cameras.matlab.mat_file import variables
from calibrant.geometry import se3, so3

K = np.array([[1200.0, 0, 641.5], [0, 1210.0, 360.25], [0, 0, 1]])
"""In MATLAB's pixels, the first of which is 1."""
KC = (-0.2, 0.1, 1e-3, -2e-3, 0.05)
R = so3.exp([0.02, -0.3, 0.01])
T_MM = np.array([-120.0, 2.0, 5.0])
BOARD = np.array([[0.1, -0.2, 0.3], [0.5, 0.1, -1.0]])
BOARD_MM = np.array([[10.0, 20.0, 800.0], [-30.0, 5.0, 900.0]])
X = np.array([0.05, -0.03, 0.0])


def camera(**more: Any) -> dict[str, Any]:
    k1, k2, p1, p2, k3 = KC
    return {
        "RadialDistortion": np.array([[k1, k2, k3]]),
        "TangentialDistortion": np.array([[p1, p2]]),
        "ImageSize": np.array([[720.0, 1280.0]]),
        "WorldUnits": "millimeters",
        "IntrinsicMatrix": K.T,
        "RotationVectors": BOARD,
        "TranslationVectors": BOARD_MM,
        "ReprojectionErrors": np.ones((2, 2)),
    } | more


def pair(**more: Any) -> dict[str, Any]:
    other = se3.make(R, T_MM) @ se3.make(so3.exp(BOARD), BOARD_MM)
    second = camera(RotationVectors=so3.log(other[:, :3, :3]), TranslationVectors=other[:, :3, 3])
    return {
        "CameraParameters1": camera(),
        "CameraParameters2": second,
        "RotationOfCamera2": R.T,
        "TranslationOfCamera2": T_MM[None],
    } | more


def saved(folder: Path, name: str = "camera.mat", *, packed: bool = False, **values: Any) -> Path:
    savemat(folder / name, values, do_compression=packed)
    return folder / name


def pixel(p: np.ndarray) -> np.ndarray:
    """MATLAB's pixel of a point in the camera's frame, by its documentation's equations."""
    k1, k2, p1, p2, k3 = KC
    x, y = p[0] / p[2], p[1] / p[2]
    r2 = x * x + y * y
    g = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * g + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * g + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return (K @ [u, v, 1])[:2]


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("more", [{}, {"IntrinsicMatrix": np.zeros((0, 0)), "K": K}])
def test_a_point_lands_on_matlabs_pixel(tmp_path: Path, packed: bool, more: dict[str, Any]) -> None:
    given = {name: v for name, v in camera(**more).items() if np.size(v)}
    found = cb.convert(saved(tmp_path, packed=packed, cameraParams=given))
    view = found.views[1]
    in_camera = so3.exp(BOARD[1]) @ X + 1e-3 * BOARD_MM[1]
    np.testing.assert_allclose(se3.apply(view.T_camera_target, X), in_camera, atol=1e-12)
    uv = found.cameras["cameraParams"].project(in_camera)
    np.testing.assert_allclose(uv + 1, pixel(in_camera), atol=1e-9)
    assert found.cameras["cameraParams"].image_size == (1280, 720)


def test_intrinsics_alone_and_within_a_session(tmp_path: Path) -> None:
    lens = {"FocalLength": K[[0, 1], [0, 1]], "PrincipalPoint": K[:2, 2], "RadialDistortion": np.array([-0.1, 0.0])}
    size = {"ImageSize": np.array([720.0, 1280.0]), "Skew": 0.0, "TangentialDistortion": np.zeros(2)}
    found = cb.convert(saved(tmp_path, session={"intrinsics": {**lens, **size}, "n": 3.0}))
    assert found.cameras["intrinsics"].parameters["cx"] == pytest.approx(640.5)


@pytest.mark.parametrize("turned", [False, True])
def test_a_pair(tmp_path: Path, turned: bool) -> None:
    """Some save R, some R^T: the boards tell."""
    file = saved(tmp_path, stereoParams=pair(**({"RotationOfCamera2": R} if turned else {})))
    found = cb.convert(file)
    T = se3.inverse(found.transform("camera1", "camera2").matrix)
    np.testing.assert_allclose(T, se3.make(R, 1e-3 * T_MM), atol=1e-9)
    assert len(found.views) == 4


def test_a_pair_of_newer_versions(tmp_path: Path) -> None:
    value = {name: v for name, v in pair().items() if "Camera2" not in name}
    file = saved(tmp_path, s=value | {"PoseCamera2": {"A": se3.make(R, T_MM)}})
    T = se3.inverse(cb.convert(file).transform("camera1", "camera2").matrix)
    np.testing.assert_allclose(T, se3.make(R, 1e-3 * T_MM), atol=1e-9)


@pytest.mark.parametrize("form", ["matlab", "bouguet"])
def test_round_trip_of_a_pair(tmp_path: Path, form: str) -> None:
    before = cb.convert(saved(tmp_path, stereoParams=pair()))
    cb.convert(tmp_path / "camera.mat", tmp_path / "again.mat", to=form)
    after = cb.convert(tmp_path / "again.mat")
    names = list(after.cameras)
    for old, new in zip(before.cameras, names):
        assert after.cameras[new].parameters == pytest.approx(before.cameras[old].parameters, abs=1e-12)
    place = before.transform("camera1", "camera2").matrix
    np.testing.assert_allclose(after.transform(*names).matrix, place, atol=1e-12)
    told = loadmat(tmp_path / "again.mat", simplify_cells=True)
    t = told["T"] if form == "bouguet" else told["stereoParams"]["TranslationOfCamera2"]
    np.testing.assert_allclose(t, T_MM, atol=1e-9)


@pytest.mark.parametrize("form", ["matlab", "bouguet"])
def test_round_trip_of_a_camera_with_its_boards(tmp_path: Path, form: str) -> None:
    before = cb.convert(saved(tmp_path, cameraParams=camera()))
    cb.convert(tmp_path / "camera.mat", tmp_path / "again.mat", to=form)
    after = cb.convert(tmp_path / "again.mat")
    assert after.camera.parameters == pytest.approx(before.camera.parameters, abs=1e-12)
    for a, b in zip(before.views, after.views, strict=True):
        np.testing.assert_allclose(a.T_camera_target, b.T_camera_target, atol=1e-12)


BOUGUET: dict[str, Any] = {
    "fc": np.array([[657.4], [657.8]]),
    "cc": np.array([[302.5], [243.25]]),
    "kc": np.array([[-0.25], [0.12], [-2e-4], [3e-5], [0.0]]),
    "alpha_c": 0.0,
    "nx": 640.0,
    "ny": 480.0,
    "fc_error": np.array([[0.3], [0.6]]),
    "cc_error": np.array([[0.9], [0.3]]),
    "kc_error": np.array([[0.003], [0.006], [3e-4], [3e-4], [0.0]]),
    "omc_1": BOARD[0][:, None],
    "Tc_1": BOARD_MM[0][:, None],
    "omc_2": np.full((3, 1), np.nan),
    "Tc_2": np.full((3, 1), np.nan),
}


def test_bouguets_camera(tmp_path: Path) -> None:
    found = cb.convert(saved(tmp_path, "Calib_Results.mat", **BOUGUET))
    p = found.camera.parameters
    assert (p["cx"], p["cy"], p["fx"], p["k1"], p["p1"]) == (302.5, 243.25, 657.4, -0.25, -2e-4)
    assert found.camera.sigma["fx"] == pytest.approx(0.1)  # errors there are three sigma
    np.testing.assert_allclose(found.views[0].T_camera_target[:3, 3], 1e-3 * BOARD_MM[0])
    assert len(found.views) == 1
    assert any("mm" in n for n in found.notes)


def test_bouguets_pair_with_its_boards(tmp_path: Path) -> None:
    sides = {f"{n}_{side}": BOUGUET[n] for n in ("fc", "cc", "kc", "alpha_c") for side in ("left", "right")}
    sigma = {"fc_left_error": BOUGUET["fc_error"], "cc_left_error": BOUGUET["cc_error"]}
    boards = {"omc_left_3": BOARD[0][:, None], "Tc_left_3": BOARD_MM[0][:, None], "kc_left_error": BOUGUET["kc_error"]}
    pose = {"om": so3.log(R)[:, None], "T": T_MM[:, None], "R": R, "nx": 640.0, "ny": 480.0, "dX": 30.0}
    found = cb.convert(saved(tmp_path, **sides, **sigma, **boards, **pose))
    T = se3.inverse(found.transform("left", "right").matrix)
    np.testing.assert_allclose(T, se3.make(R, 1e-3 * T_MM), atol=1e-12)
    assert [(v.id, v.camera) for v in found.views] == [("3", "left")]
    assert found.cameras["left"].sigma["fx"] == pytest.approx(0.1)
    assert any("not used: dX" in n for n in found.notes)


def test_bouguets_script(tmp_path: Path) -> None:
    lines = ["% Intrinsic and Extrinsic Camera Parameters", "%-- Focal length:"]
    for name, value in BOUGUET.items():
        lines.append(f"{name} = [ {' ; '.join(repr(float(v)) for v in np.ravel(value))} ];".replace("nan", "NaN"))
    (tmp_path / "Calib_Results.m").write_text("\n".join(lines))
    found = cb.convert(tmp_path / "Calib_Results.m")
    assert found.camera.parameters["cx"] == 302.5
    assert found.camera.image_size == (640, 480)


def test_skew(tmp_path: Path) -> None:
    lens = BOUGUET | {"kc": np.zeros((5, 1)), "alpha_c": 0.01}
    assert cb.convert(saved(tmp_path, **lens)).camera.parameters["skew"] == pytest.approx(6.574)


def test_versions_and_objects_that_are_not_read(tmp_path: Path) -> None:
    file = tmp_path / "new.mat"
    file.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n")
    with pytest.raises(InputError, match="'-v7'"):
        cb.convert(file)
    flags, kind = struct.pack("<IIII", 6, 8, 17, 0), struct.pack("<I4s", (4 << 16) | 1, b"MCOS")
    name, of = struct.pack("<II", 1, 12) + b"cameraParams\0\0\0\0", struct.pack("<I4s", (3 << 16) | 1, b"cam")
    body = flags + name + kind + of
    head = loaded_header()
    (tmp_path / "object.mat").write_bytes(head + struct.pack("<II", 14, len(body)) + body)
    with pytest.raises(InputError, match="toStruct"):
        cb.convert(tmp_path / "object.mat")
    with pytest.raises(InputError, match="its variables are a"):
        cb.convert(saved(tmp_path, a=np.eye(3)))


def loaded_header() -> bytes:
    stream = io.BytesIO()
    savemat(stream, {})
    return stream.getvalue()[:128]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"RadialDistortion": np.zeros(5)}, "RadialDistortion"),
        ({"TangentialDistortion": np.array([np.nan, 0])}, "TangentialDistortion"),
        ({"IntrinsicMatrix": np.eye(4)}, "IntrinsicMatrix"),
        ({"ImageSize": np.zeros((0, 0))}, "image size"),
        ({"ImageSize": np.array([1280.0, 72.0])}, "principal point"),
        ({"RotationVectors": np.zeros((3, 3))}, "belong together"),
    ],
)
def test_contradictions(tmp_path: Path, more: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        cb.convert(saved(tmp_path, cameraParams=camera(**more)))


def test_a_pair_that_its_boards_contradict(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="boards"):
        cb.convert(saved(tmp_path, s=pair(TranslationOfCamera2=np.array([[-100.0, 2, 5]]))))


def test_what_is_read_is_what_scipy_reads(tmp_path: Path) -> None:
    values = {"a": np.arange(6.0).reshape(2, 3), "t": "word", "s": {"x": np.int16([[1, 2]]), "y": {"z": 0.5}}}
    file = saved(tmp_path, packed=True, **values)
    ours, told = variables(file.read_bytes()), loadmat(file, simplify_cells=True)
    np.testing.assert_array_equal(ours["a"], told["a"])
    assert ours["t"] == told["t"]
    np.testing.assert_array_equal(ours["s"]["x"].ravel(), told["s"]["x"])
    assert float(ours["s"]["y"]["z"].item()) == told["s"]["y"]["z"]


def test_bombs_and_cut_files(tmp_path: Path) -> None:
    good = saved(tmp_path, cameraParams=camera()).read_bytes()
    for length in (130, 200, len(good) // 2, len(good) - 9):
        (tmp_path / "cut.mat").write_bytes(good[:length])
        with pytest.raises(InputError, match=r"cut\.mat"):
            cb.convert(tmp_path / "cut.mat")
    packed = zlib.compress(bytes(140_000_000), 1)
    (tmp_path / "bomb.mat").write_bytes(loaded_header() + struct.pack("<II", 15, len(packed)) + packed)
    with pytest.raises(InputError, match="unpacks to more"):
        cb.convert(tmp_path / "bomb.mat")
    sizes = struct.pack("<IIIIIIii", 6, 8, 1, 0, 5, 8, 2**31 - 1, 2**31 - 1) + struct.pack("<I4s", (1 << 16) | 1, b"c")
    (tmp_path / "huge.mat").write_bytes(loaded_header() + struct.pack("<II", 14, len(sizes)) + sizes)
    with pytest.raises(InputError, match="size"):
        cb.convert(tmp_path / "huge.mat")
