"""What readers of camera files have in common: the camera of parameters that were read, and checks of what they say."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from calibrant.arrays import Array
from calibrant.cameras import Camera, camera_model
from calibrant.errors import InputError

Size = tuple[int, int]

_LENSES = ("pinhole", "brown", "rational", "thin_prism", "tilted")
"""OpenCV's perspective models, fewest terms first."""
COUNTS = (0, 1, 2, 4, 5, 8, 12, 14)
"""How many coefficients OpenCV's functions and ROS messages come with."""


_LARGEST = 1e15
"""Terms of high order are large where the field is narrow: k3 multiplies the sixth power of the field, 1e-12 at half a
degree. What is larger still overflows before it bends anything."""
MOST_PIXELS_A_SIDE = 1_000_000
"""A line-scan camera's pictures can be as long; no larger number is a size."""


def smallest_model(terms: Iterable[str], skew: float) -> str:
    """Name of the model with fewest terms that has all of `terms`. Raises: InputError where skew forbids it."""
    wanted = set(terms)
    if skew:
        for name in ("pinhole_skew", "unified"):
            if wanted <= set(camera_model(name).parameter_names):
                return name
        raise InputError(
            f"the camera matrix has skew {skew:g} together with {', '.join(sorted(wanted))}; models with skew have "
            "k1 k2 p1 p2 at most. OpenCV ignores skew: set it to 0 if the camera was calibrated there"
        )
    return next(name for name in _LENSES if wanted <= set(camera_model(name).parameter_names))


def matrix_parameters(K: Array) -> tuple[float, float, float, float, float]:
    """fx, fy, cx, cy, skew of a camera matrix. Raises: InputError for a matrix that is none."""
    if K.shape != (3, 3) or not np.all(np.isfinite(K)):
        raise InputError(f"the camera matrix is {K.tolist()}, expected 3x3 finite numbers")
    if np.abs(K[[1, 2, 2, 2], [0, 0, 1, 2]] - [0, 0, 0, 1]).max() > 1e-9:
        raise InputError(f"the camera matrix is {K.tolist()}, expected [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]")
    # A product of matrices leaves rounding where the zero was.
    skew = float(K[0, 1]) if abs(K[0, 1]) > 1e-9 * abs(K[0, 0]) else 0.0
    return float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), skew


def placed_camera(model: str, parameters: Mapping[str, float], found: Size | None, image_size: Size | None) -> Camera:
    """The camera of parameters read from a file, for images of the size found there, or else of the caller's.

    Raises: InputError when no size is known, both differ, or the principal point speaks against the size.
    """
    size = size_or_refuse(found, image_size)
    beyond = next((name for name, value in parameters.items() if not abs(value) < _LARGEST), None)
    if beyond is not None:
        raise InputError(f"{beyond} is {parameters[beyond]:g}, beyond any lens; correct the file")
    camera = Camera.create(model, parameters, image_size=size)
    # Lens shift, as projectors have it, moves the principal point out of the image, along one axis, by up to an image.
    # A size that is not in the file has nothing but the principal point to say that it is the camera's.
    room = 0.0 if found is None else 1.0
    outside = [max(-value / n, (value - n) / n) for value, n in zip((parameters["cx"], parameters["cy"]), size)]
    if max(outside) > room or min(outside) > 0:
        raise InputError(
            f"the principal point ({parameters['cx']:g}, {parameters['cy']:g}) px lies outside of images of "
            f"{size[0]}x{size[1]} px; expected a camera of images of this size. Is it the camera of larger images, or "
            "are width and height exchanged?"
        )
    return camera


def size_or_refuse(found: Size | None, image_size: Size | None) -> Size:
    """The image size of the file, or the caller's. Raises: InputError when neither is known, or both and different."""
    size = found or image_size
    if size is None:
        raise InputError("the file holds no image size; give it with the images, or image_size=(width, height)")
    if found is not None and image_size is not None and found != image_size:
        raise InputError(
            f"the camera is for images of {found[0]}x{found[1]} px, the images are {image_size[0]}x{image_size[1]} px; "
            "use the camera of these images"
        )
    return size


def whole_size(width: Any, height: Any) -> Size:
    """(width, height) in whole pixels. Raises: InputError."""
    try:
        size = int(width), int(height)
        if size != (float(width), float(height)):
            raise ValueError
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"the image size is {width!r} x {height!r}, expected two whole numbers") from error
    if not all(0 < n <= MOST_PIXELS_A_SIDE for n in size):
        raise InputError(f"the image size is {width} x {height}, expected 1 to {MOST_PIXELS_A_SIDE} pixels a side")
    return size


def numbers(value: Any, what: str) -> Array:
    """A flat array of numbers. Raises: InputError."""
    try:
        return np.asarray(value, dtype=np.float64).ravel()
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{what} is {str(value)[:80]!r}, expected numbers") from error


def single(fields: Mapping[str, Any], key: str) -> float:
    """The one number under a key. Raises: InputError where it is missing, a list, or no number."""
    values = numbers(fields.get(key, []), key)
    if len(values) != 1:
        raise InputError(f"{key} holds {len(values)} numbers, expected one")
    return float(values[0])
