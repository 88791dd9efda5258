"""A rig of three cameras with places and an IMU, and what is the same after it went through another program's file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import calibrant as cb
from calibrant.data import as_transform
from calibrant.data.result_file import write_result
from calibrant.data.results import Measured
from calibrant.formats.exchange.read import read_any
from calibrant.geometry import se3

SIZE = (1280, 800)
FOCAL = {"fx": 640.25, "fy": 639.81, "cx": 643.17, "cy": 402.88}
TERMS = {
    "pinhole": {},
    "brown": {"k1": -0.2, "k2": 0.05, "p1": 1e-3, "p2": -2e-3},
    "rational": {"k1": -0.2, "k2": 0.05, "p1": 1e-3, "p2": -2e-3, "k3": 0.002, "k4": 0.03, "k5": 0.01, "k6": 0.003},
    "kannala_brandt": {"k1": 0.02, "k2": -0.004, "k3": 0.001, "k4": -0.0002},
    "unified": {"xi": 1.2, "k1": -0.1, "k2": 0.02, "p1": 1e-3, "p2": -2e-3},
    "extended_unified": {"alpha": 0.6, "beta": 1.1},
    "double_sphere": {"xi": -0.2, "alpha": 0.55},
}
XI = {
    "imu": np.array([0.3, -0.2, 0.9, 0.1, -0.4, 2.0]),
    "cam1": np.array([0.02, 0.01, -0.03, 0.11, 0.001, -0.002]),
    "cam2": np.array([0.5, 1.2, -0.3, -0.2, 0.05, 0.3]),
}


def camera(model: str, **more: float) -> cb.Camera:
    """One of each model."""
    return cb.Camera.create(model, FOCAL | TERMS[model] | more, image_size=SIZE)


def rig(*models: str, imu: bool = True) -> cb.CalibrationResult:
    """Cameras cam0, cam1, … of these models, cam0 on the IMU (or without one) and the others on cam0."""
    places = [as_transform("imu", "cam0", se3.exp(XI["imu"]))] if imu else []
    places += [as_transform("cam0", f"cam{i}", se3.exp(XI[f"cam{i}"])) for i in range(1, len(models))]
    shifts = {f"timeshift cam{i}": Measured(0.0125, unit="s") for i in range(len(models))} if imu else {}
    cameras = {f"cam{i}": camera(model) for i, model in enumerate(models)}
    return cb.CalibrationResult("rig", "ok", cameras=cameras, transforms=tuple(places), figures=shifts)


def through(result: cb.CalibrationResult, target: Path, to: str, **options: object) -> cb.CalibrationResult:
    """The result written as another program's file or folder by `convert`, and read again."""
    source = target.parent / "source.json"
    write_result(result, source, force=True)
    cb.convert(source, target, to=to, **options)  # type: ignore[arg-type]
    return read_any(target)


def assert_same(after: cb.CalibrationResult, before: cb.CalibrationResult, *, atol: float = 1e-12) -> None:
    """Cameras digit for digit, and the cameras' places to each other."""
    assert list(after.cameras) == list(before.cameras)
    for name, one in before.cameras.items():
        assert after.cameras[name].image_size == one.image_size
        np.testing.assert_allclose(after.cameras[name].values, one.values, rtol=1e-14)
    first, *others = before.cameras
    for name in others:
        T = [graph(result).T(first, name) for result in (before, after)]
        np.testing.assert_allclose(T[1], T[0], atol=atol)


def graph(result: cb.CalibrationResult) -> cb.FrameGraph:
    """The frames of a result."""
    found = cb.FrameGraph()
    for t in result.transforms:
        found = found.add(t.parent, t.child, t.matrix)
    return found
