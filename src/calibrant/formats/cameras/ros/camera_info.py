"""ROS camera_info: what the message's fields say of a camera and of a rectified pair, and the same as YAML and as ini.

    plumb_bob            OpenCV's five terms         (sensor_msgs/distortion_models.hpp)
    rational_polynomial  eight of them or more
    equidistant          the four of cv2.fisheye

R turns the camera's frame into the rectified one and P projects from there (sensor_msgs/CameraInfo): P is of rectified
pictures, K and D of those that the camera takes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.cameras.plane_distortion import TERMS
from calibrant.data.result_file import write_text
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import Size, numbers
from calibrant.formats.cameras.described import described_camera
from calibrant.formats.documents.number_text import row_of
from calibrant.formats.exchange.rotation_numbers import rotation_in
from calibrant.reading.notes import note

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
INI_MODELS = ("pinhole", "brown", "rational")
"""The ini has one row of five terms, or of eight."""
_MARKS = {"distortion_model", "camera_name", "projection_matrix"}
_MATRIX = {"camera_matrix", "K", "k"}
_PART = ("binning_x", "binning_y")


@dataclass(frozen=True, eq=False)
class Rectified:
    """R_rectified_camera (3, 3) and P (3, 4), the projection of rectified pictures, its last column in px metres."""

    R_rectified_camera: Array
    P: Array

    @property
    def t(self) -> Array:
        """(3,): p = p_rectified + t in the frame of this camera, metres; x is -baseline in a right camera."""
        return np.asarray(np.linalg.solve(self.P[:, :3], self.P[:, 3]))


@dataclass(frozen=True, eq=False)
class Info:
    """A camera as its file calls it; rectified: None where the file says nothing of it."""

    name: str
    camera: Camera
    rectified: Rectified | None = None

    @property
    def stands_aside(self) -> bool:
        """Whether P places the camera beside the one that rectified points are counted from."""
        return self.rectified is not None and bool(self.rectified.P[:, 3].any())


def is_camera_info(data: Mapping[str, Any]) -> bool:
    """Whether these keys are those of a camera_info."""
    keys = {str(key) for key in data}
    return bool(keys & _MARKS) and bool(keys & _MATRIX)


def info_of(data: Mapping[str, Any], image_size: Size | None, source: str, *, name: str = "camera") -> Info:
    """What the fields say. name: where they hold none; source: the file, for notes. Raises: InputError."""
    camera = described_camera(
        {k: v for k, v in data.items() if k not in (*_PART, "roi", "do_rectify")}, image_size, source
    )
    _note_part(data, source)
    try:
        rectified = _rectified(data)
    except InputError as error:
        # The camera itself does not depend on them.
        note(f"{source}: not used: R and P ({error})")
        rectified = None
    return Info(str(data.get("camera_name") or name), camera, rectified)


def _rectified(data: Mapping[str, Any]) -> Rectified | None:
    """R and P where both are there; zeros are how a message says that it does not know."""
    R = _matrix(data, ("rectification_matrix", "R", "r"), (3, 3))
    P = _matrix(data, ("projection_matrix", "P", "p"), (3, 4))
    if P is None or not P.any():
        return None
    if R is None or not R.any():
        R = np.eye(3)
    turn = rotation_in(R)
    if turn is None:
        raise InputError(f"the rectification matrix is {R.tolist()}, expected a rotation")
    plain = P[0, 0] > 0 and P[1, 1] > 0 and P[1, 0] == 0 and P[:2, 2].any()
    if not (plain and np.array_equal(P[2], [0, 0, 1, 0])):
        raise InputError(
            f"the projection matrix is {P.tolist()}, expected [[fx, 0, cx, Tx], [0, fy, cy, Ty], [0, 0, 1, 0]]"
        )
    return Rectified(turn, P)


def _matrix(data: Mapping[str, Any], keys: tuple[str, ...], shape: tuple[int, int]) -> Array | None:
    key = next((k for k in keys if data.get(k) is not None), None)
    if key is None:
        return None
    value = data[key]
    flat = numbers(value.get("data", []) if isinstance(value, Mapping) else value, key)
    if flat.size != shape[0] * shape[1] or not np.all(np.isfinite(flat)):
        raise InputError(f"{key} holds {flat.size} numbers, expected {shape[0] * shape[1]} finite ones")
    return flat.reshape(shape)


def _note_part(data: Mapping[str, Any], source: str) -> None:
    """K is of the whole sensor whatever part of it the driver sends (sensor_msgs/CameraInfo)."""
    binned = [f"{key} {data[key]}" for key in _PART if data.get(key) not in (None, 0, 1)]
    roi = data.get("roi")
    cut = [f"{k} {v}" for k, v in roi.items() if v and k != "do_rectify"] if isinstance(roi, Mapping) else []
    if binned or cut:
        note(
            f"{source}: the camera is that of the whole picture, not of the part that was sent "
            f"({', '.join([*binned, *(f'roi {words}' for words in cut)])})"
        )


def note_rectified(info: Info, source: str) -> None:
    """Say that R and P were not used, where they say more than that there is no rectification."""
    if info.rectified is None:
        return
    R, P = info.rectified.R_rectified_camera, info.rectified.P
    if info.stands_aside:
        where = 1e3 * info.rectified.t
        note(
            f"{source}: the second camera of a pair, {np.abs(where).max():.6g} mm beside the first; give the folder "
            "with the files of both to read where they are"
        )
    elif not np.array_equal(R, np.eye(3)) or not np.allclose(P[:, :3], info.camera.K, rtol=1e-6):
        note(f"{source}: not used: R and P, which say how rectified pictures look")


def write_camera_info(camera: Camera, path: str | Path, *, name: str = "camera", force: bool = False) -> Path:
    """Write `camera_info_text`. Raises: InputError as that, or as `write_text`."""
    return write_text(camera_info_text(camera, name=name), path, force=force)


def camera_info_text(camera: Camera, *, name: str = "camera", rectified: Rectified | None = None) -> str:
    """A camera as the YAML that camera_info_manager reads; without `rectified`, R is the identity and P is [K 0].

    Raises: InputError for a model that ROS does not have.
    """
    model, terms = _words_of(camera, MODELS, "ROS camera_info")
    R, P = _stated(camera, rectified)
    values = {
        "image_width": camera.image_size[0],
        "image_height": camera.image_size[1],
        "camera_name": name,
        "camera_matrix": _matrix_entry(camera.K),
        "distortion_model": model,
        "distortion_coefficients": _matrix_entry(np.array([terms])),
        "rectification_matrix": _matrix_entry(R),
        "projection_matrix": _matrix_entry(P),
    }
    return yaml.safe_dump(values, sort_keys=False, default_flow_style=None)


def ini_text(camera: Camera, *, name: str = "camera", rectified: Rectified | None = None) -> str:
    """A camera as the ini of camera_calibration_parsers. Raises: InputError for a model that it does not have."""
    _, terms = _words_of(camera, INI_MODELS, "ROS's ini")
    R, P = _stated(camera, rectified)
    width, height = camera.image_size
    parts = {"camera matrix": camera.K, "distortion": np.array([terms]), "rectification": R, "projection": P}
    lines = ["[image]", "", "width", str(width), "", "height", str(height), "", f"[{name}]", ""]
    for key, rows in parts.items():
        lines += [key, *(row_of(row) for row in rows), ""]
    return "\n".join(lines)


def _words_of(camera: Camera, models: tuple[str, ...], what: str) -> tuple[str, list[float]]:
    if camera.model.name not in models:
        raise InputError(
            f"a {camera.model.name} camera cannot be written as {what}, which holds {', '.join(models)}; "
            "write the JSON result instead"
        )
    model, terms = _WRITTEN[camera.model.name]
    return model, [float(camera.parameters.get(term, 0.0)) for term in terms]


def _stated(camera: Camera, rectified: Rectified | None) -> Iterator[Array]:
    if rectified is None:
        return iter((np.eye(3), np.concatenate([camera.K, np.zeros((3, 1))], axis=1)))
    return iter((rectified.R_rectified_camera, rectified.P))


def _matrix_entry(values: np.ndarray) -> dict[str, object]:
    rows, columns = values.shape
    return {"rows": rows, "cols": columns, "data": values.ravel().tolist()}
