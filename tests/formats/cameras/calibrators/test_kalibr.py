"""Kalibr's and OpenVINS's chains: every model by its published equations, places by theirs, and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from tests.formats.cameras.calibrators.rigs import assert_same, camera, graph, rig, through

from calibrant.cameras.approximation.nearest import in_words_of
from calibrant.errors import InputError
from calibrant.formats.cameras.calibrators.kalibr import FORMAT
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ReadOptions
from calibrant.formats.exchange.read import format_of, read_any
from calibrant.reading.notes import heard

# As kalibr_calibrate_imu_camera writes it (EuRoC's cameras).
IMUCAM = """cam0:
  T_cam_imu:
  - [0.014865542981794, 0.999557249008346, -0.025774436697440, 0.065222909535531]
  - [-0.999880929698575, 0.014967213324719, 0.003756188357967, -0.020706385492719]
  - [0.004140296794224, 0.025715529947966, 0.999660727177902, -0.008054602460030]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
  distortion_model: radtan
  intrinsics: [458.654, 457.296, 367.215, 248.375]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
  timeshift_cam_imu: 0.00270636270255
cam1:
  T_cam_imu:
  - [0.012555267089103, 0.999598781151433, -0.025389800891747, -0.044901980682509]
  - [-0.999755099723116, 0.013011905181504, 0.017900583825251, -0.020569771258915]
  - [0.018223771455443, 0.025158836311552, 0.999517347077547, -0.008638135126028]
  - [0.0, 0.0, 0.0, 1.0]
  T_cn_cnm1:
  - [0.999997256477797, -0.002312067192420, -0.000376008102415, -0.110073808127187]
  - [0.002317135723281, 0.999898048506528, 0.014089835846648, 0.000399121547014]
  - [0.000343393120620, -0.014090668452714, 0.999900662637729, -0.000853702503357]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05]
  distortion_model: radtan
  intrinsics: [457.587, 456.134, 379.999, 255.238]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
  timeshift_cam_imu: 0.00270636270255
"""
# As OpenVINS ships it: OpenCV's header, poses of the cameras in the IMU's frame.
OPENVINS = """%YAML:1.0

cam0:
  T_imu_cam: #rotation from camera to IMU R_CtoI, position of camera in IMU p_CinI
    - [0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975]
    - [0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768]
    - [-0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949]
    - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]
  distortion_model: radtan
  intrinsics: [458.654,457.296,367.215,248.375] #fu, fv, cu, cv
  resolution: [752, 480]
  rostopic: /cam0/image_raw
