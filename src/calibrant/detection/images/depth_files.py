"""Depth pictures as files: 16-bit PNG or TIFF in millimetres, 32-bit TIFF and NumPy's arrays in metres."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.detection.images.files import expand
from calibrant.detection.images.images import load_image
from calibrant.errors import InputError
from calibrant.reading.files import PICTURE, read_bytes

MILLIMETRES = 1e-3


def read_depth(path: str | Path, *, unit: float | None = None) -> Array:
    """Depth (h, w), metres, NaN where the file has 0 or no number.

    unit: metres of a number of the file; by default whole numbers are millimetres, others metres. Raises: InputError
    for a file of colours, of 8 bits, or with other objects in it.
    """
    given = _array(Path(path)) if Path(path).suffix.lower() == ".npy" else load_image(path)
    if given.ndim != 2:
        raise InputError(f"depth {path} has the shape {given.shape}; expected one number a pixel, (h, w)")
    if given.dtype == np.uint8:
        raise InputError(
            f"depth {path} has 8 bits a pixel: it is a picture to look at, not measurements; save it as 16-bit PNG in "
            "millimetres or as .npy in metres"
        )
    whole = np.issubdtype(given.dtype, np.integer)
    scale = unit if unit is not None else (MILLIMETRES if whole else 1.0)
    z = scale * given.astype(np.float64)
    z[~(np.isfinite(z) & (z > 0))] = np.nan
    return np.asarray(z)


def depth_files(given: Sequence[str | Path]) -> list[Path]:
    """Files of depth: pictures by name, folder or pattern, and NumPy's arrays. Raises: InputError for none there."""
    out: list[Path] = []
    for name in map(str, given):
        if not name.lower().endswith(".npy"):
            out += [Path(f) for f in expand([name])]
            continue
        path = Path(name)
        found = sorted(path.parent.glob(path.name)) if set("*?[") & set(path.name) else [path]
        if not found or not all(f.is_file() for f in found):
            raise InputError(f"there is no depth file {name}")
        out += found
    return out


def _array(path: Path) -> NDArray[Any]:
    try:
        found = np.lib.format.read_array(BytesIO(read_bytes(path, most=PICTURE, what="depth")), allow_pickle=False)
    except (ValueError, EOFError, OSError) as error:
        raise InputError(f"depth {path} is no NumPy array of numbers: {error}") from None
    if not isinstance(found, np.ndarray) or not np.issubdtype(found.dtype, np.number):
        raise InputError(f"depth {path} holds no array of numbers")
    return found
