"""Camera arrays in TOML: caliscope's camera_array.toml and config.toml, aniposelib's calibration.toml.

    X_cam = R X_world + t,   rotation: a rotation vector (rad), or in caliscope's older files the matrix R

caliscope has [cameras.N] (before 2025 [cam_N] with cam_id or port) and metres; aniposelib [cam_N] with a name, and
the unit of the board it was calibrated with, which the file does not say. distortions are OpenCV's in its order, with
fisheye = true those of cv2.fisheye; size is [width, height]; pixels are OpenCV's. Source: caliscope 0.11.8,
cameras/camera_array.py (to_toml, from_toml, to_aniposelib_toml) and core/charuco.py; aniposelib 0.8.0, cameras.py.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, TransformEstimate, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.calibrators.rigid import finite, from_vector, quoted
from calibrant.formats.cameras.camera_format import Size, whole_size
from calibrant.formats.cameras.described import described_camera
from calibrant.formats.cameras.opencv import distortion_coefficients
from calibrant.formats.documents.document import Document
from calibrant.formats.documents.number_text import digits
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, WriteOptions, read_cameras
from calibrant.formats.exchange.places import places_in, world_of
from calibrant.geometry import se3, so3
from calibrant.reading.notes import note, note_unused

WORLD = "world"
_SECTION = re.compile(r"^cam_\d+$")
_USED = ("cam_id", "port", "name", "size", "matrix", "distortions", "rotation", "translation", "fisheye")
_EMPTY = (None, "null", "None")
"""How a value that is not known is written."""


def _nodes(document: Document) -> dict[str, Mapping[str, Any]]:
    """The cameras' tables by name, those of either program."""
    cameras = document.mapping.get("cameras")
    if isinstance(cameras, Mapping) and cameras and all(_is_node(n) for n in cameras.values()):
        return {f"cam_{key}": node for key, node in cameras.items()}
    found = {str(k): n for k, n in document.mapping.items() if _SECTION.match(str(k))}
    return found if all(_is_node(n) for n in found.values()) else {}


def _is_node(node: Any) -> bool:
    return isinstance(node, Mapping) and "size" in node and bool({"cam_id", "port", "matrix", "name"} & set(node))


def _is_caliscopes(nodes: Iterable[Mapping[str, Any]]) -> bool:
    return all("cam_id" in node or "port" in node for node in nodes)


def _matches_caliscope(document: Document) -> bool:
    nodes = _nodes(document)
    return bool(nodes) and _is_caliscopes(nodes.values())


def _matches_aniposelib(document: Document) -> bool:
    nodes = _nodes(document)
    return bool(nodes) and any("matrix" in node for node in nodes.values()) and not _is_caliscopes(nodes.values())


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    source, cameras, places = str(document.path), {}, []
    nodes = _nodes(document)
    if not nodes:
        raise InputError("no [cameras.N] or [cam_N] with size and matrix in it")
    unused = [str(k) for k in document.mapping if k not in (*nodes, "cameras")]
    for section, node in nodes.items():
        name = str(node.get("name", section))
        if node.get("matrix") in _EMPTY:
            note(f"{source}: {name} is not calibrated")
            continue
        cameras[name] = _camera(node, options.image_size, f"{source}: {name}")
        posed = [node.get(key) not in _EMPTY for key in ("rotation", "translation")]
        if all(posed):
            places.append((name, from_vector(node["rotation"], node["translation"], name)))
        unused += [f"{name}.{key}" for key, value in node.items() if key not in _USED and value not in (0, False)]
    if not cameras:
        raise InputError("none of its cameras is calibrated")
    note_unused(source, unused)
    metre = _metre(nodes, [T for _, T in places], options, source)
    return read_cameras(cameras, transforms=tuple(_placed(name, T, metre) for name, T in places))


def _placed(name: str, T: Array, metre: float) -> TransformEstimate:
    T = T.copy()
    T[:3, 3] *= metre
    return as_transform(WORLD, name, se3.inverse(T))


