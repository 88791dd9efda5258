"""Intrinsics in OpenCV's own file format: `Intr.yml` written, FileStorage YAML, XML and JSON read.

Written keys are those of OpenCV's calibration sample: image_width, image_height, camera_matrix,
distortion_coefficients (k1 k2 p1 p2 k3, and on to tx ty for the models that have them), avg_reprojection_error (RMS per
point over both axes, px). Added:
camera_model, parameter_names and parameter_sigma (1 sigma, 0 for a fixed term).
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.cameras import Camera, camera_model
from calibrant.cameras.plane_distortion import TERMS
from calibrant.data.result_file import write_text
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import (
    CameraFormat,
    Size,
    camera_from_opencv,
    matrix_parameters,
    numbers,
    placed_camera,
    single,
    whole_size,
)
from calibrant.formats.cameras.opencv_storage import yaml_text

_MATRIX_KEYS = ("cameramatrix", "k", "m1", "intrinsicmatrix", "intrinsics", "intrinsic", "mtx", "camint", "cameramat")
_DISTORTION_KEYS = (
    *("distortioncoefficients", "distortion", "distcoeffs", "distcoefs", "dist", "kc", "d", "d1", "camdist"),
    "distortioncoeffs",
)
_WIDTH_KEYS, _HEIGHT_KEYS = ("imagewidth", "width"), ("imageheight", "height")
_SIZE_KEYS = ("imagesize", "size", "resolution")
_SHAPE_KEYS = ("imgshape", "imageshape", "shape")
"""An array's shape is (rows, columns): height first."""

_TERMS = {
    "pinhole": TERMS[:5],
    "pinhole_skew": TERMS[:5],
    "brown": TERMS[:5],
    "rational": TERMS[:8],
    "thin_prism": TERMS[:12],
    "tilted": TERMS,
    "kannala_brandt": ("k1", "k2", "k3", "k4"),
    "unified": ("k1", "k2", "p1", "p2"),
}
"""The models that OpenCV has, with its coefficients in its order: cv2.fisheye's and cv2.omnidir's (with xi) last."""
_FISHEYE, _OMNIDIR = "kannala_brandt", "unified"


def is_opencvs(camera: Camera) -> bool:
    """Whether OpenCV has the camera's model."""
    return camera.model.name in _TERMS


def write_intrinsics(
    camera: Camera, path: str | Path, *, rms_px: float | None = None, force: bool = False, created: str | None = None
) -> Path:
    """Write a camera as OpenCV YAML, whole or not at all; cv2.FileStorage reads it.

    Raises: InputError for a model that OpenCV does not have, or as `write_text`.
    """
    return write_text(intrinsics_text(camera, rms_px=rms_px, created=created), path, force=force)


def intrinsics_text(camera: Camera, *, rms_px: float | None = None, created: str | None = None) -> str:
    """A camera as OpenCV YAML. Raises: InputError for a model that OpenCV does not have."""
    if not is_opencvs(camera):
        raise InputError(
            f"a {camera.model.name} camera cannot be written as OpenCV YAML, which holds {', '.join(_TERMS)}; "
            "write the JSON result instead"
        )
    p = camera.parameters
    values: dict[str, NDArray | float | int | str] = {
        "calibration_time": created or datetime.now(UTC).isoformat(timespec="seconds"),
        "image_width": camera.image_size[0],
        "image_height": camera.image_size[1],
        "camera_model": camera.model.name,
        "camera_matrix": camera.K,
        "distortion_coefficients": np.array([[p.get(k, 0.0)] for k in _TERMS[camera.model.name]]),
    }
    if "xi" in p:
        values["xi"] = p["xi"]
    if rms_px is not None:
        values["avg_reprojection_error"] = float(rms_px)
    if camera.covariance is not None:
        values["parameter_names"] = " ".join(camera.model.parameter_names)
        values["parameter_sigma"] = np.array([[s] for s in camera.sigma.values()])
    return yaml_text(values)


def _is_opencv(data: Mapping[str, Any]) -> bool:
    return _camera_matrix(data) is not None


