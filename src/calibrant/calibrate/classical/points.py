"""Points of a target with their pixels, checked once for all classical methods, and what a method gives back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from calibrant.arrays import Array
from calibrant.calibrate.classical.refusals import COLLINEAR, TOO_FEW, Degenerate
from calibrant.cameras import Camera
from calibrant.errors import InputError

FLAT = 1e-6
"""Thickness over length of a point set below which it has none: no target is made to a millionth of its size."""


@dataclass(frozen=True, eq=False)
class ClassicalCalibration:
    """What a classical method finds: the camera, and T_camera_target (m, 4, 4), metres, of the m views it used.

    assumed: what the method takes as known and was not given, in words: an error in it goes into all that was found.
    """

    camera: Camera
    T_camera_target: Array
    assumed: tuple[str, ...] = ()


def checked_pairs(points: ArrayLike, uv: ArrayLike, *, least: int, method: str) -> tuple[Array, Array]:
    """Target points (n, 3) and pixels (n, 2) as float arrays.

    Raises: InputError for shapes that do not fit and values that are not finite; Degenerate for fewer than `least`
    points, or points on a line.
    """
    p, m = np.asarray(points, dtype=np.float64), np.asarray(uv, dtype=np.float64)
    if p.ndim != 2 or p.shape[1] != 3 or m.shape != (len(p), 2):
        raise InputError(
            f"{method} takes points (n, 3) in metres and their pixels (n, 2), got shapes {p.shape} and {m.shape}"
        )
    for array, what in ((p, "point"), (m, "pixel")):
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
        if len(bad):
            raise InputError(f"{what} {bad[0]} is {array[bad[0]].tolist()}, not finite; leave such points out")
    if len(p) < least:
        raise Degenerate(TOO_FEW, f"{method} needs at least {least} points, got {len(p)}")
    if dimension(p) < 2:
        raise Degenerate(
            COLLINEAR, f"all {len(p)} points lie on a line, which shows no camera; {method} needs points spread out"
        )
    return p, m


def dimension(points: Array) -> int:
    """How many directions the points (n, 3) spread in: 1 on a line, 2 in a plane, 3 in space."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return int(np.sum(spread > FLAT * spread[0]))


def image_centre(image_size: tuple[int, int], centre: ArrayLike | None) -> Array:
    """The principal point (C_x, C_y) that is taken as known: `centre` (2,) px, else the middle of the image.

    Raises: InputError for one that is not two finite numbers, or an image of no size.
    """
    width, height = image_size
    if width < 1 or height < 1:
        raise InputError(f"image_size is (width, height) in pixels, both at least 1, got {image_size}")
    if centre is None:
        return (np.array([width, height], dtype=np.float64) - 1) / 2
    given = np.asarray(centre, dtype=np.float64)
    if given.shape != (2,) or not np.all(np.isfinite(given)):
        raise InputError(f"the principal point is two numbers (C_x, C_y) in pixels, got {centre!r}")
    if not (-0.5 <= given[0] <= width - 0.5 and -0.5 <= given[1] <= height - 0.5):
        raise InputError(
            f"the principal point ({given[0]:g}, {given[1]:g}) px lies outside the image of {width} x {height} px; "
            "are both of the same camera, at the same resolution?"
        )
    return given


def assumed(
    middle: Array, centre: ArrayLike | None, *, aspect: float | None = None, takes_aspect: bool
) -> tuple[str, ...]:
    """What of principal point and aspect was not given, in words, for `ClassicalCalibration.assumed`.

    Args: middle (2,) px, what was taken for the principal point; takes_aspect, whether the method takes one as known.
    """
    at = (
        f"centre: ({middle[0]:g}, {middle[1]:g}) px, the image's middle, taken as the principal point: it was not given"
    )
    square = "aspect: 1, square pixels, taken as f_y / f_x: it was not given"
    return (*([at] if centre is None else []), *([square] if takes_aspect and aspect is None else []))


def checked_aspect(aspect: float | None) -> float:
    """mu = f_y / f_x (slide 48), 1 where it is not given. Raises: InputError unless it is positive."""
    if aspect is None:
        return 1.0
    if not (np.isfinite(aspect) and aspect > 0):
        raise InputError(f"aspect is f_y / f_x, a positive number, 1 for square pixels; got {aspect}")
    return float(aspect)
