"""Intrinsics by name: fx, fy, cx, cy and, where given, OpenCV's terms and skew; alone or under a key `intrinsics`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from calibrant.cameras import Camera
from calibrant.cameras.plane_distortion import TERMS
from calibrant.formats.cameras.camera_format import (
    CameraFormat,
    Size,
    placed_camera,
    single,
    smallest_model,
    whole_size,
)

_FOCAL = ("fx", "fy", "cx", "cy")


def _named_fields(data: Mapping[str, Any]) -> Mapping[str, Any]:
    inner = data.get("intrinsics")
    return inner if isinstance(inner, Mapping) else data


def _is_named(data: Mapping[str, Any]) -> bool:
    fields = _named_fields(data)
    return all(key in fields for key in _FOCAL)


def _named_camera(data: Mapping[str, Any], image_size: Size | None) -> Camera:
    fields = {**data, **_named_fields(data)}
    parameters = {key: single(fields, key) for key in (*_FOCAL, "skew", *TERMS) if key in fields}
    width, height = (fields.get(key, fields.get(f"image_{key}")) for key in ("width", "height"))
    found = whole_size(width, height) if width and height else None
    skew = parameters.get("skew", 0.0)
    if not skew:
        parameters.pop("skew", None)
    terms = [key for key in TERMS if key in parameters]
    return placed_camera(smallest_model(terms, skew), parameters, found, image_size)


NAMED_INTRINSICS = CameraFormat("named intrinsics (fx, fy, cx, cy)", _is_named, _named_camera)
