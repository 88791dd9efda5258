"""Intrinsics in OpenCV's own file format: `Intr.yml` written, FileStorage YAML, XML and JSON read.

Written keys are those of OpenCV's calibration sample: image_width, image_height, camera_matrix,
distortion_coefficients (k1 k2 p1 p2 k3), avg_reprojection_error (RMS per point over both axes, px). Added:
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
from calibrant.data.result_file import write_text
from calibrant.errors import InputError
from calibrant.formats.camera_format import CameraFormat, Size, camera_from_opencv, numbers, size_or_refuse, whole_size
from calibrant.formats.opencv_storage import yaml_text

_MATRIX_KEYS = ("cameramatrix", "k", "m1", "intrinsicmatrix", "intrinsics", "intrinsic", "mtx", "camint", "cameramat")
_DISTORTION_KEYS = (
    *("distortioncoefficients", "distortion", "distcoeffs", "distcoefs", "dist", "kc", "d", "d1", "camdist"),
    "distortioncoeffs",
)
_WIDTH_KEYS, _HEIGHT_KEYS = ("imagewidth", "width"), ("imageheight", "height")
_SIZE_KEYS = ("imagesize", "size", "resolution")
_SHAPE_KEYS = ("imgshape", "imageshape", "shape")
"""An array's shape is (rows, columns): height first."""


_BROWN = ("k1", "k2", "p1", "p2", "k3")
_RATIONAL = (*_BROWN, "k4", "k5", "k6")
_PRISM = (*_RATIONAL, "s1", "s2", "s3", "s4")
_TERMS = {
    "pinhole": _BROWN,
    "pinhole_skew": _BROWN,
    "brown": _BROWN,
    "rational": _RATIONAL,
    "thin_prism": _PRISM,
    "tilted": (*_PRISM, "tx", "ty"),
    "kannala_brandt": ("k1", "k2", "k3", "k4"),
    "unified": ("k1", "k2", "p1", "p2"),
}
"""The models that OpenCV has, with its coefficients in its order: cv2.fisheye's and cv2.omnidir's (with xi) last."""


def is_opencvs(camera: Camera) -> bool:
    """Whether OpenCV has the camera's model."""
    return camera.model.name in _TERMS


def write_intrinsics(
    camera: Camera, path: str | Path, *, rms_px: float | None = None, force: bool = False, created: str | None = None
) -> Path:
    """Write a camera as OpenCV YAML, whole or not at all; cv2.FileStorage reads it.

    Raises: InputError for a model that OpenCV does not have, or as `write_text`.
    """
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
    return write_text(yaml_text(values), path, force=force)


def _matches(data: Mapping[str, Any]) -> bool:
    return _matrix(data) is not None


def _read(data: Mapping[str, Any], image_size: Size | None) -> Camera:
    K = _matrix(data)
    if K is None:
        raise InputError("no 3x3 camera matrix")
    named = {_key(k): v for k, v in data.items()}
    distortion: Any = next((named[k] for k in _DISTORTION_KEYS if k in named), [])
    model = named.get("cameramodel")
    sigma = named.get("parametersigma")
    if model in _TERMS and model not in ("pinhole", "brown"):
        camera = _named_model(str(model), K, named, distortion, size_or_refuse(_size(named), image_size))
        return _with_sigma(camera, named, sigma)
    if "fisheye" in str(model).lower() or named.get("fisheyemodel"):
        raise InputError("a fisheye camera of OpenCV's; expected a pinhole or brown camera")
    camera = camera_from_opencv(
        K,
        numbers(distortion, "distortion").tolist(),
        size_or_refuse(_size(named), image_size),
        model=model if model in ("pinhole", "brown") else None,
    )
    return _with_sigma(camera, named, sigma)


def _named_model(model: str, K: NDArray, named: Mapping[str, Any], distortion: Any, size: Size) -> Camera:
    """A camera that `write_intrinsics` wrote, of a model beyond brown. Raises: InputError for a wrong count."""
    terms = numbers(distortion, "distortion").ravel()
    if len(terms) != len(_TERMS[model]):
        raise InputError(f"{len(terms)} distortion coefficients; a {model} camera has {', '.join(_TERMS[model])}")
    parameters = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
    kind = camera_model(model)
    parameters |= {k: v for k, v in zip(_TERMS[model], terms) if k in kind.parameter_names}
    if "skew" in kind.parameter_names:
        parameters["skew"] = K[0, 1]
    if "xi" in kind.parameter_names:
        parameters["xi"] = float(named["xi"])
    return Camera.create(model, parameters, image_size=size)


def _with_sigma(camera: Camera, named: Mapping[str, Any], sigma: Any) -> Camera:
    if sigma is None or str(named.get("parameternames", "")).split() != list(camera.model.parameter_names):
        return camera
    # The file keeps the variances alone; correlations live in the JSON result.
    covariance = np.diag(numbers(sigma, "parameter_sigma") ** 2)
    return Camera.create(camera.model.name, camera.parameters, image_size=camera.image_size, covariance=covariance)


def _matrix(data: Mapping[str, Any]) -> NDArray | None:
    """The file's camera matrix, if it holds one. Raises: InputError when it holds the matrices of two cameras."""
    named = {_key(k): v for k, v in data.items()}
    found = {k: named[k] for k in _MATRIX_KEYS if isinstance(named.get(k), np.ndarray) and named[k].shape == (3, 3)}
    if "m1" in found and "m2" in named:
        raise InputError("a stereo file with two camera matrices, M1 and M2; give a file of one camera")
    return next(iter(found.values()), None)


def _size(named: Mapping[str, Any]) -> Size | None:
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


OPENCV = CameraFormat("OpenCV FileStorage (camera_matrix, distortion_coefficients)", _matches, _read)