def _opencv_camera(data: Mapping[str, Any], image_size: Size | None) -> Camera:
    K = _camera_matrix(data)
    if K is None:
        raise InputError("no 3x3 camera matrix")
    named = {_key(k): v for k, v in data.items()}
    distortion: Any = next((named[k] for k in _DISTORTION_KEYS if k in named), [])
    model = _model_named(named)
    terms = numbers(distortion, "distortion")
    found = _stated_size(named)
    if model in _TERMS and model != "pinhole":
        camera = _named_model(model, K, named, terms, found, image_size)
    else:
        camera = camera_from_opencv(K, terms.tolist(), found, image_size)
    return _with_sigma(camera, named)


def _model_named(named: Mapping[str, Any]) -> str | None:
    """The model that the file names: in our words, by OpenCV's fisheye flag, or by the xi that only omnidir has."""
    model = str(named.get("cameramodel", ""))
    if model in _TERMS:
        return model
    if "fisheye" in model.lower() or named.get("fisheyemodel"):
        return _FISHEYE
    return _OMNIDIR if "xi" in named else None


def _named_model(
    model: str, K: NDArray, named: Mapping[str, Any], terms: NDArray, found: Size | None, image_size: Size | None
) -> Camera:
    """A camera of a model that the file names. Raises: InputError for a wrong count of coefficients."""
    expected = _TERMS[model]
    if model == "brown" and len(terms) == 4:
        expected = expected[:4]
    if len(terms) != len(expected):
        raise InputError(f"{len(terms)} distortion coefficients; a {model} camera has {', '.join(_TERMS[model])}")
    kind = camera_model(model)
    fx, fy, cx, cy, skew = matrix_parameters(K)
    parameters = {"fx": fx, "fy": fy, "cx": cx, "cy": cy} | ({"skew": skew} if skew else {})
    if model == _OMNIDIR:
        parameters["xi"] = single(named, "xi")
    parameters |= {k: float(v) for k, v in zip(expected, terms) if k in kind.parameter_names}
    return placed_camera(model, parameters, found, image_size)


def _with_sigma(camera: Camera, named: Mapping[str, Any]) -> Camera:
    sigma = named.get("parametersigma")
    if sigma is None or str(named.get("parameternames", "")).split() != list(camera.model.parameter_names):
        return camera
    # The file keeps the variances alone; correlations live in the JSON result.
    covariance = np.diag(numbers(sigma, "parameter_sigma") ** 2)
    return Camera.create(camera.model.name, camera.parameters, image_size=camera.image_size, covariance=covariance)


def _camera_matrix(data: Mapping[str, Any]) -> NDArray | None:
    """The file's camera matrix, if it holds one. Raises: InputError when it holds the matrices of two cameras."""
    named = {_key(k): v for k, v in data.items()}
    found = {k: named[k] for k in _MATRIX_KEYS if isinstance(named.get(k), np.ndarray) and named[k].shape == (3, 3)}
    if "m1" in found and "m2" in named:
        raise InputError("a stereo file with two camera matrices, M1 and M2; give a file of one camera")
    return next(iter(found.values()), None)


def _stated_size(named: Mapping[str, Any]) -> Size | None:
    width = next((named[k] for k in _WIDTH_KEYS if k in named), None)
    height = next((named[k] for k in _HEIGHT_KEYS if k in named), None)
    if width is not None and height is not None:
        return whole_size(width, height)
    for keys, first_is_width in ((_SIZE_KEYS, True), (_SHAPE_KEYS, False)):
        pair = next((numbers(named[k], k) for k in keys if k in named), None)
        if pair is not None and len(pair) == 2:
            return whole_size(*(pair if first_is_width else pair[::-1]))
    return None


def _key(name: Any) -> str:
    return str(name).lower().replace("_", "").replace("-", "").replace(" ", "")


OPENCV = CameraFormat("OpenCV FileStorage (camera_matrix, distortion_coefficients)", _is_opencv, _opencv_camera)
