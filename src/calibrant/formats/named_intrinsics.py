"""Intrinsics by name: fx, fy, cx, cy and, where given, k1, k2, p1, p2, k3; alone or under a key `intrinsics`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from calibrant.cameras import Camera
from calibrant.formats.camera_format import CameraFormat, Size, numbers, size_or_refuse, whole_size

_FOCAL = ("fx", "fy", "cx", "cy")
_TERMS = ("k1", "k2", "p1", "p2", "k3")


def _fields(data: Mapping[str, Any]) -> Mapping[str, Any]:
    inner = data.get("intrinsics")
    return inner if isinstance(inner, Mapping) else data


def _matches(data: Mapping[str, Any]) -> bool:
    fields = _fields(data)
    return all(key in fields for key in _FOCAL)


def _read(data: Mapping[str, Any], image_size: Size | None) -> Camera:
    fields = {**data, **_fields(data)}
    parameters = {key: float(numbers([fields[key]], key)[0]) for key in (*_FOCAL, *_TERMS) if key in fields}
    width, height = (fields.get(key, fields.get(f"image_{key}")) for key in ("width", "height"))
    size = whole_size(width, height) if width and height else None
    model = "brown" if any(key in parameters for key in _TERMS) else "pinhole"
    return Camera.create(model, parameters, image_size=size_or_refuse(size, image_size))


NAMED_INTRINSICS = CameraFormat("named intrinsics (fx, fy, cx, cy)", _matches, _read)
