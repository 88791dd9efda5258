"""The second look at ChArUco boards: once a camera is known, corners are searched where it puts them.

A wide lens bends a board more than its neighbouring corners foretell, so that the first look loses corners at the
picture's edge and between markers that cannot be read. Views whose missing corners the camera puts well inside the
image are searched again; no view ever loses corners by it.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from calibrant.cameras.camera import Camera
from calibrant.cancel import checkpoint
from calibrant.data import Observations, View
from calibrant.detection.charuco.by_camera import maps_from_camera
from calibrant.detection.charuco.corners import Corners
from calibrant.detection.charuco.detector import CharucoDetector
from calibrant.detection.detection import Detection
from calibrant.detection.images.images import load_grey
from calibrant.detection.subpixel.refinement import DEFAULT, Refinement
from calibrant.errors import InputError
from calibrant.executors import executor_for, in_order
from calibrant.opencv import cv2
from calibrant.targets.charuco import Charuco
from calibrant.targets.registry import parse_target

BORDER_PX = 5.0
"""Corners nearer to the image's edge than this are not measured, so that none is missed there."""


def look_again(
    observations: Observations,
    camera: Camera,
    *,
    workers: int | str | Executor | None = None,
    mirror_x: bool = False,
    refinement: Refinement = DEFAULT,
) -> Observations:
    """The observations with the corners that a known camera helps to find; themselves where there are none.

    Args: observations: of one camera, as `detect` gives them; camera: calibrated from them; the others as `detect`
    takes them.
    """
    target = parse_target(observations.target) if observations.target else None
    if not isinstance(target, Charuco):
        return observations
    todo = [i for i, view in enumerate(observations.views) if _misses_some(view, target, camera)]
    files = [Path(observations.views[i].file or "") for i in todo]
    views = list(observations.views)
    with executor_for(workers, len(todo)) as executor:
        search = partial(_search_again, target=target, camera=camera, mirror_x=mirror_x, refinement=refinement)
        parts = [[file] for file in files]
        results = (
            (one for part in parts for one in search(part)) if executor is None else in_order(executor, search, parts)
        )
        for i, found in zip(todo, results, strict=True):
            checkpoint()
            if found is not None and len(found.point_ids) > len(views[i]):
                views[i] = _with_points(views[i], found, target)
    gained = [len(new) - len(old) for new, old in zip(views, observations.views, strict=True)]
    if not any(gained):
        return observations
    note = (
        f"Looked at again with the camera known: {sum(gained)} more corners in {np.count_nonzero(gained)} of "
        f"{len(views)} images."
    )
    return replace(observations, views=tuple(views), notes=(*observations.notes, note))


def _search_again(
    files: Sequence[Path], *, target: Charuco, camera: Camera, mirror_x: bool, refinement: Refinement
) -> list[Detection | None]:
    """What some files show with the camera known: what is handed to a process at once."""
    return [_detect_again(file, target, camera, mirror_x, refinement) for file in files]


def _misses_some(view: View, target: Charuco, camera: Camera) -> bool:
    """Whether the camera puts a corner that was not found inside the image."""
    if view.file is None or len(view) == len(target.points):
        return False
    index = np.searchsorted(target.point_ids, view.point_ids)
    maps = maps_from_camera(Corners(index, view.uv, np.ones(len(index))), target, camera)
    if maps is None:
        return False
    high = np.array(camera.image_size) - 1.0 - BORDER_PX
    inside = np.asarray(((maps.centres > BORDER_PX) & (maps.centres < high)).all(axis=1))
    inside[index] = False
    return bool(inside.any())


def _detect_again(
    file: Path, target: Charuco, camera: Camera, mirror_x: bool, refinement: Refinement
) -> Detection | None:
    cv2.setNumThreads(1)
    try:
        grey = load_grey(file)
    except InputError:
        return None  # gone since the first look, whose points stay
    if mirror_x:
        grey = np.ascontiguousarray(grey[:, ::-1])
    return CharucoDetector(refinement).detect(grey, target, camera=camera)


def _with_points(view: View, found: Detection, target: Charuco) -> View:
    rows: Sequence[int] = np.searchsorted(target.point_ids, found.point_ids).tolist()
    return replace(
        view, points=target.points[rows], uv=found.uv, point_ids=found.point_ids,
        sigma_px=found.sigma_px, covariance_px=found.covariance_px,
    )  # fmt: skip
