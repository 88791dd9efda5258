"""Projectors in a cell: where they and their cameras begin, and which terms of theirs the views hardly tell.

A projector sees nothing: its points are carried from a camera's corners (`View.carried`), and few views tell neither
lens by itself. Both are found in the whole alone, terms of distortion held within what lenses can do
(`reprojection.weak_terms`). None is left out: sigma holds what a term can be where the views do not tell it, and what
that does to the others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from calibrant.calibrate.cell.lit.checks import untold
from calibrant.calibrate.cell.lit.start import projector_start
from calibrant.calibrate.cell.problem.layout import Pictures
from calibrant.calibrate.intrinsics.one_model import calibrate_keeping
from calibrant.calibrate.reprojection.weak_terms import corner_reach
from calibrant.cameras import Camera
from calibrant.data import View
from calibrant.errors import InputError, RefusedError

PLAIN_MODEL = "brown"
FIRST_FIX = (("k3", "tangential"), ("k2", "k3", "tangential"))
"""What a camera's first calibration leaves out, and what it does without where that is too much for the views."""

SAME_REACH = 0.1
"""Part of the corner's distance by which start and fit may differ: the prior of k3 changes by less than two."""
MOST_FITS = 3

Fixed = Mapping[str, tuple[str, ...]]
T = TypeVar("T")


def projectors(pictures: Sequence[Pictures]) -> dict[str, str]:
    """By projector, the camera whose corners its points were carried from.

    Raises: InputError for a camera whose views are carried in part, or from several cameras.
    """
    out: dict[str, str] = {}
    for name in dict.fromkeys(p.camera for p in pictures):
        views = [v for p in pictures if p.camera == name and p.seen is not None for v in p.seen.views]
        sources = {None if v.carried is None else v.carried.camera for v in views}
        if sources <= {None}:
            continue
        if len(sources) > 1:
            named = ", ".join(sorted(s for s in sources if s is not None))
            raise InputError(f"projector {name!r}: all its points are carried from one camera, these are from {named}")
        out[name] = next(s for s in sources if s is not None)
    return out


def lit_start(
    pictures: Sequence[Pictures],
    sources: Mapping[str, str],
    *,
    cameras: Mapping[str, Camera],
    initial: Mapping[str, Camera],
    models: Mapping[str, str],
    fixed: Fixed,
) -> dict[str, Camera]:
    """Where projectors and their cameras begin that are not known; cameras first.

    sources: by projector, its camera. Raises: InputError for a projector without views beside its camera's;
    RefusedError where the boards do not determine it.
    """
    known = {**initial, **cameras}
    seen = {c: known[c] if c in known else _first_camera(pictures, c, models.get(c, PLAIN_MODEL), fixed.get(c, ()))
            for c in dict.fromkeys(sources.values())}  # fmt: skip
    out = {c: camera for c, camera in seen.items() if c not in cameras}
    for projector, camera in sources.items():
        if projector in cameras:
            continue
        if projector in initial:
            out[projector] = initial[projector]
            continue
        of_camera, lit = _shared(pictures, projector, camera)
        sizes = [p.seen.image_sizes for p in pictures if p.camera == projector and p.seen is not None]
        size = next(iter(sizes[0].values()))
        out[projector] = projector_start(seen[camera], of_camera, lit, size)
    return out


def fit_told(
    attempt: Callable[[dict[str, Camera], Fixed], tuple[T, Mapping[str, Camera]]], start: Mapping[str, Camera]
) -> tuple[T, dict[str, tuple[str, ...]]]:
    """The fit, and by lens the terms that the prior holds more than the views do.

    What a term can be follows from the picture's corner in focal lengths (`weak_terms`). Where the start, which knows
    no distortion, has it elsewhere than the fit, the fit is the next start.
    """
    for _ in range(MOST_FITS):
        fit, lenses = attempt(dict(start), {})
        apart = [abs(corner_reach(lenses[name]) / corner_reach(lens) - 1) for name, lens in start.items()]
        if max(apart, default=0.0) < SAME_REACH:
            break
        start = {name: lenses[name] for name in start}
    return fit, {name: untold(lenses[name]) for name in start}


def _shared(pictures: Sequence[Pictures], projector: str, camera: str) -> tuple[tuple[View, ...], tuple[View, ...]]:
    """Views of camera and projector of the same moments, where both are fixed to one body."""
    of_camera: list[View] = []
    lit: list[View] = []
    for p in pictures:
        if p.camera != projector or p.seen is None:
            continue
        place = p.setup, p.robot, p.other, p.target
        beside = [q.seen for q in pictures if q.camera == camera and (q.setup, q.robot, q.other, q.target) == place]
        moments = {v.moment for v in p.seen.views}
        # Moments of two lists are two, whatever they are called.
        of_camera += [v for seen in beside[:1] if seen is not None for v in seen.views if v.moment in moments]
        lit += [v for seen in beside[:1] if seen is not None for v in p.seen.views]
        if of_camera:
            break
    if not of_camera:
        raise InputError(
            f"projector {projector!r}: no pictures of camera {camera!r}, whose corners its points were carried from, "
            "were taken in the same setup at the same moments; add them, or say where the projector's lens begins "
            "(initial)"
        )
    return tuple(of_camera), tuple(lit)


def _first_camera(pictures: Sequence[Pictures], name: str, kind: str, held: Sequence[str]) -> Camera:
    """The camera by its own views, with as many terms as they allow: the whole goes on from there."""
    lists = [p.seen for p in pictures if p.camera == name and p.seen is not None]
    if not lists:
        raise InputError(f"points are carried from camera {name!r}, which has no pictures; give its own as well")
    seen = lists[0]
    if len(lists) > 1:
        views = [replace(v, id=f"{k}/{v.id}") for k, part in enumerate(lists) for v in part.views]
        seen = replace(seen, views=tuple(views))
    if kind != PLAIN_MODEL:
        return calibrate_keeping(seen, model=kind, fix=held).result.camera
    *tried, last = FIRST_FIX
    for fix in tried:
        try:
            return calibrate_keeping(seen, fix=(*fix, *held)).result.camera
        except RefusedError:
            continue
    return calibrate_keeping(seen, fix=(*last, *held)).result.camera
