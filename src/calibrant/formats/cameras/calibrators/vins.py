"""VINS-Fusion's settings of a rig, with the camera files of CamOdoCal's that they name.

    X_body = body_T_camN X_camN        cam0_calib: "left.yaml", beside the settings
    t_imu = t_cam + td                 one for all cameras

The body is the IMU where there is one (`imu: 1`). Metres and seconds. Source: VINS-Fusion's config/ and
vins_estimator/src/estimator/parameters.cpp; its camera files are CamOdoCal's (`camodocal`).
"""

from __future__ import annotations

import re
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, TransformEstimate, as_transform
from calibrant.data.results import Measured
from calibrant.errors import InputError
from calibrant.formats.cameras.calibrators.camodocal import LACKS, WRITTEN, camodocal_camera, camodocal_text
from calibrant.formats.cameras.calibrators.kalibr import SHIFT
from calibrant.formats.cameras.calibrators.rigid import from_matrix
from calibrant.formats.cameras.camera_format import single
from calibrant.formats.cameras.foreign_lens import ASKS
from calibrant.formats.documents.document import Document
from calibrant.formats.documents.opencv_storage import yaml_text
from calibrant.formats.exchange.exchange_format import (
    ExchangeFormat,
    ReadOptions,
    WriteOptions,
    Written,
    read_cameras,
)
from calibrant.formats.exchange.places import IMU, imu_frame, places_in, world_of
from calibrant.reading.notes import note, note_unused

_FILE = re.compile(r"^cam(\d+)_calib$")
_POSE = re.compile(r"^body_T_cam(\d+)$")
_BODY = "body"
_USED = ("imu", "num_of_cam", "image_width", "image_height", "td")
_MOST_FILES = 40
"""Of a folder of settings that are looked into."""


def _numbers_of(keys: Any, pattern: re.Pattern[str]) -> set[int]:
    return {int(found[1]) for key in keys if (found := pattern.match(str(key)))}


def _is_rig(document: Document) -> bool:
    keys = document.mapping
    return bool(_numbers_of(keys, _FILE) | _numbers_of(keys, _POSE)) and "projection_parameters" not in keys


def _settings_of(folder: Document) -> list[Document]:
    """The settings in a folder that name cameras."""
    files = sorted(name for name in folder.names if name.endswith((".yaml", ".yml")))[:_MOST_FILES]
    found = [Document(folder.path / name) for name in files]
    return [file for file in found if "cam0_calib" in (file.text or "") and _is_rig(file)]


def _matches(document: Document) -> bool:
    return bool(_settings_of(document)) if document.is_folder else _is_rig(document)


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    if document.is_folder:
        found = _settings_of(document)
        if len(found) != 1:
            listed = ", ".join(file.path.name for file in found) or "none"
            raise InputError(f"settings of rigs in this folder: {listed}; give the one that is meant")
        return _read(found[0], options)
    data, source = document.mapping, str(document.path)
    named, placed = _numbers_of(data, _FILE), _numbers_of(data, _POSE)
    count = int(single(data, "num_of_cam")) if "num_of_cam" in data else len(named | placed)
    body = IMU if bool(data.get("imu", 1)) else _BODY
    cameras: dict[str, Camera] = {}
    places: list[TransformEstimate] = []
    for i in range(count):
        name = f"cam{i}"
        if i in named:
            camera = _beside(document, str(data[f"cam{i}_calib"]), name, options)
            cameras |= {} if camera is None else {name: camera}
        if i in placed:
            key = f"body_T_cam{i}"
            places.append(as_transform(body, name, from_matrix(data[key], key)))
    if not cameras and not places:
        raise InputError(f"num_of_cam is {count}, and there is no cam0_calib and no body_T_cam0")
    used = {f"{part}{i}{end}" for i in range(count) for part, end in (("cam", "_calib"), ("body_T_cam", ""))}
    note_unused(source, (str(key) for key in data if key not in used and key not in _USED))
    shift = Measured(single(data, "td"), unit="s") if body == IMU and "td" in data else None
    figures = {} if shift is None else {f"{SHIFT}{name}": shift for name in cameras}
    return read_cameras(cameras, transforms=tuple(places), figures=figures)


def _beside(document: Document, file: str, name: str, options: ReadOptions) -> Camera | None:
    """The camera file that the settings name, which lies beside them. None where it does not, which is said."""
    path = document.path.parent / PurePosixPath(file.replace("\\", "/")).name
    if not path.is_file():
        note(f"{document.path}: {name} is in {file[:80]}, which is not beside it: its place is read alone")
        return None
    try:
        return camodocal_camera(Document(path), options)
    except InputError as error:
        text = str(error)
        raise InputError(text if text.startswith(str(path)) else f"{path}: {text}") from error


def _write(result: CalibrationResult, options: WriteOptions) -> Written:
    """The settings' geometry, and a camera file each."""
    imu = imu_frame(result, options.answers.get("imu"))
    body = imu or world_of(result)
    places = places_in(result, body, tuple(result.cameras))
    sizes = {camera.image_size for camera in result.cameras.values()}
    if len(sizes) > 1:
        raise InputError(f"cameras of {len(sizes)} image sizes; VINS-Fusion has one image_width and image_height")
    shifts = {result.figures[f"{SHIFT}{name}"].value for name in result.cameras if f"{SHIFT}{name}" in result.figures}
    if len(shifts) > 1:
        raise InputError(f"time shifts of {', '.join(f'{s:g}' for s in sorted(shifts))} s; VINS-Fusion has one, td")
    width, height = next(iter(sizes))
    values: dict[str, Any] = {"imu": int(imu is not None), "num_of_cam": len(places)}
    values |= {f"cam{i}_calib": f"cam{i}.yaml" for i in range(len(places))}
    values |= {"image_width": width, "image_height": height, "estimate_extrinsic": 0}
    values |= {f"body_T_cam{i}": np.asarray(T) for i, T in enumerate(places.values())}
    values |= {"estimate_td": 0, "td": float(next(iter(shifts), 0.0))}
    note("what VINS-Fusion's settings hold beside cameras (topics, noise, its own options) is not written")
    cameras = {f"cam{i}.yaml": camodocal_text(name, camera) for i, (name, camera) in enumerate(result.cameras.items())}
    return {"rig.yaml": yaml_text(values).encode(), **cameras}


FORMAT = ExchangeFormat(
    name="vins",
    title="VINS-Fusion settings of a rig, with the camera files beside",
    suffix="",
    matches=_matches,
    read=_read,
    write=_write,
    models=tuple(WRITTEN),
    lacks=LACKS,
    asks=ASKS | {"imu": "the frame that is the IMU, where its name does not begin with imu"},
)
