"""ROVIO's filter settings (.info) with cameras on the IMU, and camera files with a field-of-view lens.

    X_cam = R(qCM) (X_imu - MrMC)      qCM_x to qCM_w and MrMC_x to MrMC_z of CameraN, metres

qCM turns from the IMU to the camera, as Hamilton writes quaternions; files of before 2016 have it as JPL does, which is
its conjugate, and their comments say so. Without such a comment the file is asked for: --answer quaternion=hamilton or
jpl. CalibrationFile names a camera_info beside the file (`camera-info`; distortion_model fov has one term, w). Source:
ROVIO's cfg/rovio.info and include/rovio/Camera.hpp; Kalibr's kalibr_rovio_config.
"""

from __future__ import annotations

import re
from pathlib import PurePosixPath

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.calibrators.chain import fov_camera
from calibrant.formats.cameras.calibrators.rigid import from_quaternion, quoted
from calibrant.formats.cameras.camera_format import matrix_parameters, numbers, whole_size
from calibrant.formats.cameras.described import described_camera
from calibrant.formats.cameras.fields import Fields
from calibrant.formats.cameras.foreign_lens import ASKS
from calibrant.formats.documents.document import Document
from calibrant.formats.documents.number_text import digits
from calibrant.formats.exchange.exchange_format import (
    ExchangeFormat,
    ReadOptions,
    WriteOptions,
    Written,
    answer,
    read_cameras,
)
from calibrant.formats.exchange.places import IMU, imu_frame, places_in, world_of
from calibrant.geometry import se3, so3
from calibrant.reading.notes import note

_BLOCK = re.compile(r"^\s*Camera(\d+)\s*\{([^{}]{0,4000})\}", re.MULTILINE)
_VALUE = re.compile(r"^\s*(qCM_[xyzw]|MrMC_[xyz])\s+([^\s;]+)", re.MULTILINE)
_FILE = re.compile(r"^\s*CalibrationFile[ \t]+\"?([^\s;\"]+)", re.MULTILINE)
_KINDS = ("hamilton", "jpl")
_FOV, _SETTINGS = "fov", "rovio.info"


def _matches(document: Document) -> bool:
    if document.is_folder:
        return _SETTINGS in document.names
    if document.mapping.get("distortion_model") == _FOV:
        return "camera_matrix" in document.mapping
    return any("qCM_w" in block[2] for block in _BLOCK.finditer(document.text or ""))


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    if document.is_folder:
        return _read(Document(document.path / _SETTINGS), options)
    if "camera_matrix" in document.mapping:
        name = str(document.mapping.get("camera_name") or "camera")
        return read_cameras({name: _camera(document, options)})
    cameras, places = {}, []
    for block in _BLOCK.finditer(document.text or ""):
        name = f"cam{block[1]}"
        T_cam_imu = _pose(block[2], name, options)
        places.append(as_transform(IMU, name, se3.inverse(T_cam_imu)))
        found = _FILE.search(block[2])
        beside = None if found is None else document.path.parent / PurePosixPath(found[1].replace("\\", "/")).name
        if beside is not None and beside.is_file():
            cameras[name] = _camera(Document(beside), options)
        else:
            said = "names no CalibrationFile" if found is None else f"names {found[1][:80]}, which is not beside it"
            note(f"{document.path}: {name} {said}: its place is read alone")
    if not places:
        raise InputError("no CameraN with qCM and MrMC in it")
    return read_cameras(cameras, transforms=tuple(places))


