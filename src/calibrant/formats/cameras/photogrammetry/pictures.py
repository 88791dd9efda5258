"""Pictures with known places, as all programs of photogrammetry have them: a name, a camera, T_camera_world."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, TransformEstimate
from calibrant.data.results import ViewResult
from calibrant.errors import InputError
from calibrant.formats.exchange.exchange_format import ReadOptions, read_cameras
from calibrant.formats.exchange.places import places_in, world_of
from calibrant.geometry import se3
from calibrant.reading.notes import note

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
"""Between an optical frame (y down, z ahead) and one of OpenGL (y up, z behind)."""
_UNIT = 1e-3
"""How far the norm of a written quaternion may be from 1: three digits."""


@dataclass(frozen=True, eq=False)
class Picture:
    """name: of the file; camera: the name of its camera; T_camera_world (4, 4), metres."""

    name: str
    camera: str
    T_camera_world: Array


def result_of(
    cameras: Mapping[str, Camera],
    pictures: Sequence[Picture],
    options: ReadOptions,
    *,
    transforms: tuple[TransformEstimate, ...] = (),
) -> CalibrationResult:
    """What a reader returns: all cameras and their pictures, or the one asked for and its own.

    Raises: InputError for a camera that is not there, and for two pictures of one camera with the same name.
    """
    wanted = dict(cameras)
    if options.camera is not None:
        if options.camera not in cameras:
            raise InputError(f"cameras {', '.join(cameras)}, none of them {options.camera!r}")
        wanted, transforms = {options.camera: cameras[options.camera]}, ()
    kept = [p for p in pictures if p.camera in wanted]
    twice = next((name for name, count in Counter((p.camera, p.name) for p in kept).items() if count > 1), None)
    if twice is not None:
        raise InputError(f"two pictures are called {twice[1]!r}; give each a name of its own")
    views = tuple(ViewResult(p.name, True, 0, camera=p.camera, T_camera_target=p.T_camera_world) for p in kept)
    return read_cameras(wanted, transforms=transforms, views=views)


def pictures_of(result: CalibrationResult) -> tuple[Picture, ...]:
    """The result's views with known places or, where it has none, each camera at its place in their world.

    Raises: InputError for a view of a camera that is not there.
    """
    only = next(iter(result.cameras)) if len(result.cameras) == 1 else None
    found: list[Picture] = []
    for view in result.views:
        camera = only if view.camera is None else view.camera
        if view.T_camera_target is None or (camera is not None and camera not in result.cameras):
            continue
        if camera is None:
            raise InputError(f"the view {view.id} does not say which of {', '.join(result.cameras)} took it")
        found.append(Picture(view.id, camera, view.T_camera_target))
    if not found and result.transforms:
        places = places_in(result, world_of(result), tuple(result.cameras))
        found = [Picture(name, name, se3.inverse(T)) for name, T in places.items()]
    count = Counter(p.name for p in found)
    return tuple(
        p if count[p.name] == 1 else Picture(f"{p.camera}/{p.name}", p.camera, p.T_camera_world) for p in found
    )


def unit_of(options: ReadOptions, source: str) -> float:
    """Metres per unit: what was said, else 1, and said."""
    if options.unit_m is not None:
        return options.unit_m
    note(f"{source}: the file does not say the unit of its lengths; they are taken for metres: --unit says it")
    return 1.0


def check_quaternions(q: Array, names: Sequence[str]) -> None:
    """Raises: InputError naming the first picture whose quaternion (n, 4) is none of norm 1."""
    with np.errstate(all="ignore"):
        off = ~(np.abs(np.linalg.norm(q, axis=-1) - 1) <= _UNIT)
    if off.any():
        i = int(np.flatnonzero(off)[0])
        raise InputError(f"{names[i]}: the quaternion {q[i].tolist()} has norm {np.linalg.norm(q[i]):.4g}, expected 1")


def check_lengths(t: Array, names: Sequence[str]) -> None:
    """Raises: InputError naming the first picture whose place (n, 3) is not of finite numbers."""
    off = ~np.isfinite(t).all(axis=-1)
    if off.any():
        i = int(np.flatnonzero(off)[0])
        raise InputError(f"{names[i]}: its place is {t[i].tolist()}, expected finite numbers")
