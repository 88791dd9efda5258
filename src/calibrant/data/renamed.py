"""A result whose only camera gets a name of its own: the key under `cameras`, and its frame in every transform."""

from __future__ import annotations

import re
from dataclasses import replace

from calibrant.data.observations import DEFAULT_CAMERA
from calibrant.data.results import CalibrationResult
from calibrant.errors import InputError

_NAME = re.compile(r"[A-Za-z][\w-]*")


def with_camera_name(result: CalibrationResult, name: str) -> CalibrationResult:
    """The result with `name` for its camera, where it is called "camera". Raises: InputError for a name that is taken
    by another frame."""
    taken = {frame for t in result.transforms for frame in (t.parent, t.child)} - {DEFAULT_CAMERA}
    if name in taken:
        raise InputError(f"the camera cannot be called {name}: a frame of the result has that name")

    def named(frame: str) -> str:
        return name if frame == DEFAULT_CAMERA else frame

    joint, seen, cell = result.joint_covariance, result.observations, result.cell
    return replace(
        result,
        cameras={named(c): camera for c, camera in result.cameras.items()},
        transforms=tuple(replace(t, parent=named(t.parent), child=named(t.child)) for t in result.transforms),
        joint_covariance=None
        if joint is None
        else replace(
            joint,
            frames=tuple((named(a), named(b)) for a, b in joint.frames),
            cameras=tuple(named(c) for c in joint.cameras),
        ),
        views=tuple(v if v.camera is None else replace(v, camera=named(v.camera)) for v in result.views),
        observations=None
        if seen is None
        else replace(
            seen,
            views=tuple(replace(v, camera=named(v.camera)) for v in seen.views),
            image_sizes={named(c): size for c, size in seen.image_sizes.items()},
            missed=tuple(replace(m, camera=named(m.camera)) for m in seen.missed),
        ),
        cell=None
        if cell is None
        else replace(cell, pictures=tuple(replace(p, camera=named(p.camera)) for p in cell.pictures)),
    )


def check_camera_name(name: str) -> str:
    """The name. Raises: InputError for one that is no word."""
    if not _NAME.fullmatch(name):
        raise InputError(f"a camera's name is a word of letters, digits, _ and -, such as wrist; got {name!r}")
    return name
