"""The arguments of static_transform_publisher, in ROS 1's and ROS 2's order, both ways.

    tf        x y z yaw pitch roll frame_id child_frame_id period_in_ms     or with qx qy qz qw for the angles
    tf2_ros   the same without the period
    ROS 2     --x --y --z --roll --pitch --yaw --qx --qy --qz --qw --frame-id --child-frame-id

The transform is the child's pose in the frame, T_frame_child: metres, radians, R = Rz(yaw) Ry(pitch) Rx(roll).
Sources: wiki.ros.org/tf (section static_transform_publisher), docs.ros.org tf2_ros "static_transform_publisher".
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from calibrant.errors import InputError
from calibrant.formats.documents.number_text import text_of
from calibrant.formats.exchange.rotation_numbers import finite, pose_of
from calibrant.formats.transforms.one import Placed
from calibrant.geometry import rotations, se3

PROGRAM = "static_transform_publisher"
PERIOD_MS = "100"
"""What tf's documentation takes: 10 Hz."""
_ANGLES = ("roll", "pitch", "yaw")
_QUATERNION = ("qx", "qy", "qz", "qw")
_FLAGS = ("x", "y", "z", *_ANGLES, *_QUATERNION, "frame-id", "child-frame-id")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def ros1_words(placed: Placed, *, euler: bool = False, period: str | None = PERIOD_MS) -> list[str]:
    """ROS 1's arguments: a quaternion, which has no second reading, or yaw pitch roll; no period for tf2_ros."""
    turn = placed.rpy[::-1] if euler else placed.xyzw
    return [*text_of([*placed.xyz, *turn]), placed.parent, placed.child, *([] if period is None else [period])]


def ros2_words(placed: Placed, *, euler: bool = False) -> list[str]:
    """ROS 2's arguments, each behind its name."""
    names, turn = (_ANGLES, placed.rpy) if euler else (_QUATERNION, placed.xyzw)
    numbers = zip(("x", "y", "z", *names), text_of([*placed.xyz, *turn]))
    ends = (("frame-id", placed.parent), ("child-frame-id", placed.child))
    return [word for name, value in (*numbers, *ends) for word in (f"--{name}", value)]


def placed_of(words: Sequence[str], where: str) -> Placed:
    """The transform of a publisher's arguments, of either ROS. Raises: InputError naming `where` and what is wrong."""
    plain = _without_ros_arguments(words)
    if any(word.lstrip("-").partition("=")[0] in _FLAGS and word.startswith("--") for word in plain):
        return _named(plain, where)
    return _in_order(plain, where)


def _without_ros_arguments(words: Sequence[str]) -> list[str]:
    """Without what is for ROS itself: name:=value, and all from --ros-args to --."""
    kept: list[str] = []
    inside = False
    for word in words:
        if word == "--ros-args":
            inside = True
        elif inside and word == "--":
            inside = False
        elif not inside and ":=" not in word:
            kept.append(word)
    return kept


def _named(words: Sequence[str], where: str) -> Placed:
    values: dict[str, str] = {}
    rest = list(words)
    while rest:
        name, equals, value = rest.pop(0).partition("=")
        key = name.removeprefix("--")
        if key not in _FLAGS or not name.startswith("--"):
            raise InputError(f"{where}: {name!r} is no argument of {PROGRAM}; it has --{', --'.join(_FLAGS)}")
        if not equals:
            if not rest:
                raise InputError(f"{where}: {name} has no value")
            value = rest.pop(0)
        values[key] = value
    missing = next((f"--{key}" for key in ("frame-id", "child-frame-id") if not values.get(key)), None)
    if missing is not None:
        raise InputError(f"{where}: {missing} is missing")
    both = [key for key in _ANGLES if key in values], [key for key in _QUATERNION if key in values]
    if all(both):
        raise InputError(f"{where}: --{both[0][0]} and --{both[1][0]}: angles or a quaternion, not both")
    xyz = finite((values.get(key, 0) for key in "xyz"), 3, f"{where}: x y z")
    if both[1]:
        xyzw = finite((values.get(key, float(key == "qw")) for key in _QUATERNION), 4, f"{where}: qx qy qz qw")
        T = pose_of(xyz, xyzw, where)
    else:
        rpy = finite((values.get(key, 0) for key in _ANGLES), 3, f"{where}: roll pitch yaw")
        T = se3.make(rotations.matrix_from_euler(rpy, order="xyz", unit="rad"), xyz)
    return Placed(values["frame-id"], values["child-frame-id"], T)


def _in_order(words: Sequence[str], where: str) -> Placed:
    count = next((i for i, word in enumerate(words) if not _NUMBER.fullmatch(word)), len(words))
    if count not in (6, 7) or len(words) not in (count + 2, count + 3):
        raise InputError(
            f"{where}: {PROGRAM} {' '.join(words)[:120]}: expected x y z, yaw pitch roll or qx qy qz qw, the frame, "
            "the child's frame, and in ROS 1 a period"
        )
    if len(words) > count + 2:
        finite([words[-1]], 1, f"{where}: the period")
    numbers = finite(words[:count], count, where)
    xyz, turn = numbers[:3], numbers[3:]
    if count == 7:
        T = pose_of(xyz, turn, where)
    else:
        T = se3.make(rotations.matrix_from_euler(np.asarray(turn), order="ZYX", unit="rad"), xyz)
    return Placed(words[count].lstrip("/"), words[count + 1].lstrip("/"), T)