"""
POINT = np.array([0.4, -0.3, 1.7])


def put(tmp_path: Path, text: str, name: str = "chain.yaml") -> Path:
    file = tmp_path / name
    file.write_text(text)
    return file


def test_a_point_of_the_imu_lands_where_kalibrs_equations_put_it(tmp_path: Path) -> None:
    with heard() as notes:
        found = read_any(put(tmp_path, IMUCAM))
    chain = yaml.safe_load(IMUCAM)
    X = np.array([*POINT, 1.0])
    for T in (chain["cam0"]["T_cam_imu"], chain["cam1"]["T_cn_cnm1"]):
        X = np.array(T) @ X
    x, y = X[:2] / X[2]
    r2 = x * x + y * y
    k1, k2, p1, p2 = -0.28368365, 0.07451284, -0.00010473, -3.55590700e-05
    radial = 1 + k1 * r2 + k2 * r2 * r2
    u = 457.587 * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + 379.999
    v = 456.134 * (y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)) + 255.238
    T_cam_imu = graph(found).T("cam1", "imu")
    at = found.cameras["cam1"].project(T_cam_imu[:3, :3] @ POINT + T_cam_imu[:3, 3])
    np.testing.assert_allclose(at, [u, v], atol=1e-6)
    assert any("contradicts T_cam_imu of cam0 and cam1 by 0.516 mm and 0.268 deg; T_cn" in note for note in notes)
    by_imu = read_any(tmp_path / "chain.yaml", ReadOptions(answers={"places": "imu"}))
    np.testing.assert_allclose(graph(by_imu).T("cam1", "imu"), chain["cam1"]["T_cam_imu"], atol=1e-9)
    assert found.figures["timeshift cam0"].value == 0.00270636270255
    assert any("cam0.rostopic" in note for note in notes)


def test_without_an_imu_the_chain_says_where_cameras_are(tmp_path: Path) -> None:
    chain = yaml.safe_load(IMUCAM)
    for node in chain.values():
        del node["T_cam_imu"], node["timeshift_cam_imu"]
    found = read_any(put(tmp_path, yaml.safe_dump(chain)))
    T = np.array(chain["cam1"]["T_cn_cnm1"])
    np.testing.assert_allclose(graph(found).T("cam1", "cam0"), T, atol=1e-9)
    assert [(t.parent, t.child) for t in found.transforms] == [("cam0", "cam1")]


def test_openvins_says_where_the_camera_is_on_the_imu(tmp_path: Path) -> None:
    file = put(tmp_path, OPENVINS)
    assert format_of(Document(file)).name == "openvins"
    found = read_any(file)
    # p_CinI: the camera's middle in the IMU's frame.
    np.testing.assert_allclose(
        found.transform("imu", "cam0").matrix[:3, 3], [-0.0216401454975, -0.064676986768, 0.00981073058949], atol=1e-12
    )
    kalibrs = read_any(put(tmp_path, IMUCAM)).transform("imu", "cam0").matrix
    np.testing.assert_allclose(found.transform("imu", "cam0").matrix, kalibrs, atol=1e-9)


@pytest.mark.parametrize(
    "models", [("pinhole", "brown", "kannala_brandt"), ("unified", "extended_unified", "double_sphere")]
)
@pytest.mark.parametrize("imu", [True, False])
def test_kalibr_there_and_back(tmp_path: Path, models: tuple[str, ...], imu: bool) -> None:
    before = rig(*models, imu=imu)
    after = through(before, tmp_path / "chain.yaml", "kalibr")
    assert_same(after, before)
    assert dict(after.figures) == dict(before.figures)
    if imu:
        np.testing.assert_allclose(graph(after).T("imu", "cam2"), graph(before).T("imu", "cam2"), atol=1e-12)
    # PyYAML, which Kalibr reads with, takes every number for a number.
    node = yaml.safe_load((tmp_path / "chain.yaml").read_text())["cam1"]
    assert all(type(v) is float for v in (*node["intrinsics"], *node["distortion_coeffs"], *node["T_cn_cnm1"][3]))


def test_openvins_there_and_back(tmp_path: Path) -> None:
    before = rig("brown", "kannala_brandt", "pinhole")
    after = through(before, tmp_path / "chain.yaml", "openvins")
    assert_same(after, before)
    np.testing.assert_allclose(graph(after).T("imu", "cam1"), graph(before).T("imu", "cam1"), atol=1e-12)


def test_omni_ds_eucm_and_equidistant_by_their_equations(tmp_path: Path) -> None:
    X, Y, Z = POINT
    norm = float(np.linalg.norm(POINT))

    def pixel(
        model: str, intrinsics: list[float], distortion: str = "none", terms: tuple[float, ...] = ()
    ) -> np.ndarray:
        node = f"camera_model: {model}, intrinsics: {intrinsics}, distortion_model: {distortion}"
        text = f"cam0: {{{node}, distortion_coeffs: {list(terms)}, resolution: [752, 480]}}\n"
        return read_any(put(tmp_path, text)).camera.project(POINT)

    mx, my = X / (Z + 1.3 * norm), Y / (Z + 1.3 * norm)
    np.testing.assert_allclose(pixel("omni", [1.3, 700.0, 701.0, 370.0, 240.0]), [700 * mx + 370, 701 * my + 240])
    alpha, beta = 0.6, 1.1
    d = alpha * np.sqrt(beta * (X * X + Y * Y) + Z * Z) + (1 - alpha) * Z
    eucm = pixel("eucm", [alpha, beta, 400.0, 401.0, 370.0, 240.0])
    np.testing.assert_allclose(eucm, [400 * X / d + 370, 401 * Y / d + 240])
    xi, alpha = -0.2, 0.55
    z1 = xi * norm + Z
    d = alpha * np.sqrt(X * X + Y * Y + z1 * z1) + (1 - alpha) * z1
    ds = pixel("ds", [xi, alpha, 400.0, 401.0, 370.0, 240.0])
    np.testing.assert_allclose(ds, [400 * X / d + 370, 401 * Y / d + 240])
    r = np.hypot(X, Y)
    t = np.arctan2(r, Z)
    td = t * (1 + 0.01 * t**2 - 0.02 * t**4 + 0.003 * t**6 - 0.001 * t**8)
    kb = pixel("pinhole", [400.0, 401.0, 370.0, 240.0], "equidistant", (0.01, -0.02, 0.003, -0.001))
    np.testing.assert_allclose(kb, [400 * td * X / r + 370, 401 * td * Y / r + 240])


def test_a_field_of_view_lens_is_read_as_the_nearest_and_says_by_how_much(tmp_path: Path) -> None:
    node = "camera_model: pinhole, intrinsics: [300.0, 301.0, 370.0, 240.0], distortion_model: fov"
    file = put(tmp_path, f"cam0: {{{node}, distortion_coeffs: [0.93], resolution: [752, 480]}}\n")
    with pytest.raises(InputError, match=r"a fov lens is a model .* px RMS .*answer approximate=yes"):
        read_any(file)
    with heard() as notes:
        found = read_any(file, ReadOptions(answers={"approximate": "yes"})).camera
    (told,) = notes
    r = np.hypot(*POINT[:2]) / POINT[2]
    rd = np.arctan(2 * r * np.tan(0.93 / 2)) / 0.93
    by_hand = np.array([300, 301]) * rd / r * POINT[:2] / POINT[2] + [370, 240]
    assert "a fov lens is read as the nearest" in told
    most = float(told.split(" px at most")[0].rsplit(" ", 1)[1])
    assert np.linalg.norm(found.project(POINT) - by_hand) <= most < 0.05
    asked = read_any(file, ReadOptions(answers={"model": "rational"})).camera
    assert asked.model.name == "rational"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("radtan", "thinprism", "pinhole with distortion_model 'thinprism'; expected pinhole with none"),
        ("camera_model: pinhole", "camera_model: fisheye9", "camera_model is 'fisheye9', expected one of omni"),
        ("[458.654, 457.296, 367.215, 248.375]", "[458.654, 457.296]", "holds 2 numbers, expected fx, fy, cx, cy"),
        ("resolution: [752, 480]", "resolution: [300, 200]", "principal point"),
        ("resolution: [752, 480]", "resolution: 752", "expected .width, height."),
        ("0.014865542981794", "1.014865542981794", "the rotation of cam0.T_cam_imu is none"),
        (
            "-0.110073808127187",
            "-0.510073808127187",
            "contradicts T_cam_imu of cam0 .* --answer places=chain",
        ),
        ("0.00270636270255", "later", "timeshift_cam_imu is 'later'"),
        ("457.296", "nan", "not finite"),
    ],
)
def test_what_contradicts_or_is_none_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(InputError, match=rf"chain\.yaml: .*{words}"):
        read_any(put(tmp_path, IMUCAM.replace(old, new)))


def test_a_term_that_kalibr_has_not_is_not_written_silently() -> None:
    with_k3 = camera("brown", k3=0.004)
    assert in_words_of(with_k3, FORMAT.models, lacks=FORMAT.lacks) is None
    assert in_words_of(camera("brown"), FORMAT.models, lacks=FORMAT.lacks) is not None
    assert in_words_of(camera("unified", skew=0.3), FORMAT.models, lacks=FORMAT.lacks) is None
