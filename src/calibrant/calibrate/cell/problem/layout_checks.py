"""What a cell's layout is asked before anything is computed: names, who carries what, targets moved by hand."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from calibrant.errors import InputError

if TYPE_CHECKING:
    from calibrant.calibrate.cell.problem.layout import Layout


def check_layout(layout: Layout) -> None:
    """Raises: InputError for names that do not fit each other, and cameras that would be fixed to two things."""
    _check_by_hand(layout)
    for p in layout.pictures:
        for robot in filter(None, (p.robot, p.other)):
            if robot not in layout.robots:
                raise InputError(
                    f"{p.words}: no poses of robot {robot!r}; there are poses of {', '.join(layout.robots)}"
                )
    for camera in layout.cameras:
        parents = {layout.fixed_to(p) for p in layout.pictures if p.camera == camera and not p.handheld}
        if len(parents) > 1:
            raise InputError(f"camera {camera!r} cannot be fixed to both {' and '.join(sorted(parents))}")
    for group in layout.by_hand:
        bodies = {layout.fixed_to(p): p for p in layout.pictures if p.camera in group and not p.handheld}
        if len(bodies) > 1:
            (one, p), (other, q) = list(bodies.items())[:2]
            raise InputError(
                f"cameras {p.camera!r}, fixed to {one}, and {q.camera!r}, fixed to {other}, see one handheld target: "
                "only cameras that stand still to each other are tied by it; give the target another name in the "
                "pictures of one of them"
            )
    _check_touches(layout)
    busy = {t.robot for t in layout.touches} | {r for p in layout.pictures for r in (p.robot, p.other)}
    idle = [r for r in layout.robots if r not in busy]
    if idle:
        raise InputError(f"no pictures belong to robot {idle[0]!r}; leave its poses out, or name its pictures")
    frames = {*map(layout.base, layout.robots), *map(layout.gripper, layout.robots), *layout.targets}
    clash = set(layout.cameras) & frames
    if clash:
        raise InputError(f"camera {sorted(clash)[0]!r} has the name of another frame; call it otherwise")
    places = [name for _, name in layout.positions]
    twice = [n for n in places if n in frames or n in layout.cameras or places.count(n) > 1]
    if twice:
        raise InputError(f"the tip or point {twice[0]!r} has the name of another frame; call it otherwise")


def _check_touches(layout: Layout) -> None:
    for t in layout.touches:
        if t.robot not in layout.robots:
            there = ", ".join(layout.robots)
            raise InputError(f"touches with {t.tool}: no poses of robot {t.robot!r}; there are {there or 'none'}")
        known = set(layout.robots[t.robot].ids)
        lost = [i for i in t.ids if i not in known]
        if lost:
            raise InputError(
                f"touches with {t.tool}: no pose of robot {t.robot!r} for {len(lost)} of {len(t.ids)}, the first is "
                f"{lost[0]!r}; the poses of touches belong to the robot's poses, under their own ids"
            )
        if t.target and not any(p.target == t.target and layout.stands(p) for p in layout.pictures):
            raise InputError(
                f"touches with {t.tool}: no pictures show target {t.target!r} standing still; touch a target that "
                "cameras see, or a point"
            )


def _check_by_hand(layout: Layout) -> None:
    by_hand = [p for p in layout.pictures if p.handheld]
    if layout.rig and len(by_hand) < len(layout.pictures):
        p = next(p for p in layout.pictures if not p.handheld)
        raise InputError(
            f"{p.words}: there are no robots; a cell without any has handheld targets alone; give the robot's poses, "
            "or the pictures as handheld"
        )
    _check_rigid(layout, {p.target for p in by_hand})
    if layout.reference and layout.reference not in layout.cameras:
        raise InputError(f"no camera {layout.reference!r} in the pictures; known: {', '.join(layout.cameras)}")


def _check_rigid(layout: Layout, handheld: Collection[str]) -> None:
    grouped = [name for group in layout.rigid for name in group]
    unknown = [name for name in grouped if name not in handheld]
    if unknown:
        raise InputError(
            f"no pictures of a handheld target {unknown[0]!r}, which is to be fixed to others; there are "
            f"{', '.join(sorted(handheld)) or 'none'}"
        )
    twice = [name for name in grouped if grouped.count(name) > 1]
    if twice or any(len(group) < 2 for group in layout.rigid):
        what = f"{twice[0]!r} is in two places" if twice else "there is a group of one"
        raise InputError(f"targets that are fixed to each other: {what}; name each once, two or more a group")
