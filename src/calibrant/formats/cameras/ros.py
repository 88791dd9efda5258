"""ROS camera_info: the YAML of camera_calibration_parsers, and the fields of the message itself.

distortion_model (sensor_msgs/distortion_models.hpp): plumb_bob has OpenCV's five terms, rational_polynomial eight or
more of them, equidistant the four of cv2.fisheye.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml

from calibrant.cameras import Camera
from calibrant.cameras.plane_distortion import TERMS
from calibrant.data.result_file import write_text
from calibrant.errors import InputError

_EQUIDISTANT = "equidistant"
_WRITTEN = {
    "pinhole": ("plumb_bob", TERMS[:5]),
    "brown": ("plumb_bob", TERMS[:5]),
    "rational": ("rational_polynomial", TERMS[:8]),
    "thin_prism": ("rational_polynomial", TERMS[:12]),
    "tilted": ("rational_polynomial", TERMS),
    "kannala_brandt": (_EQUIDISTANT, ("k1", "k2", "k3", "k4")),
}
"""The models that ROS has: its name and its coefficients in order. image_geometry hands rational_polynomial's to OpenCV
as they are, twelve and fourteen as well as eight."""
MODELS = tuple(_WRITTEN)


def write_camera_info(camera: Camera, path: str | Path, *, name: str = "camera", force: bool = False) -> Path:
    """Write `camera_info_text`. Raises: InputError as that, or as `write_text`."""
    return write_text(camera_info_text(camera, name=name), path, force=force)


def camera_info_text(camera: Camera, *, name: str = "camera") -> str:
    """A camera as the YAML that camera_info_manager reads; rectification is the identity, P is [K 0].

    Raises: InputError for a model that ROS does not have.
    """
    if camera.model.name not in _WRITTEN:
        raise InputError(
            f"a {camera.model.name} camera cannot be written as ROS camera_info, which holds {', '.join(_WRITTEN)}; "
            "write the JSON result instead"
        )
    model, terms = _WRITTEN[camera.model.name]
    p = camera.parameters
    values = {
        "image_width": camera.image_size[0],
        "image_height": camera.image_size[1],
        "camera_name": name,
        "camera_matrix": _matrix_entry(camera.K),
        "distortion_model": model,
        "distortion_coefficients": _matrix_entry(np.array([[p.get(term, 0.0) for term in terms]])),
        "rectification_matrix": _matrix_entry(np.eye(3)),
        "projection_matrix": _matrix_entry(np.concatenate([camera.K, np.zeros((3, 1))], axis=1)),
    }
    return yaml.safe_dump(values, sort_keys=False, default_flow_style=None)


def _matrix_entry(values: np.ndarray) -> dict[str, object]:
    rows, columns = values.shape
    return {"rows": rows, "cols": columns, "data": values.ravel().tolist()}
