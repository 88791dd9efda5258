"""basalt's JSON: its camera types, poses on the IMU, and back."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from tests.formats.cameras.calibrators.rigs import assert_same, graph, rig, through

from calibrant.errors import InputError
from calibrant.formats.exchange.read import read_any
from calibrant.reading.notes import heard

# The shape of basalt's data/euroc_ds_calib.json.
EUROC = {
    "value0": {
        "T_imu_cam": [
            {
                "px": -0.016774788924641534,
                "py": -0.068938940687127,
                "pz": 0.005139123188382424,
                "qx": -0.007239825785317818,
                "qy": 0.007541278561558601,
                "qz": 0.7017845426564943,
                "qw": 0.7123125505904486,
            },
        ],
        "intrinsics": [
            {
                "camera_type": "ds",
                "intrinsics": {
                    "fx": 349.7560023050409,
                    "fy": 348.72454229977037,
                    "cx": 365.89440762590149,
                    "cy": 249.32995565708704,
                    "xi": -0.2409573942178872,
                    "alpha": 0.566996899163044,
                },
            }
        ],
        "resolution": [[752, 480]],
        "vignette": [],
        "calib_accel_bias": [0.0] * 9,
        "imu_update_rate": 200.0,
        "cam_time_offset_ns": 1500000,
    }
}


def put(tmp_path: Path, data: object) -> Path:
    file = tmp_path / "calibration.json"
    file.write_text(json.dumps(data))
    return file


def test_a_point_of_the_imu_lands_where_basalts_equations_put_it(tmp_path: Path) -> None:
    with heard() as notes:
        found = read_any(put(tmp_path, EUROC))
    pose, p = EUROC["value0"]["T_imu_cam"][0], EUROC["value0"]["intrinsics"][0]["intrinsics"]  # type: ignore[index]
    X_imu = np.array([0.3, 0.8, 2.5])
    q = np.array([pose[k] for k in ("qx", "qy", "qz")])
    t = np.array([pose[k] for k in ("px", "py", "pz")])
    # X_cam = q^-1 (X_imu - t) q, by the rotation of a vector by a quaternion
    d = X_imu - t
    X = d + 2 * np.cross(-q, np.cross(-q, d) + pose["qw"] * d)
    d1 = np.linalg.norm(X)
    k = p["xi"] * d1 + X[2]
    s = p["alpha"] * np.sqrt(X[0] ** 2 + X[1] ** 2 + k * k) + (1 - p["alpha"]) * k
    T = graph(found).T("cam0", "imu")
    at = found.camera.project(T[:3, :3] @ X_imu + T[:3, 3])
    np.testing.assert_allclose(at, [p["fx"] * X[0] / s + p["cx"], p["fy"] * X[1] / s + p["cy"]], atol=1e-6)
    assert found.figures["timeshift cam0"].value == pytest.approx(1.5e-3)
    assert any("not used: vignette, calib_accel_bias, imu_update_rate" in note for note in notes)


def test_ucm_is_eucm_with_beta_1(tmp_path: Path) -> None:
    data = json.loads(json.dumps(EUROC))
    entry = data["value0"]["intrinsics"][0]
    entry["camera_type"], entry["intrinsics"]["alpha"] = "ucm", 0.6
    camera = read_any(put(tmp_path, data)).camera
    X = np.array([0.3, -0.5, 0.7])
    s = 0.6 * np.linalg.norm(X) + 0.4 * X[2]
    p = entry["intrinsics"]
    np.testing.assert_allclose(camera.project(X), [p["fx"] * X[0] / s + p["cx"], p["fy"] * X[1] / s + p["cy"]])


@pytest.mark.parametrize("models", [("pinhole", "kannala_brandt", "double_sphere"), ("extended_unified", "rational")])
def test_there_and_back(tmp_path: Path, models: tuple[str, ...]) -> None:
    before = rig(*models)
    after = through(before, tmp_path / "calibration.json", "basalt")
    assert_same(after, before)
    np.testing.assert_allclose(graph(after).T("imu", "cam1"), graph(before).T("imu", "cam1"), atol=1e-12)
    assert after.figures["timeshift cam0"].value == pytest.approx(0.0125, abs=1e-12)
    # cereal wants every member that basalt's Calibration has.
    body = json.loads((tmp_path / "calibration.json").read_text())["value0"]
    assert (len(body["calib_accel_bias"]), len(body["calib_gyro_bias"]), body["vignette"]) == (9, 12, [])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda b: b["T_imu_cam"][0].update(qw=0.9), "quaternion of T_imu_cam of cam0 .* expected length 1"),
        (lambda b: b["T_imu_cam"].clear(), "0 T_imu_cam and 1 intrinsics"),
        (lambda b: b["intrinsics"][0].update(camera_type="pinhole9"), "camera_type is 'pinhole9'"),
        (lambda b: b["intrinsics"][0]["intrinsics"].pop("xi"), "xi holds 0 numbers"),
        (lambda b: b["resolution"].clear(), "holds no image size"),
        (lambda b: b.update(resolution=[[752]]), "resolution holds 1 numbers"),
        (lambda b: b.update(intrinsics="none"), "intrinsics is 'none', expected a list"),
        (lambda b: b["T_imu_cam"].__setitem__(0, [1, 2]), "expected px py pz"),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path: Path, change: object, words: str) -> None:
    data = json.loads(json.dumps(EUROC))
    change(data["value0"])  # type: ignore[operator]
    with pytest.raises(InputError, match=rf"calibration\.json: .*{words}"):
        read_any(put(tmp_path, data))
