"""What a camera file format is: a test of its data and a reader. One format a file; camera_files.py lists them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.cameras import Camera
from calibrant.errors import InputError

Array = NDArray[np.float64]
Size = tuple[int, int]

_BROWN = ("k1", "k2", "p1", "p2", "k3")


@dataclass(frozen=True)
class CameraFormat:
    """A format: `matches(data)` says whether a file's data look like it, `read(data, image_size)` makes the camera.

    image_size is (width, height) when the caller knows it, for formats that do not hold it.
    """

    name: str
    matches: Callable[[Mapping[str, Any]], bool]
    read: Callable[[Mapping[str, Any], Size | None], Camera]


def camera_from_opencv(K: Array, distortion: Sequence[float], image_size: Size, *, model: str | None = None) -> Camera:
    """Camera of a 3x3 matrix and coefficients in OpenCV's order; terms of other models are taken only when they are 0.

    Without coefficients, or with zeros alone, it is a pinhole. Raises: InputError for what no known model holds.
    """
    if K.shape != (3, 3) or not np.all(np.isfinite(K)):
        raise InputError(f"the camera matrix is {K.tolist()}, expected 3x3 finite numbers")
    if np.abs(K[[1, 2, 2, 2], [0, 0, 1, 2]] - [0, 0, 0, 1]).max() > 1e-9 or K[0, 0] <= 0 or K[1, 1] <= 0:
        raise InputError(f"the camera matrix is {K.tolist()}, expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    if abs(K[0, 1]) > 1e-9 * K[0, 0]:
        raise InputError(f"the camera matrix has skew {K[0, 1]:g}; the known models have none")
    terms = np.asarray(distortion, dtype=np.float64).ravel()
    if len(terms) not in (0, 1, 2, 4, 5, 8, 12, 14) or not np.all(np.isfinite(terms)):
        raise InputError(f"{len(terms)} distortion coefficients {terms.tolist()}; expected 4 or 5: k1 k2 p1 p2 [k3]")
    if np.any(terms[5:] != 0):
        raise InputError(
            f"{len(terms)} distortion coefficients with terms beyond k1 k2 p1 p2 k3; expected a model of five terms "
            "(brown)"
        )
    parameters = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
    chosen = model or ("brown" if np.any(terms != 0) else "pinhole")
    if chosen == "brown":
        parameters |= dict(zip(_BROWN, terms[:5]))
    return Camera.create(chosen, parameters, image_size=image_size)


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
    except (TypeError, ValueError) as error:
        raise InputError(f"the image size is {width!r} x {height!r}, expected two whole numbers") from error
    return size


def numbers(value: Any, what: str) -> Array:
    """A flat array of numbers. Raises: InputError."""
    try:
        return np.asarray(value, dtype=np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} is {value!r}, expected numbers") from error