def _metre(nodes: Mapping[str, Mapping[str, Any]], poses: list[Array], options: ReadOptions, source: str) -> float:
    """Metres per unit. Raises: InputError where the file's program leaves it open and places matter."""
    if options.unit_m is not None:
        return options.unit_m
    if _is_caliscopes(nodes.values()):
        return 1.0
    if all(node.get("fisheye") is False for node in nodes.values()):
        note(f"{source}: fisheye = false stands in it, as caliscope writes it for aniposelib: lengths are metres")
        return 1.0
    if options.places and any(T[:3, 3].any() for T in poses):
        raise InputError(
            "aniposelib's files do not say their unit, which is that of the board's squares: say --unit mm or another"
        )
    return 1.0


def _camera(node: Mapping[str, Any], size: Size | None, source: str) -> Camera:
    matrix = finite(node["matrix"], f"{source}: matrix")
    pair = finite(node["size"], f"{source}: size")
    if matrix.size != 9 or pair.size != 2:
        raise InputError(f"{source}: a matrix of {matrix.size} and a size of {pair.size} numbers, expected 9 and 2")
    width, height = whole_size(*pair)
    terms = node.get("distortions")
    keys: dict[str, Any] = {
        "camera_matrix": matrix.reshape(3, 3),
        "distortion_coefficients": [] if terms in _EMPTY else finite(terms, f"{source}: distortions"),
        "image_width": width,
        "image_height": height,
    }
    return described_camera(keys | ({"distortion_model": "fisheye"} if node.get("fisheye") else {}), size, source)


def _lines(camera: Camera, T_world_cam: Array, metre: float) -> list[str]:
    """What both programs hold of a camera."""
    T = se3.inverse(T_world_cam)
    rows = ", ".join(f"[{', '.join(map(digits, row))}]" for row in camera.K)
    return [
        f"size = [{camera.image_size[0]}, {camera.image_size[1]}]",
        f"matrix = [{rows}]",
        f"distortions = [{', '.join(digits(v) for v in distortion_coefficients(camera).ravel())}]",
        f"rotation = [{', '.join(map(digits, so3.log(T[:3, :3])))}]",
        f"translation = [{', '.join(digits(v) for v in T[:3, 3] / metre)}]",
    ]


def _numbered(names: Iterable[str]) -> dict[str, int]:
    """N of cam_N where all are called so, else counted."""
    names = list(names)
    if all(_SECTION.match(name) for name in names):
        return {name: int(name[4:]) for name in names}
    return {name: i for i, name in enumerate(names)}


def _write_caliscope(result: CalibrationResult, options: WriteOptions) -> bytes:
    places = places_in(result, world_of(result, options.answers.get("world")), tuple(result.cameras))
    lines: list[str] = []
    for name, i in _numbered(result.cameras).items():
        camera = result.cameras[name]
        fisheye = str(camera.model.name == "kannala_brandt").lower()
        lines += [f"[cameras.{i}]", f"cam_id = {i}", *_lines(camera, places[name], 1.0)]
        lines += ["rotation_count = 0", f"fisheye = {fisheye}", ""]
    return "\n".join(lines).encode()


def _write_aniposelib(result: CalibrationResult, options: WriteOptions) -> bytes:
    if options.unit_m is None:
        note("aniposelib's files do not say their unit: written in metres; --unit says another")
    places = places_in(result, world_of(result, options.answers.get("world")), tuple(result.cameras))
    lines: list[str] = []
    for i, (name, camera) in enumerate(result.cameras.items()):
        lines += [f"[cam_{i}]", f"name = {quoted(name)}", *_lines(camera, places[name], options.unit_m or 1.0)]
        lines += ["fisheye = true", ""] if camera.model.name == "kannala_brandt" else [""]
    error = np.nan_to_num(result.rms_px or 0.0)
    return "\n".join([*lines, "[metadata]", "adjusted = false", f"error = {digits(error)}", ""]).encode()


_ASKS = {"world": "the frame that all cameras are placed in"}
FORMAT = ExchangeFormat(
    name="caliscope",
    title="caliscope camera array (TOML)",
    suffix=".toml",
    matches=_matches_caliscope,
    read=_read,
    write=_write_caliscope,
    models=("pinhole", "brown", "rational", "thin_prism", "tilted", "kannala_brandt"),
    asks=_ASKS,
)
ANIPOSELIB_FORMAT = ExchangeFormat(
    name="aniposelib",
    title="aniposelib calibration (TOML)",
    suffix=".toml",
    matches=_matches_aniposelib,
    read=_read,
    write=_write_aniposelib,
    models=("pinhole", "brown", "kannala_brandt"),
    asks=_ASKS,
)
