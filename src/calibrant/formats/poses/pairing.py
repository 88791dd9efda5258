"""Which robot pose belongs to which image: by name where names meet, else by order."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import PurePath, PureWindowsPath
from typing import Literal

from calibrant.errors import InputError
from calibrant.formats.poses.natural_order import natural_key
from calibrant.formats.poses.raw import RawPoses

_LISTED = 5
"""Names a message lists before it stops with an ellipsis."""
_MOST_EXCLUDED = 12
"""Names that an option to copy lists; more would be most of the set."""


@dataclass(frozen=True)
class Pairing:
    """Pairs of poses and views, and the rule that made them.

    pose_index and view_index (m,): positions of the pairs, in the views' order. unused_poses: names of poses left out.
    """

    rule: Literal["name", "order"]
    pose_index: tuple[int, ...]
    view_index: tuple[int, ...]
    unused_poses: tuple[str, ...]
    message: str


def match(pose_names: Sequence[str], view_names: Sequence[str]) -> Pairing:
    """Pair named poses with views; poses without names are for `match_by_order`.

    By name when any name of a pose is that of a view, with or without folder and extension, or when it is their folders
    that name them (0/image.png and 0/pose.json); poses without a view are left out. Names that are numbers meet by what
    they count, 07.png and 7. Else by order: poses as they stand, views in natural order.

    Raises: InputError when a view has no pose, when two share a name, when the numbers differ, when one side is empty.
    """
    if not pose_names or not view_names:
        _refuse_empty(len(pose_names), len(view_names))
    shared = []
    for key in _keys(pose_names, view_names):
        poses = {key(name): i for i, name in enumerate(pose_names)}
        views = {key(name): i for i, name in enumerate(view_names)}
        if poses.keys() & views.keys() - {""}:
            if len(poses) == len(pose_names) and len(views) == len(view_names):
                return _by_name(pose_names, view_names, poses, views)
            shared.append(key)
    if shared:
        _refuse_shared(pose_names, shared[0], "poses")
        _refuse_shared(view_names, shared[0], "images")
    return match_by_order(len(pose_names), view_names, pose_names=pose_names)


def match_raw(raw: RawPoses, view_names: Sequence[str]) -> Pairing:
    """Pair the poses of a file with views: by `match` when the file names them, else by `match_by_order`."""
    return match_by_order(len(raw), view_names) if raw.names is None else match(raw.names, view_names)


def match_kept(raw: RawPoses, view_names: Sequence[str], keep: Sequence[bool]) -> Pairing:
    """Pair with the views that are kept, of all that there are: the pose of a view that is left out goes with it, where
    poses have no names and there is one for each of all the views. Indices: of those kept. Raises: as `match`."""
    kept = [name for name, k in zip(view_names, keep) if k]
    if len(raw) != len(view_names) or len(kept) == len(view_names):
        return match_raw(raw, kept)
    try:
        every = match_raw(raw, view_names)
    except InputError:  # names that do not meet: what is left may
        return match_raw(raw, kept)
    if every.rule == "name":
        return match_raw(raw, kept)
    place = {v: i for i, v in enumerate(i for i, k in enumerate(keep) if k)}
    pairs = [(p, place[v]) for p, v in zip(every.pose_index, every.view_index) if v in place]
    left = len(raw) - len(pairs)
    message = f"{every.message}; {left} {'pose goes' if left == 1 else 'poses go'} with what --exclude leaves out"
    return Pairing("order", tuple(p for p, _ in pairs), tuple(v for _, v in pairs), (), message)


def match_by_order(poses: int, view_names: Sequence[str], *, pose_names: Sequence[str] | None = None) -> Pairing:
    """Pair the first pose with the first view, and so on; views in natural order. Raises: InputError as `match`."""
    if not poses or not view_names:
        _refuse_empty(poses, len(view_names))
    if poses != len(view_names):
        views = _first(sorted(view_names, key=natural_key))
        listed = f" ({_first(pose_names)})" if pose_names else ""
        reason = "no name of a pose is that of an image" if pose_names else "the poses have no names"
        raise InputError(
            f"{poses} poses{listed} and {len(view_names)} images ({views}): {reason}, "
            "so they are paired by order, and that needs as many of one as of the other; name the image in a column "
            "'image' of the poses, or leave out what has no partner (--exclude)"
        )
    order = sorted(range(len(view_names)), key=lambda i: natural_key(view_names[i]))
    pairs = sorted(zip(order, range(poses)))
    return Pairing(
        rule="order",
        pose_index=tuple(p for _, p in pairs),
        view_index=tuple(v for v, _ in pairs),
        unused_poses=(),
        message=f"{poses} poses and images paired by order, images in natural order (no names in common)",
    )


def _excluded(names: Sequence[str]) -> str:
    """Names as --exclude takes them, all of them where they can be read."""
    return shlex.join(names) if len(names) <= _MOST_EXCLUDED else f"and the names of all {len(names)}"


def _by_name(
    pose_names: Sequence[str], view_names: Sequence[str], poses: dict[str, int], views: dict[str, int]
) -> Pairing:
    alone = [view_names[i] for name, i in views.items() if name not in poses]
    if alone:
        cure = "add the pose, or leave the image out" if len(alone) == 1 else "add the poses, or leave the images out"
        raise InputError(
            f"{len(alone)} of {len(view_names)} images have no robot pose: {_first(alone)}; poses and images are "
            f"paired by name, and the poses are called {_first(pose_names)}; "
            f"{cure} with --exclude {_excluded(alone)}"
        )
    unused = tuple(pose_names[i] for name, i in poses.items() if name not in views)
    message = f"{len(views)} images paired with poses by name"
    if unused:
        message += f"; {len(unused)} poses have no image and are left out: {_first(unused)}"
    return Pairing("name", tuple(poses[name] for name in views), tuple(views.values()), unused, message)


def _keys(pose_names: Sequence[str], view_names: Sequence[str]) -> tuple[Callable[[str], str], ...]:
    """By what a name can meet another, the strictest first. Where all are numbers, no two of one side alike, the others
    would meet from 10 on alone, of 00 to 19 and 0 to 19."""
    sides = [[_stem(name) for name in names] for names in (pose_names, view_names)]
    counted = all(n.isascii() and n.isdigit() for side in sides for n in side)
    if counted and all(len({_number(n) for n in side}) == len(side) for side in sides):
        return (_number,)
    return _full, _stem, _folder


def _number(name: str) -> str:
    """The stem without leading zeros."""
    return _stem(name).lstrip("0") or "0"


def _full(name: str) -> str:
    return name


def _stem(name: str) -> str:
    """The name without folder (of either system) and without the extension of a file; "0.5" keeps its digits."""
    last = PureWindowsPath(name).name
    suffix = PurePath(last).suffix
    return last[: -len(suffix)] if suffix and not suffix[1:].isdigit() else last


def _folder(name: str) -> str:
    """The folders that stand before the name; empty where there are none."""
    return "/".join(PureWindowsPath(name).parts[:-1])


def _refuse_shared(names: Sequence[str], key: Callable[[str], str], what: str) -> None:
    seen: dict[str, str] = {}
    for name in names:
        short = key(name)
        if short in seen:
            raise InputError(f"two {what} are both called {short!r}: {seen[short]} and {name}; rename one")
        seen[short] = name


def _refuse_empty(poses: int, views: int) -> None:
    raise InputError(f"{poses} robot poses and {views} images: nothing to pair; expected at least one of each")


def _first(names: Sequence[str]) -> str:
    return ", ".join(names[:_LISTED]) + (" …" if len(names) > _LISTED else "")
