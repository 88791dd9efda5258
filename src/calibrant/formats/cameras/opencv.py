"""Intrinsics in OpenCV's own file format: `Intr.yml` written, FileStorage YAML, XML and JSON read.

Written keys are those of OpenCV's calibration sample: image_width, image_height, camera_matrix,
distortion_coefficients (k1 k2 p1 p2 k3, and on to tx ty for the models that have them), avg_reprojection_error (RMS per
point over both axes, px). Added:
camera_model, parameter_names and parameter_sigma (1 sigma, 0 for a fixed term); and where the lens has no more than
k1 k2 p1 p2 k3, K and kc, the names of the calibration program whose `Intr.yml` this is.
"""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrant.cameras import Camera
from calibrant.cameras.plane_distortion import TERMS
from calibrant.data.result_file import write_text
from calibrant.errors import InputError
from calibrant.formats.documents.opencv_storage import yaml_text

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
MODELS = tuple(_TERMS)


def is_opencvs(camera: Camera) -> bool:
    """Whether OpenCV has the camera's model."""
    return camera.model.name in _TERMS


def distortion_coefficients(camera: Camera) -> NDArray:
    """OpenCV's coefficients (n, 1) of a camera whose model it has, in its order."""
    return np.array([[camera.parameters.get(k, 0.0)] for k in _TERMS[camera.model.name]])


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
        "distortion_coefficients": distortion_coefficients(camera),
    }
    if _TERMS[camera.model.name] == TERMS[:5]:
        values |= {"K": camera.K, "kc": values["distortion_coefficients"]}
    if "xi" in p:
        values["xi"] = p["xi"]
    if rms_px is not None:
        values["avg_reprojection_error"] = float(rms_px)
    if camera.covariance is not None:
        values["parameter_names"] = " ".join(camera.model.parameter_names)
        values["parameter_sigma"] = np.array([[s] for s in camera.sigma.values()])
    return yaml_text(values)
