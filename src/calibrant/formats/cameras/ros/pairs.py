"""Cameras of several camera_info: two that were rectified together are a pair.

    p_rectified = R_left p_left,    p_rectified + t = R_right p_right,    t = K_P^-1 P[:, 3] = (-baseline, 0, 0)
    T_left_right = [R_left^T R_right, -R_left^T t]

for pictures beside each other; Ty in P stands for cameras above each other. Both P have one fx and fy. Written are the
turns of our own rectification (`geometry.rectifying`) and a P of both with the shorter of the focal lengths, whose
principal point puts what the middles of both pictures show into the middle on average.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera
from calibrant.data import CalibrationResult, as_transform
from calibrant.errors import InputError
from calibrant.formats.cameras.ros.camera_info import Info, Rectified, note_rectified
from calibrant.formats.exchange.exchange_format import ReadOptions, read_cameras
from calibrant.formats.exchange.places import graph_of
from calibrant.geometry import se3
from calibrant.geometry.rectifying import rectifying_turns
from calibrant.reading.notes import note

_ALIKE = 1e-6
"""Digits that files give the focal lengths of a pair."""


def cameras_of(infos: Sequence[Info], fallback: Sequence[str], options: ReadOptions, source: str) -> CalibrationResult:
    """The cameras, and where they are to each other where two were rectified together.

    Args: fallback: names in place of the infos' own, where two of these are alike.
    """
    names = [info.name for info in infos]
    names = list(fallback) if len(set(names)) < len(names) else names
    cameras = {name: info.camera for name, info in zip(names, infos)}
    if len(infos) == 2 and sum(info.stands_aside for info in infos) == 1:
        left, right = sorted((0, 1), key=lambda i: infos[i].stands_aside)
        place = _T_left_right(infos[left], infos[right])
        if place is not None:
            return read_cameras(cameras, transforms=(as_transform(names[left], names[right], place),))
    for name, info in zip(names, infos):
        note_rectified(info, f"{source}: {name}")
    if len(infos) > 1 and options.places:
        note(f"{source}: the files do not say where their {len(infos)} cameras are to each other")
    return read_cameras(cameras)


def _T_left_right(left: Info, right: Info) -> Array | None:
    """(4, 4); None where one of them says nothing. Raises: InputError where they were not rectified together."""
    if left.rectified is None or right.rectified is None:
        return None
    f, other = (np.diag(rectified.P)[:2] for rectified in (left.rectified, right.rectified))
    if not np.allclose(f, other, rtol=_ALIKE):
        raise InputError(
            f"the projection matrices of {left.name} and {right.name} have focal lengths {f.tolist()} and "
            f"{other.tolist()} px, which those of a rectified pair share; are the files of one calibration?"
        )
    R = left.rectified.R_rectified_camera.T
    return se3.make(R @ right.rectified.R_rectified_camera, -R @ right.rectified.t)


def infos_to_write(result: CalibrationResult) -> tuple[Info, Info]:
    """The two cameras of a result, rectified together. Raises: InputError where there are not two, or one stands before
    the other."""
    if len(result.cameras) != 2:
        listed = ", ".join(result.cameras) or "none"
        raise InputError(f"a pair has two cameras, there are {len(result.cameras)} ({listed})")
    first, second = result.cameras
    place = graph_of(result).T(first, second)
    if rectifying_turns(place, names=(first, second)).baseline < 0:
        first, second, place = second, first, se3.inverse(place)
    R, along, baseline = rectifying_turns(place, names=(first, second))
    cameras = (result.cameras[first], result.cameras[second])
    P = _projection(cameras, R)
    aside = P.copy()
    aside[along, 3] = -P[along, along] * baseline
    return Info(first, cameras[0], Rectified(R[0], P)), Info(second, cameras[1], Rectified(R[1], aside))


def _projection(cameras: tuple[Camera, Camera], R: Array) -> Array:
    """P (3, 4) of the left one, in pictures of the size of its own."""
    middles = [np.array([(n - 1) / 2 for n in camera.image_size]) for camera in cameras]
    rays = [turn @ camera.unproject(uv) for turn, camera, uv in zip(R, cameras, middles)]
    if any(not ray[2] > 0 for ray in rays):
        raise InputError("the middle of a picture lies beyond what a rectified picture shows; this pair has none")
    f = min(float(value) for camera in cameras for value in np.diag(camera.K)[:2])
    cx, cy = middles[0] - f * np.mean([ray[:2] / ray[2] for ray in rays], axis=0)
    return np.array([[f, 0, cx, 0], [0, f, cy, 0], [0, 0, 1, 0]])
