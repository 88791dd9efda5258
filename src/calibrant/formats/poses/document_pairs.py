"""Pairs of poses in a document: the robot's and the target's, by the names that calibration tools give them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from calibrant.formats.poses.document_fields import looks_like_pose, spelled
from calibrant.reading.notes import note, note_unused

_HAND = ("gripper", "hand", "tool", "flange", "tcp", "ee", "eef", "effector", "end", "wrist")
_BOARD = ("target", "board", "marker", "tag", "object", "pattern")
# Hand-eye samples as calibration tools save them: what they call the robot's pose, and the target's.
_ROBOT_KEYS = (
    "effectorwrtworld",
    "tbasegripper",
    *(f"{part}2base" for part in _HAND),
    "robot",
    "robotpose",
    "arm",
    "armpose",
    *(f"{part}pose" for part in _HAND),
)
_TARGET_KEYS = (
    "objectwrtsensor",
    "tcameratarget",
    *(f"{part}2{camera}" for part in _BOARD for camera in ("cam", "camera")),
    "optical",
    "tracking",
    "camera",
    "camerapose",
    "cam",
    "campose",
    "target",
    "marker",
    *(f"{part}pose" for part in _BOARD),
)
_TURNS, _MOVES = (
    ("r", "rot", "rotation", "rvec", "quat", "q"),
    ("t", "trans", "translation", "tvec", "pos", "position", "p"),
)
"""What stands before a stem such as gripper2base where rotation and translation have keys of their own."""
_FIRST_SECOND = (("t1", "t2"), ("h1", "h2"), ("a", "b"), ("pose1", "pose2"))
"""Names that say no more than that one is the first: the robot's, as in a pair without names."""
_INDEX = re.compile(r"^(?P<stem>.*\D|\D.*[_. -])(?P<index>\d{1,9})$")


class Pair(NamedTuple):
    """The two poses of an entry, and the keys of the entry that they were made of."""

    robot: Any
    target: Any
    keys: frozenset[str] = frozenset()


def pair_of(entry: Any) -> Pair | None:
    """The two poses of an entry that is a pair, robot first; None when it is not."""
    if isinstance(entry, list) and len(entry) == 2 and all(looks_like_pose(half) for half in entry):
        return Pair(entry[0], entry[1])
    if not isinstance(entry, Mapping):
        return None
    keys = {spelled(k): k for k in entry}
    halves = [_half(entry, keys, names) for names in (_ROBOT_KEYS, _TARGET_KEYS)]
    if halves[0] is not None and halves[1] is not None:
        return Pair(halves[0][0], halves[1][0], halves[0][1] | halves[1][1])
    return _solved_beside(entry, keys)


def numbered(data: Mapping[Any, Any], source: str) -> list[dict[str, Any]] | None:
    """Entries of a mapping such as gripper2base_0, target2cam_0, gripper2base_1 …: one a pair; None for others."""
    pairs: dict[str, dict[str, Any]] = {}
    others = []
    for key, value in data.items():
        match = _INDEX.match(str(key))
        stem = spelled(match["stem"]) if match else ""
        if match and stem and isinstance(value, Mapping | list):
            pairs.setdefault(match["index"], {})[stem] = value
        else:
            others.append(str(key))
    entries = list(pairs.values())
    if not entries:
        return None
    stems = {tuple(sorted(entry)) for entry in entries}
    for first, second in _FIRST_SECOND:
        if stems == {(first, second)} and all(looks_like_pose(half) for e in entries for half in e.values()):
            note(f"{source}: {first.upper()} is read as the robot's pose, {second.upper()} as the target's")
            entries = [{"robot": e[first], "target": e[second]} for e in entries]
    if any(pair_of(entry) is None for entry in entries):
        return None
    note_unused(source, others)
    return entries


def side_by_side(data: Mapping[Any, Any], source: str) -> list[dict[str, Any]] | None:
    """Entries of lists that stand side by side, such as robot_poses and cam_poses, or R_target2cam and its like."""
    lists = {str(k): v for k, v in data.items() if isinstance(v, list) and len(v) > 1 and _is_nested(v)}
    lengths = {len(v) for v in lists.values()}
    if len(lists) < 2 or len(lengths) != 1 or any(looks_like_pose(v) for v in lists.values()):
        return None
    entries = [{key: values[i] for key, values in lists.items()} for i in range(lengths.pop())]
    if all(pair_of(e) is not None for e in entries) or all(looks_like_pose(e) for e in entries):
        note_unused(source, (str(key) for key in data if str(key) not in lists))
        return entries
    return None


def _is_nested(values: list[Any]) -> bool:
    return all(isinstance(value, Mapping | list) for value in values)


def _half(
    entry: Mapping[Any, Any], keys: Mapping[str, Any], names: tuple[str, ...]
) -> tuple[Any, frozenset[str]] | None:
    """One side of a pair, under a key of its own, or a rotation and a translation under two."""
    for name in names:
        turn = next((keys[t + name] for t in _TURNS if t + name in keys), None)
        move = next((keys[m + name] for m in _MOVES if m + name in keys), None)
        if turn is not None and move is not None:
            kind = "rvec" if spelled(turn).startswith("rvec") else "rotation"
            # The translation's key says what the name says of the direction.
            half = {kind: entry[turn], f"t_{name}": _flat(entry[move])}
            if looks_like_pose(half):
                return half, frozenset((str(turn), str(move)))
        for key in _spelled(name):
            if key in keys:
                return {keys[key]: entry[keys[key]]}, frozenset((str(keys[key]),))
    return None


def _flat(value: Any) -> Any:
    return (
        [cell for row in value for cell in (row if isinstance(row, list) else [row])]
        if isinstance(value, list)
        else value
    )


def _spelled(name: str) -> tuple[str, ...]:
    """A key, and as people write it who begin the names of transforms with a letter, or name many."""
    return name, f"t{name}", f"h{name}", f"{name}s"


def _solved_beside(entry: Mapping[Any, Any], keys: Mapping[str, Any]) -> Pair | None:
    """A robot pose, and beside it the target's by the names of OpenCV's solvePnP, with or without more before them."""
    for key in keys:
        other = key.removesuffix("rvec") + "tvec"
        if key.endswith("rvec") and other in keys:
            solved = {"rvec": entry[keys[key]], "tvec": entry[keys[other]]}
            robot = {k: v for k, v in entry.items() if k not in (keys[key], keys[other])}
            if looks_like_pose(robot) and looks_like_pose(solved):
                return Pair(robot, solved, frozenset((str(keys[key]), str(keys[other]))))
            return None
    return None
