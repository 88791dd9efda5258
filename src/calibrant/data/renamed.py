"""A result whose frames and cameras are called otherwise: the only camera by a name of its own, or any of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace

from calibrant.data.observations import DEFAULT_CAMERA, Carried, View
from calibrant.data.results import CalibrationResult
from calibrant.errors import InputError

_NAME = re.compile(r"[A-Za-z][\w-]*")
_OF_A_LIST = ("camera", "robot", "target", "other")


def with_camera_name(result: CalibrationResult, name: str) -> CalibrationResult:
    """The result with `name` for its camera, where it is called "camera". Raises: InputError for a name that is taken
    by another frame."""
    taken = {frame for t in result.transforms for frame in (t.parent, t.child)} - {DEFAULT_CAMERA}
    if name in taken:
        raise InputError(f"the camera cannot be called {name}: a frame of the result has that name")
    return with_names(result, {DEFAULT_CAMERA: name})


def with_names(result: CalibrationResult, names: Mapping[str, str]) -> CalibrationResult:
    """The result with other names for its cameras, targets, robots and frames: new names by old ones."""

    def named(frame: str) -> str:
        return names.get(frame, frame)

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
            views=tuple(replace(v, camera=named(v.camera), carried=_carried(v, named)) for v in seen.views),
            image_sizes={named(c): size for c, size in seen.image_sizes.items()},
            missed=tuple(replace(m, camera=named(m.camera)) for m in seen.missed),
        ),
        cell=None
        if cell is None
        else replace(
            cell,
            pictures=tuple(replace(p, **{n: named(getattr(p, n)) for n in _OF_A_LIST}) for p in cell.pictures),
            sigma_px={named(n): v for n, v in cell.sigma_px.items()},
            sigma_robot={named(n): v for n, v in cell.sigma_robot.items()},
            sigma_joint_deg={named(n): v for n, v in cell.sigma_joint_deg.items()},
        ),
    )


def _carried(view: View, named: Callable[[str], str]) -> Carried | None:
    return None if view.carried is None else replace(view.carried, camera=named(view.carried.camera))


def check_camera_name(name: str) -> str:
    """The name. Raises: InputError for one that is no word."""
    if not _NAME.fullmatch(name):
        raise InputError(f"a camera's name is a word of letters, digits, _ and -, such as wrist; got {name!r}")
    return name
