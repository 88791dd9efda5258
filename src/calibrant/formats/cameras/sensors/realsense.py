"""Intel RealSense: intrinsics and extrinsics as JSON, as rs-enumerate-devices -c and pyrealsense2 print them.

    intrinsics: width height ppx ppy fx fy model coeffs = k1 k2 p1 p2 k3 (k1 to k4 of a Kannala-Brandt lens)
    X_to = R X_from + t, metres;  rs2_extrinsics.rotation is R column by column, what is printed R row by row

Sources: librealsense's rs.h types, src/rs.cpp (rs2_project_point_to_pixel) and tools/enumerate-devices. The program's
"inverse" model corrects pixels by its documentation, and is projected forward by its newer versions and by its ROS
wrapper: where its terms are not 0 the first is taken and said; `--answer inverse=forward` takes the other. The
modified model differs from Brown's in the tangential terms alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, TransformEstimate, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.camera_format import numbers, placed_camera, single, whole_size
from calibrant.formats.cameras.fields import spelled
from calibrant.formats.cameras.foreign_lens import ASKS, nearest_by_projection
from calibrant.formats.cameras.sensors.realsense_prints import Extrinsics, cameras_in_text, extrinsics_in_text, is_print
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, answer, read_cameras
from calibrant.formats.exchange.rotation_numbers import ROUNDED
from calibrant.geometry import se3
from calibrant.reading.notes import note, note_unused

_TERMS = ("k1", "k2", "p1", "p2", "k3")
_FISHEYE = ("k1", "k2", "k3", "k4")
_MODELS = {
    "brownconrady": "brown",
    "modifiedbrownconrady": "modified",
    "inversebrownconrady": "inverse",
    "kannalabrandt4": "fisheye",
    "none": "brown",
}
_GENERIC = {"intrinsics", "intrinsic", "streams", "cameras", "camera", "calibration", "intrinsicparameters"}
_PAIR = re.compile(r"^(?:extrinsics?_)?(\w+?)_(?:to|2)_(\w+?)(?:_extrinsics?)?$")
_TURN = re.compile(r"^(rotation|r)(matrix|rowmajor|matrixrowmajor|columnmajor)?$")
_SHIFT = re.compile(r"^(translation|t)(vector)?(m|mm|meters|metres|vectormeters)?$")
_DEEPEST = 6


def _model(values: Mapping[str, Any]) -> str | None:
    """Which of its models is named."""
    for key in ("model", "distortion_model", "distortion"):
        word = values.get(key)
        if isinstance(word, str):
            return _MODELS.get(spelled(word).removeprefix("rs2").removeprefix("distortion"))
    return None


def _is_lens(values: Any) -> bool:
    if not isinstance(values, Mapping) or not {"fx", "fy"} <= set(values):
        return False
    ours = {"ppx", "ppy"} <= set(values)
    return ours or ({"cx", "cy", "coeffs"} <= set(values) and _model(values) is not None)


def _lenses(data: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    if _is_lens(data):
        yield path, data
    elif isinstance(data, Mapping) and len(path) < _DEEPEST:
        for key, value in data.items():
            yield from _lenses(value, (*path, str(key)))


def _matches(document: Document) -> bool:
    if document.data is None:
        return document.text is not None and is_print(document.text)
    if is_print(document.text or ""):
        return True
    found = [lens for _, lens in _lenses(document.mapping)]
    # One camera alone is what named values are, unless its terms are librealsense's own.
    own = any("coeffs" in lens and _model(lens) in ("modified", "inverse") for lens in found)
    return own or len(found) > 1 or (bool(found) and _has_pair(document.mapping))


def _has_pair(data: Any, depth: int = 0) -> bool:
    if not isinstance(data, Mapping) or depth >= _DEEPEST:
        return False
    return any(
        (isinstance(v, Mapping) and _PAIR.match(str(key)) is not None) or _has_pair(v, depth + 1)
        for key, v in data.items()
    )


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    source = str(document.path)
    text = document.text or ""
    if is_print(text):
        lenses, pairs = cameras_in_text(text, options.image_size), extrinsics_in_text(text)
    else:
        lenses = {_name(path): lens for path, lens in _lenses(document.mapping)}
        pairs = list(_pairs(document.mapping, options, source)) if options.places else []
        note_unused(source, (key for key, value in document.mapping.items() if not _is_used(str(key), value)))
    if options.camera in lenses:
        lenses = {str(options.camera): lenses[str(options.camera)]}
    cameras = {name: _camera(name, lens, options, source) for name, lens in lenses.items()}
    if not options.places or options.camera in lenses:
        return read_cameras(cameras)
    return read_cameras(cameras, transforms=_tree(pairs, list(cameras)))


def _is_used(key: str, value: Any) -> bool:
    """Whether a key holds a lens or extrinsics, at any depth."""
    return next(_lenses({key: value}), None) is not None or _has_pair({key: value})


def _name(path: tuple[str, ...]) -> str:
    """Of a camera, from the keys above it: what they all say is left out."""
    kept = [re.sub(r"_(intrinsics?|params?)$", "", key) for key in path if spelled(key) not in _GENERIC]
    return "/".join(kept) or "camera"


def _camera(name: str, lens: Mapping[str, Any], options: ReadOptions, source: str) -> Camera:
    """Raises: InputError for a model or terms that are none of librealsense's."""
    model = (
        _model(lens)
        if any(isinstance(lens.get(k), str) for k in ("model", "distortion_model", "distortion"))
        else "brown"
    )
    if model is None:
        raise InputError(f"{name}: the model is none of librealsense's that are read: {', '.join(_MODELS)}")
    middle = ("ppx", "ppy") if "ppx" in lens else ("cx", "cy")
    plain = {ours: single(lens, key) for ours, key in zip(("fx", "fy", "cx", "cy"), ("fx", "fy", *middle))}
    size = whole_size(lens["width"], lens["height"]) if "width" in lens and "height" in lens else None
    coeffs = numbers(lens.get("coeffs", []), f"{name}: coeffs")
    if len(coeffs) not in (0, 4, 5) or not np.all(np.isfinite(coeffs)):
        raise InputError(f"{name}: coeffs holds {len(coeffs)} numbers, expected five finite ones")
    terms = {term: float(v) for term, v in zip(_FISHEYE if model == "fisheye" else _TERMS, coeffs)}
    if model == "fisheye":
        return placed_camera("kannala_brandt", plain | terms, size, options.image_size)
    if not any(terms.values()):
        return placed_camera("pinhole", plain, size, options.image_size)
    if model == "inverse":
        if answer(options.answers, "inverse", ("correction", "forward")) == "forward":
            model = "modified"
        else:
            if "inverse" not in options.answers:
                note(
                    f"{source}: {name} has the model inverse Brown-Conrady: its terms are read as the correction that "
                    "librealsense documents; ROS's wrapper takes them for OpenCV's: --answer inverse=forward"
                )
            return placed_camera("inverse_brown", plain | terms, size, options.image_size)
    if model == "modified" and (terms.get("p1") or terms.get("p2")):
        return _modified(name, plain, terms, size or options.image_size, options)
    return placed_camera("brown", plain | terms, size, options.image_size)