def _pose(block: str, name: str, options: ReadOptions) -> Array:
    """T_cam_imu. Raises: InputError for missing numbers, or a quaternion of an unknown kind."""
    values = {key: numbers(value, f"{name}.{key}") for key, value in _VALUE.findall(block)}
    wanted = [*(f"qCM_{a}" for a in "xyzw"), *(f"MrMC_{a}" for a in "xyz")]
    missing = [key for key in wanted if key not in values]
    if missing:
        raise InputError(f"{name} has no {', '.join(missing)}")
    q, t = (np.array([float(values[key][0]) for key in keys]) for keys in (wanted[:4], wanted[4:]))
    kind = answer(options.answers, "quaternion", _KINDS)
    words = {kind for kind in _KINDS if kind in block.lower()} if kind is None else {kind}
    if len(words) != 1 and np.any(q[:3]):
        raise InputError(
            f"{name}: whether qCM is Hamilton's or JPL's quaternion (its conjugate) is not said: --answer "
            "quaternion=hamilton (ROVIO since 2016) or quaternion=jpl"
        )
    if words == {"jpl"}:
        q[:3] = -q[:3]
    R = from_quaternion(q, np.zeros(3), f"{name}.qCM")[:3, :3]
    return se3.make(R, -R @ t)


def _camera(document: Document, options: ReadOptions) -> Camera:
    data, source = document.mapping, str(document.path)
    if data.get("distortion_model") != _FOV:
        return described_camera(data, options.image_size, source)
    fields = Fields(data)
    K = numbers(fields.get("cameramatrix"), "camera_matrix")
    w = numbers(fields.get("distortioncoefficients"), "distortion_coefficients")
    if K.size != 9 or len(w) != 1 or not 0 < w[0] < np.pi:
        raise InputError(f"{source}: fov needs a camera_matrix of 9 numbers and one term between 0 and pi")
    fx, fy, cx, cy, _ = matrix_parameters(K.reshape(3, 3))
    size = options.image_size
    if "imagewidth" in fields and "imageheight" in fields:
        size = whole_size(fields.get("imagewidth"), fields.get("imageheight"))
    if size is None:
        raise InputError(f"{source}: no image_width and image_height; say --image-size")
    values = {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
    return fov_camera(values, float(w[0]), size=size, source=source, answers=options.answers)


def _write(result: CalibrationResult, options: WriteOptions) -> Written:
    places = places_in(result, imu_frame(result, options.answers.get("imu")) or world_of(result), tuple(result.cameras))
    files, blocks = {}, []
    for i, (name, camera) in enumerate(result.cameras.items()):
        file = f"rovio_cam{i}.yaml"
        files[file] = _yaml(name, camera)
        R, t = places[name][:3, :3].T, places[name][:3, 3]
        w, x, y, z = so3.quaternion_wxyz(R)
        lines = [f"    CalibrationFile {file};"]
        lines += [
            f"    qCM_{axis} {digits(v)};    IMU to camera quaternion (Hamilton)"
            for axis, v in zip("xyzw", (x, y, z, w))
        ]
        lines += [f"    MrMC_{axis} {digits(v)};    IMU to camera vector (in the IMU) [m]" for axis, v in zip("xyz", t)]
        blocks.append("\n".join([f"Camera{i}", "{", *lines, "}", ""]))
    return {_SETTINGS: "\n".join(blocks).encode(), **files}


def _yaml(name: str, camera: Camera) -> bytes:
    fisheye = camera.model.name == "kannala_brandt"
    terms = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
    K = ", ".join(digits(v) for v in camera.K.ravel())
    D = ", ".join(digits(camera.parameters.get(term, 0.0)) for term in terms)
    lines = [
        f"image_width: {camera.image_size[0]}",
        f"image_height: {camera.image_size[1]}",
        f"camera_name: {quoted(name)}",
        f"camera_matrix:\n  rows: 3\n  cols: 3\n  data: [{K}]",
        f"distortion_model: {'equidistant' if fisheye else 'plumb_bob'}",
        f"distortion_coefficients:\n  rows: 1\n  cols: {len(terms)}\n  data: [{D}]",
    ]
    return ("\n".join(lines) + "\n").encode()


FORMAT = ExchangeFormat(
    name="rovio",
    title="ROVIO filter settings (.info) with camera files beside, or a camera file with a fov lens",
    suffix="",
    matches=_matches,
    read=_read,
    write=_write,
    models=("pinhole", "brown", "kannala_brandt"),
    asks=ASKS
    | {
        "imu": "the frame that is the IMU, where its name does not begin with imu",
        "quaternion": f"whose quaternions qCM are: {' or '.join(_KINDS)}",
    },
)
