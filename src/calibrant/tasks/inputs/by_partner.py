"""Parts of chessboards that one camera sees, numbered by another camera's view of the same moment."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calibrant.cancel import checkpoint

if TYPE_CHECKING:
    from calibrant.arrays import Array
    from calibrant.data import CalibrationResult, Observations, View
    from calibrant.detection.chessboard.second_look import Expected
    from calibrant.targets.chessboard import Chessboard
    from calibrant.tasks.inputs.sources import Source

LEAST = 12
"""Corners that must be expected in an image for it to be searched: fewer are no board."""

NUMBERED = "A part of the board is seen, numbered by another camera's view of the same moment"


def partner_notes(seen: Iterable[Observations]) -> tuple[str, ...]:
    """What `numbered_by_partners` said of these observations."""
    return tuple(dict.fromkeys(note for one in seen for note in one.notes if note.startswith(NUMBERED)))


@dataclass(frozen=True, eq=False)
class _Hidden:
    """An image of a camera that has no view of the board, and where the board is expected in it."""

    camera: str
    moment: str
    there: Expected


def numbered_by_partners(
    found: Observations,
    result: CalibrationResult,
    *,
    sources: Mapping[str, Source],
    moments: Mapping[str, Mapping[Path, str]],
) -> Observations:
    """What the cameras saw of a chessboard, with the parts that only another camera's view of the moment numbers.

    result: where the cameras stand, from the others of these views; sources, moments: by camera, how its images were
    searched and what moment each is of. Itself where no more is found, and for other boards.
    """
    from calibrant.targets.chessboard import Chessboard
    from calibrant.targets.registry import parse_target

    more: list[View] = []
    for camera, source in sources.items():
        target = parse_target(source.target or "")
        if camera in found.image_sizes and isinstance(target, Chessboard):
            more += _seen_again(found, source, target, _hidden(found, result, camera, moments[camera], target))
    if not more:
        return found
    files = {(v.camera, v.file) for v in more}
    missed = tuple(m for m in found.missed if (m.camera, m.file) not in files)
    names = ", ".join(v.id for v in more[:4]) + (f" … ({len(more)})" if len(more) > 4 else "")
    note = f"{NUMBERED}: {names}."
    return replace(found, views=(*found.views, *more), missed=missed, notes=(*found.notes, note))


def _hidden(
    found: Observations, result: CalibrationResult, camera: str, moments: Mapping[Path, str], target: Chessboard
) -> list[_Hidden]:
    from calibrant.detection.chessboard.second_look import Expected

    mine = {v.moment for v in found.views if v.camera == camera}
    others: dict[str, View] = {}
    for view in found.views:
        if view.camera != camera and view.moment not in mine and len(view) > len(others.get(view.moment, ())):
            others[view.moment] = view
    width, height = found.image_sizes[camera]
    out = []
    for file, moment in moments.items():
        if moment not in others:
            continue
        ways = _expected(result, others[moment], camera, target)
        with np.errstate(invalid="ignore"):
            inside = np.all((ways >= 0) & (ways <= [width - 1, height - 1]), axis=2)
        if inside.sum(axis=1).max() >= LEAST:
            out.append(_Hidden(camera, moment, Expected(file, ways)))
    return out


def _expected(result: CalibrationResult, seen: View, camera: str, target: Chessboard) -> Array:
    """Where a camera sees the board (2, n, 2), px, by another camera's view of it, and by the second pose of that."""
    from calibrant.calibrate.pose.target_poses import target_poses
    from calibrant.geometry import se3

    found = target_poses(result.cameras[seen.camera], [seen])
    T = _between(result, camera, seen.camera)
    points = [se3.apply(T @ pose[0], target.points) for pose in (found.T_camera_target, found.doubles)]
    uv = [np.where(p[:, 2:] > 0, result.cameras[camera].project(p), np.nan) for p in points]
    return np.stack(uv)


def _between(result: CalibrationResult, a: str, b: str) -> Array:
    """T_a_b of two cameras, whichever of them the result places in the other."""
    from calibrant.geometry import se3

    told = {(t.parent, t.child): t.matrix for t in result.transforms}
    return told[a, b] if (a, b) in told else se3.inverse(told[b, a])


def _seen_again(found: Observations, source: Source, target: Chessboard, hidden: list[_Hidden]) -> list[View]:
    """The views of what is seen there."""
    from calibrant.data import View
    from calibrant.detection.chessboard.second_look import look_there
    from calibrant.detection.subpixel.refinement import DEFAULT
    from calibrant.executors import executor_for, in_order

    how = source.refinement or DEFAULT
    search = partial(look_there, target=target, mirror_x=source.search.mirror_x, refinement=how)
    parts = [[h.there] for h in hidden]
    names = {m.file: m.id for m in found.missed if m.file is not None}
    views = []
    with executor_for(source.search.workers, len(parts)) as executor:
        again = (d for p in parts for d in search(p)) if executor is None else in_order(executor, search, parts)
        for h, seen in zip(hidden, again, strict=True):
            checkpoint()
            if seen is None:
                continue
            file, ids = str(h.there.file), seen.point_ids
            name, points = names.get(file, h.there.file.name), target.points[ids]
            view = View(name, points, seen.uv, ids, h.camera, h.moment, seen.sigma_px, file)
            views.append(replace(view, covariance_px=seen.covariance_px))
    return views