def _modified(
    name: str,
    plain: Mapping[str, float],
    terms: Mapping[str, float],
    size: tuple[int, int] | None,
    options: ReadOptions,
) -> Camera:
    """Tangential terms at the radially distorted point: nearly Brown's."""
    if size is None:
        raise InputError(f"{name}: no image size; give it with --image-size")
    k1, k2, p1, p2, k3 = (terms.get(term, 0.0) for term in _TERMS)

    def project(rays: Array) -> Array:
        x, y = rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2]
        r2 = x * x + y * y
        g = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        x, y = x * g, y * g
        u = x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        v = y + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)
        return np.stack([plain["fx"] * u + plain["cx"], plain["fy"] * v + plain["cy"]], axis=-1)

    start = {**plain, **terms}
    what = f"{name}: librealsense's modified Brown-Conrady with p1, p2"
    return nearest_by_projection(project, ("brown", "rational"), start, size, options.answers, what=what)


def _pairs(data: Any, options: ReadOptions, source: str, path: tuple[str, ...] = ()) -> Iterator[Extrinsics]:
    """Extrinsics under keys such as depth_to_color."""
    if not isinstance(data, Mapping) or len(path) >= _DEEPEST:
        return
    for key, value in data.items():
        pair = _PAIR.match(str(key))
        if pair is None or not isinstance(value, Mapping):
            yield from _pairs(value, options, source, (*path, str(key)))
            continue
        group = _name(tuple(k for k in path if spelled(k) != "extrinsics"))
        prefix = "" if group == "camera" else f"{group}/"
        yield Extrinsics(prefix + pair[1], prefix + pair[2], *_pose(str(key), value, options, source))


