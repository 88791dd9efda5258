"""Pictures and depth of files as a camera gives them: 8-bit BGR, and metres with NaN where there is none."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrant.detection.images.depth_files import read_depth
from calibrant.detection.images.images import load_image, to_bgr8

DEPTH_WORDS = ("depth",)
_DEPTHS = (".png", ".tif", ".tiff", ".npy", ".exr")


def read_colour(file: Path) -> NDArray[np.uint8]:
    """A picture's file, or a recording's frame. Raises: InputError as `load_image`."""
    return to_bgr8(load_image(file))


def read_metres(file: Path, unit: float | None) -> NDArray[np.float32]:
    """A depth file. Raises: InputError as `read_depth`."""
    return np.asarray(read_depth(file, unit=unit), dtype=np.float32)


def depth_beside(file: Path) -> Path | None:
    """The depth of a picture: name_depth.png, depth/name.png or name.npy; .tif and .npy as well."""
    for word in DEPTH_WORDS:
        for ending in _DEPTHS:
            for path in (
                file.with_name(f"{file.stem}_{word}{ending}"),
                file.with_name(f"{file.stem}-{word}{ending}"),
                file.parent / word / f"{file.stem}{ending}",
            ):
                if path.is_file():
                    return path
    plain = file.with_suffix(".npy")
    return plain if plain.is_file() else None


def colour_files(files: Sequence[Path]) -> list[Path]:
    """The pictures among the files of a folder: without the depth of others."""
    depths = {depth_beside(file) for file in files}
    return [file for file in files if file not in depths]
