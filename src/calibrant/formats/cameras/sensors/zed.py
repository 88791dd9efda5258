"""Stereolabs' ZED: the factory's SNxxxxx.conf, two cameras at each of its resolutions.

    [LEFT_CAM_HD] fx fy cx cy k1 k2 p1 p2 k3, [STEREO] Baseline TY TZ RX_HD CV_HD RZ_HD
    X_right = exp(RX, CV, RZ) X_left + (-Baseline, TY, TZ), millimetres and radians

Newer files have eight terms of the lens, in [LEFT_DISTO]: where all are there they are taken. Sources: Stereolabs'
zed-open-capture (examples' calibration.hpp) and its stereo calibration, which writes such files. --image-size or
--answer mode=HD says which resolution; where neither does the largest of the file is taken, and said.
"""

from __future__ import annotations

import configparser
import re
from collections.abc import Mapping

import numpy as np

from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import Size, placed_camera, smallest_model
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, answer, read_cameras
from calibrant.geometry import se3, so3
from calibrant.reading.notes import note, note_unused

_SIDES = ("left", "right")
_SIZES: Mapping[str, Size] = {
    "2K": (2208, 1242),
    "FHD": (1920, 1080),
    "FHD1200": (1920, 1200),
    "HD": (1280, 720),
    "SVGA": (960, 600),
    "VGA": (672, 376),
    "4K": (3840, 2160),
    "QHDPLUS": (3200, 1800),
}
_SECTION = re.compile(r"^\s*\[(?:LEFT|RIGHT)_CAM_(\w+)\]", re.MULTILINE | re.IGNORECASE)
_TERMS = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "s1", "s2", "s3", "s4")
_EIGHT = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")
_USED = {"fx", "fy", "cx", "cy", *_TERMS}
_METRES = 5.0
"""No ZED's cameras are five millimetres apart, and none five metres."""
_Values = Mapping[str, Mapping[str, str]]


def _matches(document: Document) -> bool:
    return document.text is not None and _SECTION.search(document.text) is not None


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    source, values = str(document.path), _sections(document.text or "")
    mode = _mode(values, options, source)
    note_unused(source, (name.upper() for name in values if _is_unused(name)))
    cameras = {side: _camera(values, side, mode, options) for side in _SIDES if f"{side}_cam_{mode.lower()}" in values}
    if not cameras:
        raise InputError(f"no camera at the resolution {mode}")
    if options.camera in cameras:
        cameras = {str(options.camera): cameras[str(options.camera)]}
    if not options.places or len(cameras) < 2:
        return read_cameras(cameras)
    if "stereo" not in values:
        note(f"{source}: no [STEREO]: where the cameras are to each other is not said")
        return read_cameras(cameras)
    T = se3.make(*_pose(values["stereo"], mode.lower(), options, source))
    return read_cameras(cameras, transforms=(as_transform(*_SIDES, se3.inverse(T)),))


def _is_unused(name: str) -> bool:
    return "_cam_" not in name and name != "stereo" and not name.endswith("_disto")


def _sections(text: str) -> _Values:
    """Keys and values in small letters, by section. Raises: InputError for what is no ini file."""
    parser = configparser.ConfigParser(interpolation=None, strict=False, inline_comment_prefixes=("#", ";"))
    try:
        parser.read_string(text)
    except configparser.Error as error:
        raise InputError(f"no file of sections and values ({str(error).splitlines()[0]})") from None
    return {name.lower(): dict(parser[name]) for name in parser.sections()}


def _mode(values: _Values, options: ReadOptions, source: str) -> str:
    """Which resolution is read. Raises: InputError where the one asked for is not there."""
    there = list(dict.fromkeys(n.rpartition("_cam_")[2].upper() for n in values if "_cam_" in n))
    known = [mode for mode in there if mode in _SIZES]
    if not known:
        raise InputError(f"resolutions {', '.join(there)}, none of them known; known are {', '.join(_SIZES)}")
    asked = answer(options.answers, "mode")
    if asked is not None:
        if asked.upper() not in known:
            raise InputError(f"mode={asked}: the file has {', '.join(known)}")
        return asked.upper()
    if options.image_size is not None:
        fitting = [mode for mode in known if _SIZES[mode] == options.image_size]
        if not fitting:
            listed = ", ".join(f"{mode} {_SIZES[mode][0]}x{_SIZES[mode][1]}" for mode in known)
            raise InputError(
                f"no pictures of {options.image_size[0]}x{options.image_size[1]} px; the file has {listed}"
            )
        return fitting[0]
    first = max(known, key=lambda mode: _SIZES[mode][0] * _SIZES[mode][1])
    if len(known) > 1:
        w, h = _SIZES[first]
        note(f"{source}: {first}, {w}x{h} px, of {', '.join(known)} is read; --image-size or --answer mode=… says it")
    return first


def _number(values: Mapping[str, str], key: str, default: float | None = None) -> float:
    text = values.get(key)
    if text is None and default is not None:
        return default
    try:
        value = float(text or "")
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"{key} is {text!r}, expected a number")
    return value


def _camera(values: _Values, side: str, mode: str, options: ReadOptions) -> Camera:
    own = values[f"{side}_cam_{mode.lower()}"]
    lens = own
    apart = values.get(f"{side}_disto", {})
    if not any(key in own for key in _TERMS) or all(key in apart for key in _EIGHT):
        lens = apart
    strange = [key for key in own if key not in _USED]
    if strange:
        raise InputError(f"[{side.upper()}_CAM_{mode}] holds {', '.join(strange)}, which is not known")
    terms = {name: value for name in _TERMS if (value := _number(lens, name, 0.0)) != 0}
    if "k4" in terms and not {"k5", "k6", "p1", "p2"} & set(terms):
        kind = answer(options.answers, "lens", ("fisheye", "rational"))
        if kind is None:
            raise InputError(
                f"[{side.upper()}_DISTO] holds k1 to k4 alone: a fisheye's, or the first of a rational model: say "
                "--answer lens=fisheye or lens=rational"
            )
        if kind == "fisheye":
            plain = {name: _number(own, name) for name in ("fx", "fy", "cx", "cy")}
            return placed_camera("kannala_brandt", plain | terms, _SIZES[mode], None)
    plain = {name: _number(own, name) for name in ("fx", "fy", "cx", "cy")}
    return placed_camera(smallest_model(terms, 0.0), plain | terms, _SIZES[mode], None)


def _pose(stereo: Mapping[str, str], mode: str, options: ReadOptions, source: str) -> tuple[np.ndarray, np.ndarray]:
    """R and t of T_right_left, metres."""
    baseline = _number(stereo, "baseline")
    if baseline <= 0:
        raise InputError(f"Baseline is {baseline:g}, expected above 0")
    unit = options.unit_m or (1.0 if baseline < _METRES else 1e-3)
    if unit == 1.0 and options.unit_m is None:
        note(f"{source}: a baseline of {baseline:g} can be metres alone, and is read so")
    turn = [_number(stereo, f"{key}_{mode}", _number(stereo, key, 0.0)) for key in ("rx", "cv", "rz")]
    t = np.array([-baseline, _number(stereo, "ty", 0.0), _number(stereo, "tz", 0.0)])
    return so3.exp(turn), unit * t


FORMAT = ExchangeFormat(
    name="zed",
    title="Stereolabs ZED calibration (.conf)",
    suffix=".conf",
    matches=_matches,
    read=_read,
    asks={
        "mode": f"which resolution is read: {', '.join(_SIZES)}",
        "lens": "fisheye or rational, where the terms k1 to k4 could be either's",
    },
)