def _pose(name: str, value: Mapping[str, Any], options: ReadOptions, source: str) -> tuple[Array, Array]:
    """R and t of X_to = R X_from + t. Raises: InputError where they are not there."""
    turn = next((k for k in value if _TURN.match(spelled(k))), None)
    shift = next((k for k in value if _SHIFT.match(spelled(k))), None)
    if turn is None or shift is None:
        raise InputError(f"{name} holds {', '.join(map(str, value))}; expected rotation and translation")
    R, t = numbers(value[turn], f"{name}.{turn}"), numbers(value[shift], f"{name}.{shift}")
    if R.size != 9 or t.size != 3:
        raise InputError(f"{name} holds a rotation of {R.size} numbers and a translation of {t.size}, expected 9 and 3")
    flat = not (isinstance(value[turn], list) and value[turn] and isinstance(value[turn][0], list))
    order = answer(options.answers, "rotation", ("rows", "columns"))
    if order is None:
        word = spelled(turn)
        order = "columns" if "column" in word or (flat and "row" not in word) else "rows"
        if "row" not in word and "column" not in word:
            how = "a flat list, column by column as librealsense has it" if flat else "a matrix, row by row"
            note(f"{source}: {name}.{turn} is read as {how}; --answer rotation=rows or rotation=columns says it")
    millimetres = spelled(shift).endswith("mm") or str(value.get("translation_unit", "")).lower() == "mm"
    unit = options.unit_m or (1e-3 if millimetres else 1.0)
    return R.reshape(3, 3).T if order == "columns" else R.reshape(3, 3), unit * t


def _tree(pairs: list[Extrinsics], cameras: list[str]) -> tuple[TransformEstimate, ...]:
    """Transforms that place each frame once: a device prints every pair both ways."""
    found: list[TransformEstimate] = []
    group = {frame: frame for p in pairs for frame in (p.start, p.end)}
    named = {name.lower(): name for name in cameras}
    for p in pairs:
        if group[p.start] == group[p.end]:
            continue
        joined = group[p.end]
        group = {frame: group[p.start] if of == joined else of for frame, of in group.items()}
        T = se3.check(se3.make(p.R, p.t), name=f"{p.start} to {p.end}", tolerance=ROUNDED)
        parent, child = (named.get(frame.lower(), frame) for frame in (p.start, p.end))
        found.append(as_transform(parent, child, se3.inverse(T)))
    return tuple(found)


FORMAT = ExchangeFormat(
    name="realsense",
    title="Intel RealSense (JSON, or as its tools print it)",
    suffix=".json",
    matches=_matches,
    read=_read,
    asks={
        **ASKS,
        "rotation": "rows or columns: how the nine numbers of a rotation stand",
        "inverse": "correction or forward: what the terms of the model inverse Brown-Conrady do",
    },
)
