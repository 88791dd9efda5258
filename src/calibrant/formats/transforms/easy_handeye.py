"""Calibration files of easy_handeye (ROS 1, YAML) and easy_handeye2 (ROS 2, .calib): read and written.

    easy_handeye    parameters: {eye_on_hand, robot_base_frame, …}, transformation: {x, y, z, qx, qy, qz, qw}
    easy_handeye2   parameters: {calibration_type, robot_base_frame, …}, transform: {translation, rotation}

The transform is the camera's pose, T_effector_camera where the camera is in the hand, else T_base_camera, the camera's
frame being tracking_base_frame; metres. The first easy_handeye has no group `parameters`.
Sources: IFL-CAMP/easy_handeye, easy_handeye/src/easy_handeye/handeye_calibration.py; marcoesposito1988/easy_handeye2.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from calibrant.arrays import Array
from calibrant.data import CalibrationResult
from calibrant.errors import InputError
from calibrant.formats.documents.document import Document
from calibrant.formats.exchange.exchange_format import ExchangeFormat, ReadOptions, WriteOptions, answer
from calibrant.formats.exchange.rotation_numbers import finite, pose_of
from calibrant.formats.transforms.one import ASKS, Placed, as_result, the_transform
from calibrant.reading.notes import note_unused

_IN_HAND = ("eye_in_hand", "eye_on_hand", "eye-in-hand")
_ON_BASE = ("eye_on_base", "eye_to_hand", "eye-on-base")
_SETUPS = ("eye-in-hand", "eye-on-base")
_FRAMES = {
    "parent": ("robot_effector_frame", "tool_frame"),
    "base": ("robot_base_frame", "base_link_frame"),
    "child": ("tracking_base_frame", "optical_origin_frame"),
}
_KNOWN = (
    *("name", "namespace", "calibration_type", "eye_on_hand", "eye_in_hand", "tracking_marker_frame"),
    *("freehand_robot_movement", "move_group", "move_group_namespace"),
)


def _matches(document: Document) -> bool:
    data = document.mapping
    inner = data.get("parameters", data)
    return (
        isinstance(inner, Mapping)
        and bool({"tracking_base_frame", "optical_origin_frame"} & set(inner))
        and bool({"transform", "transformation"} & set(data))
    )


def _read(document: Document, options: ReadOptions) -> CalibrationResult:
    data, source = document.mapping, str(document.path)
    said = data.get("parameters", data)
    in_hand = _is_in_hand(said, source)
    frames = {}
    for role, names in (("parent", _FRAMES["parent" if in_hand else "base"]), ("child", _FRAMES["child"])):
        frames[role] = next((str(said[name]) for name in names if said.get(name)), "")
        if not frames[role]:
            raise InputError(f"{source}: {names[0]} is missing, the {role} of the transform")
    T = _pose(data, source)
    used = {*_KNOWN, "parameters", "transform", "transformation", *(n for names in _FRAMES.values() for n in names)}
    note_unused(source, (str(key) for part in (data, said) for key in part if key not in used))
    return as_result([Placed(frames["parent"].lstrip("/"), frames["child"].lstrip("/"), T)], source)


def _is_in_hand(said: Mapping[Any, Any], source: str) -> bool:
    """Whether the camera moves with the hand. Raises: InputError where neither is said, or both."""
    kind = said.get("calibration_type")
    answers = {bool(said[key]) for key in ("eye_on_hand", "eye_in_hand") if isinstance(said.get(key), bool)}
    if kind is not None:
        if str(kind).lower() not in (*_IN_HAND, *_ON_BASE):
            raise InputError(f"{source}: calibration_type is {str(kind)[:40]!r}, expected eye_in_hand or eye_on_base")
        answers.add(str(kind).lower() in _IN_HAND)
    if len(answers) != 1:
        raise InputError(
            f"{source}: calibration_type (or eye_on_hand) must say whether the camera is in the hand; found "
            f"{'both answers' if answers else 'neither'}"
        )
    return answers.pop()


def _pose(data: Mapping[Any, Any], source: str) -> Array:
    flat = data.get("transformation")
    if flat is not None:
        if not isinstance(flat, Mapping):
            raise InputError(f"{source}: transformation is {str(flat)[:40]!r}, expected x y z qx qy qz qw")
        xyz = finite((flat.get(key) for key in "xyz"), 3, f"{source}: transformation x y z")
        xyzw = finite((flat.get(f"q{key}") for key in "xyzw"), 4, f"{source}: transformation qx qy qz qw")
        return pose_of(xyz, xyzw, source)
    found = data.get("transform")
    parts = [found.get(key) if isinstance(found, Mapping) else None for key in ("translation", "rotation")]
    if not all(isinstance(part, Mapping) for part in parts):
        raise InputError(f"{source}: transform has no translation and rotation by name")
    translation, rotation = parts
    xyz = finite((translation.get(key) for key in "xyz"), 3, f"{source}: translation x y z")  # type: ignore[union-attr]
    xyzw = finite((rotation.get(key) for key in "xyzw"), 4, f"{source}: rotation x y z w")  # type: ignore[union-attr]
    return pose_of(xyz, xyzw, source)


def _setup(result: CalibrationResult, one: Placed, said: str | None) -> str:
    """The setup that was asked for, that of the result's own cell, or by what the parent is called.

    Raises: InputError where none of them tells.
    """
    if said is not None:
        return said
    setups = {p.setup for p in result.cell.pictures} if result.cell is not None else set()
    asked = str(result.options.get("setup", ""))
    for name in (*setups, asked) if len(setups) < 2 else (asked,):
        if name in ("eye-in-hand", "eye-to-hand"):
            return "eye-in-hand" if name == "eye-in-hand" else "eye-on-base"
    by_name = {"gripper": "eye-in-hand", "base": "eye-on-base"}
    if one.parent in by_name:
        return by_name[one.parent]
    raise InputError(
        f"is {one.parent} -> {one.child} a camera in the hand or one on the base? Say --choose setup=eye-in-hand or "
        "setup=eye-on-base"
    )


def _values(result: CalibrationResult, options: WriteOptions) -> tuple[dict[str, str], bool, Placed]:
    """The four frames by their keys, whether the camera is in the hand, and the transform."""
    one, said = the_transform(result, options), options.answers
    in_hand = _setup(result, one, answer(said, "setup", _SETUPS)) == "eye-in-hand"
    # The other transform of a hand-eye result is the board's: in the base, or in the gripper.
    board = next((t for t in result.transforms if one.child not in (t.parent, t.child)), None)
    other = said.get("other", board.parent if board is not None else "base" if in_hand else "gripper")
    parent = said.get("parent", one.parent)
    frames = {
        "robot_base_frame": other if in_hand else parent,
        "robot_effector_frame": parent if in_hand else other,
        "tracking_base_frame": said.get("child", one.child),
        "tracking_marker_frame": said.get("marker", board.child if board is not None else "target"),
    }
    return frames, in_hand, one


_REST = {"freehand_robot_movement": True, "move_group_namespace": "/", "move_group": "manipulator"}


def _write_first(result: CalibrationResult, options: WriteOptions) -> bytes:
    frames, in_hand, one = _values(result, options)
    place = zip(("x", "y", "z", "qx", "qy", "qz", "qw"), [*one.xyz, *one.xyzw])
    values = {
        "parameters": {"eye_on_hand": in_hand, **_REST, "namespace": f"/{options.stem}/", **frames},
        "transformation": {key: float(value) + 0.0 for key, value in place},
    }
    return yaml.safe_dump(values, sort_keys=False).encode()


def _write_second(result: CalibrationResult, options: WriteOptions) -> bytes:
    frames, in_hand, one = _values(result, options)
    kind = "eye_in_hand" if in_hand else "eye_on_base"
    values = {
        "parameters": {"name": options.stem, "calibration_type": kind, **frames, **_REST},
        "transform": {
            "translation": {key: float(value) + 0.0 for key, value in zip("xyz", one.xyz)},
            "rotation": {key: float(value) + 0.0 for key, value in zip("xyzw", one.xyzw)},
        },
    }
    return yaml.safe_dump(values, sort_keys=False).encode()


_ASKS = {
    **{name: ASKS[name] for name in ("parent", "child")},
    "setup": " or ".join(_SETUPS),
    "other": "the robot frame that is not the parent: the base for a camera in the hand, else the effector",
    "marker": "the board's frame",
}
FORMAT = ExchangeFormat(
    name="easy-handeye",
    title="calibration of easy_handeye (YAML)",
    suffix=".yaml",
    matches=_matches,
    read=_read,
    write=_write_first,
    asks=_ASKS,
)
SECOND_FORMAT = ExchangeFormat(
    name="easy-handeye2",
    title="calibration of easy_handeye2 (.calib)",
    suffix=".calib",
    matches=lambda document: False,  # the first reads both
    write=_write_second,
    asks=_ASKS,
)
