"""EuRoC's sensor.yaml of a camera, its folders camN/sensor.yaml, and files of several cameras in the same words.

    X_body = T_BS X_camera      camera_model, intrinsics, distortion_model, distortion_coefficients, resolution

Metres; the body is EuRoC's first inertial unit. The models are Kalibr's (`chain`) under other keys; other programs call
camera_model projection_model, and write the size as width and height. Source: the dataset's files; Burri et al. 2016,
"The EuRoC micro aerial vehicle datasets".
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, TransformEstimate, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.calibrators.chain import LACKS, MODELS, camera_words, chain_camera
from calibrant.formats.cameras.calibrators.rigid import from_matrix, quoted
from calibrant.formats.cameras.foreign_lens import ASKS
from calibrant.formats.documents.document import Document
from calibrant.formats.documents.number_text import digits
from calibrant.formats.exchange.exchange_format import (
    ExchangeFormat,
    ReadOptions,
    WriteOptions,
    Written,
    read_cameras,
)
from calibrant.formats.exchange.places import imu_frame, places_in, world_of
from calibrant.reading.notes import note_unused

BODY = "body"
_FILE, _WHOLE = "sensor.yaml", "mav0"
_MODELS = ("camera_model", "projection_model")
_LENS = ("intrinsics", "distortion_model", "distortion_coefficients", "resolution")
_USED = (*_MODELS, *_LENS, "T_BS", "sensor_type", "camera_id")


def _is_camera(node: Any) -> bool:
    return (
        isinstance(node, Mapping)
        and "T_BS" in node
        and isinstance(node.get("intrinsics"), list)
        and any(key in node for key in _MODELS)
    )


def _nodes(data: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """The cameras under their names in a file of several."""
    return {str(key): node for key, node in data.items() if _is_camera(node)}


def _cameras_of(folder: Document) -> dict[str, Document]:
    """The camera files of a folder of sensors, or of mav0 in it, by the names of their folders."""
    root = folder.path / _WHOLE if _WHOLE in folder.names else folder.path
    names = sorted(name for name in Document(root).names if (root / name / _FILE).is_file())
    files = {name: Document(root / name / _FILE) for name in names}
    return {name: file for name, file in files.items() if _is_camera(file.mapping)}


def _matches(document: Document) -> bool:
    if document.is_folder:
        return (_WHOLE in document.names or any(name.startswith("cam") for name in document.names)) and bool(
            _cameras_of(document)
        )
    return _is_camera(document.mapping) or bool(_nodes(document.mapping))


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    source = str(document.path)
    if document.is_folder:
        nodes: dict[str, Mapping[str, Any]] = {name: file.mapping for name, file in _cameras_of(document).items()}
        left: list[str] = []
    elif _is_camera(document.mapping):
        folder = document.path.parent.name
        name = str(document.mapping.get("camera_id") or (folder if folder.startswith("cam") else "camera"))
        nodes, left = {name: document.mapping}, []
    else:
        nodes = _nodes(document.mapping)
        left = [str(key) for key in document.mapping if key not in nodes]
    if not nodes:
        raise InputError("no camera with T_BS, camera_model and intrinsics in it")
    cameras: dict[str, Camera] = {}
    places: list[TransformEstimate] = []
    for name, node in nodes.items():
        cameras[name] = chain_camera(_in_kalibrs_words(node), options.image_size, f"{source}: {name}", options.answers)
        places.append(as_transform(BODY, name, from_matrix(_numbers(node["T_BS"]), f"{name}.T_BS")))
        left += [f"{name}.{key}" for key in node if key not in _USED]
    note_unused(source, left)
    return read_cameras(cameras, transforms=tuple(places))


def _numbers(value: Any) -> Any:
    """The numbers of a matrix: a list, OpenCV's own, or rows, cols and data."""
    return value.get("data") if isinstance(value, Mapping) else value


def _in_kalibrs_words(node: Mapping[str, Any]) -> dict[str, Any]:
    size = node.get("resolution")
    if isinstance(size, Mapping):
        size = [size.get("width"), size.get("height")]
    said = {
        "camera_model": next(node[key] for key in _MODELS if key in node),
        "intrinsics": node["intrinsics"],
        "distortion_model": node.get("distortion_model"),
        "distortion_coeffs": _numbers(node.get("distortion_coefficients")),
    }
    return said if size is None else said | {"resolution": size}


def _write(result: CalibrationResult, options: WriteOptions) -> Written:
    body = options.answers.get(BODY) or imu_frame(result, None) or world_of(result)
    places = places_in(result, body, tuple(result.cameras))
    texts = {name: _text(name, camera, places[name]) for name, camera in result.cameras.items()}
    if len(texts) == 1:
        return next(iter(texts.values()))
    strange = next((name for name in texts if set(name) & set('/\\:"') or name in (".", "..")), None)
    if strange is not None:
        raise InputError(f"the camera {strange!r} gives its folder its name, which cannot have / \\ : or quotes in it")
    return {f"{name}/{_FILE}": text for name, text in texts.items()}


def _text(name: str, camera: Camera, T_body_camera: Array) -> bytes:
    words = camera_words(camera)
    lens = "radial-tangential" if words.distortion == "radtan" else words.distortion
    lines = [
        "# General sensor definitions.",
        "sensor_type: camera",
        f"comment: {quoted(name)}",
        "",
        "# Sensor extrinsics wrt. the body-frame.",
        "T_BS:",
        "  cols: 4",
        "  rows: 4",
        f"  data: [{_listed(np.ravel(T_body_camera))}]",
        "",
        "# Camera specific definitions.",
        f"resolution: [{camera.image_size[0]}, {camera.image_size[1]}]",
        f"camera_model: {words.projection}",
        f"intrinsics: [{_listed(words.intrinsics)}]",
        f"distortion_model: {lens}",
        f"distortion_coefficients: [{_listed(words.coefficients)}]",
    ]
    return ("\n".join(lines) + "\n").encode()


def _listed(values: Any) -> str:
    return ", ".join(map(digits, values))


FORMAT = ExchangeFormat(
    name="euroc",
    title="EuRoC sensor.yaml, or a folder of camN/sensor.yaml",
    suffix="sensor.yaml",
    matches=_matches,
    read=_read,
    write=_write,
    models=MODELS,
    lacks=LACKS,
    asks=ASKS | {BODY: "the frame that is the body, where none is called imu…"},
)
