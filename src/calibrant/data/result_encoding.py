"""A result as JSON: which key holds what, and how the text is laid out."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from math import isfinite
from pathlib import PurePath
from typing import Any

import numpy as np

from calibrant.cameras import Camera
from calibrant.data.details import DETAILS
from calibrant.data.observations import Observations
from calibrant.data.poses import RobotPoses
from calibrant.data.results import (
    CalibrationResult,
    Check,
    JointCovariance,
    MethodResult,
    TransformEstimate,
    ViewResult,
)
from calibrant.data.typed_json import Json, as_json
from calibrant.errors import InputError
from calibrant.version import __version__

FORMAT = "calibrant/2"


def encode(result: CalibrationResult) -> Json:
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return _present(
        {
            "format": FORMAT,
            "kind": result.kind,
            "version": result.version or __version__,
            "created": result.created or now,
            "verdict": result.verdict,
            "cameras": {name: _encode_camera(camera) for name, camera in result.cameras.items()} or None,
            "transforms": [_encode_transform(t) for t in result.transforms] or None,
            "joint_covariance": None if result.joint_covariance is None else _encode_joint(result.joint_covariance),
            "rms_px": result.rms_px,
            "sigma_px": result.sigma_px,
            "sigma_robot": None if result.sigma_robot is None else _present(vars(result.sigma_robot)),
            "target_scale": None if result.target_scale is None else as_json(result.target_scale),
            "figures": as_json(result.figures) or None,
            "decided": dict(result.decided) or None,
            "cell": None if result.cell is None else as_json(result.cell),
            "details": {_detail_name(d): as_json(d) for d in result.details} or None,
            "held_out": None if result.held_out is None else _present(vars(result.held_out)),
            "checks": [_encode_check(c) for c in result.checks] or None,
            "methods": {name: _encode_method(m) for name, m in result.methods.items()} or None,
            "views": [_encode_view(v) for v in result.views] or None,
            "options": result.options or None,
            "inputs": list(result.inputs) or None,
            "notes": list(result.notes) or None,
            "robot_poses": None if result.robot_poses is None else _encode_poses(result.robot_poses),
            "T_camera_target": result.T_camera_target,
            "observations": None if result.observations is None else _encode_observations(result.observations),
        }
    )


def _encode_joint(joint: JointCovariance) -> Json:
    return _present({**vars(joint), "cameras": list(joint.cameras) or None})


def _detail_name(record: object) -> str:
    """The key of a record. Raises: InputError for one that is not registered."""
    for name, kind in DETAILS.items():
        if type(record) is kind:
            return name
    raise InputError(f"a result keeps records of calibrant.data.details; got a {type(record).__name__}")


def _present(data: Mapping[str, Any]) -> Json:
    return {key: value for key, value in data.items() if value is not None}


def _encode_camera(camera: Camera) -> Json:
    known = camera.covariance is not None
    return _present(
        {
            "image_size": camera.image_size,
            "model": camera.model.name,
            "parameters": camera.parameters,
            "sigma": camera.sigma if known else None,
            "covariance": camera.covariance,
        }
    )


def _encode_transform(t: TransformEstimate) -> Json:
    return _present(
        {
            "parent": t.parent,
            "child": t.child,
            "matrix": t.matrix,
            "sigma_translation_mm": t.sigma_translation_mm,
            "sigma_rotation_deg": t.sigma_rotation_deg,
            "covariance": t.covariance,
        }
    )


def _encode_check(c: Check) -> Json:
    return _present({"name": c.name, "status": c.status, "value": c.value, "message": c.message})


def _encode_method(m: MethodResult) -> Json:
    return _present({**vars(m), "message": m.message or None})


def _encode_view(v: ViewResult) -> Json:
    out: Json = {"id": v.id, "used": v.used, "points": v.points, "rms_px": v.rms_px, "reason": v.reason}
    extra = {"camera": v.camera, "points_left_out": v.points_left_out or None, "T_camera_target": v.T_camera_target}
    return out | _present(extra | {"min_px": v.min_px, "max_px": v.max_px})


def _encode_poses(poses: RobotPoses) -> Json:
    return _present({"ids": poses.ids, "T_base_gripper": poses.T_base_gripper, "source": poses.source or None})


def _encode_observations(observations: Observations) -> Json:
    views = [
        _present(
            {
                "id": v.id,
                "camera": v.camera,
                "moment": v.moment if v.moment != v.id else None,
                "file": v.file,
                "point_ids": v.point_ids,
                "points": v.points,
                "uv": v.uv,
                "sigma_px": v.sigma_px,
                "carried": None if v.carried is None else vars(v.carried),
                "covariance_px": v.covariance_px,
            }
        )
        for v in observations.views
    ]
    return _present(
        {
            "target": observations.target,
            "image_sizes": observations.image_sizes,
            "views": views,
            "missed": [_present(vars(m)) for m in observations.missed] or None,
            "notes": observations.notes or None,
        }
    )


def format_json(value: Any, where: str = "result") -> str:
    """JSON with a line for each key and each record, and every array of numbers on one line.

    Raises: InputError naming the place of a number that is not finite, or of what JSON cannot hold.
    """
    try:
        return _lines(value, 0, {})
    except (TypeError, ValueError):
        # The encoder does not say where; only then is every value looked at by itself.
        _refuse_unfit(value, where)
        raise


def _lines(value: Any, depth: int, known: dict[tuple[Any, ...], str]) -> str:
    """`format_json` at a depth. known: the text of arrays; a board's points are the same in every view."""
    pad = "  " * (depth + 1)
    if isinstance(value, np.ndarray):
        key = (value.tobytes(), value.shape, value.dtype.str)
        text = known.get(key)
        if text is None:
            text = known[key] = _ENCODER.encode(value.tolist())
        return text
    if isinstance(value, Mapping) and value:
        lines = [f"{pad}{_ENCODER.encode(str(key))}: {_lines(item, depth + 1, known)}" for key, item in value.items()]
        return "{\n" + ",\n".join(lines) + "\n" + "  " * depth + "}"
    if isinstance(value, list | tuple) and any(isinstance(item, Mapping) for item in value):
        lines = [pad + _lines(item, depth + 1, known) for item in value]
        return "[\n" + ",\n".join(lines) + "\n" + "  " * depth + "]"
    # Most of a file's values: the encoder takes ten times as long to begin.
    if value is None or value is True or value is False:
        return _WORDS[value]
    if type(value) is int or (type(value) is float and isfinite(value)):
        return repr(value)
    return _ENCODER.encode(value)


_WORDS = {None: "null", True: "true", False: "false"}


def _in_own_types(value: Any) -> Any:
    """What JSON has a type for, of what it does not know itself. Raises: TypeError."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, PurePath):
        return str(value)
    raise TypeError(type(value).__name__)


_ENCODER = json.JSONEncoder(ensure_ascii=False, allow_nan=False, default=_in_own_types)


def _refuse_unfit(value: Any, where: str) -> None:
    """Raises: InputError naming the first place whose value JSON cannot hold."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        for key, item in value.items():
            _refuse_unfit(item, f"{where}.{key}")
    elif isinstance(value, list | tuple):
        for i, item in enumerate(value):
            _refuse_unfit(item, f"{where}[{i}]")
    elif isinstance(value, float) and not np.isfinite(value):
        raise InputError(f"{where} is {value}: a result file holds finite numbers only; nothing was written")
    elif not (value is None or isinstance(value, str | bool | int | float | PurePath)):
        raise InputError(f"{where} is a {type(value).__name__}, which JSON cannot hold; nothing was written")
