"""Pictures and maps as files: their names, sizes and bytes, for tasks that write them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from calibrant.errors import InputError

JPEG_QUALITY = 98
"""Beyond it files grow and no grey level changes by more than the picture's noise."""
MAP_KINDS = (".npz", ".yml", ".yaml", ".yml.gz")


def size_of(text: str) -> tuple[int, int]:
    """Width and height of WxH. Raises: InputError for anything else."""
    found = re.fullmatch(r"(\d+)\s*[xX]\s*(\d+)(?:\s*px)?", text.strip())
    size = (int(found[1]), int(found[2])) if found else (0, 0)
    # cv2.remap counts pixels in 16 bits.
    if not all(1 <= n < 2**15 for n in size):
        raise InputError(f"--size takes WIDTHxHEIGHT in pixels, each 1 to 32767, such as 1280x960; got {text!r}")
    return size


def size_or_width(text: str, like: tuple[int, int]) -> tuple[int, int]:
    """Width and height of WxH, or of a width alone: then as high as pictures of size `like` are. Raises: InputError."""
    found = re.fullmatch(r"(\d+)(?:\s*px)?", text.strip())
    if found is None:
        return size_of(text)
    width = int(found[1])
    return size_of(f"{width}x{round(width * like[1] / like[0])}")


def picture_name(file: Path) -> str:
    """Name of the picture: the photo's; of a video's frame, both names; PNG where OpenCV does not write the format."""
    from calibrant.detection.images.files import frame_of
    from calibrant.opencv import cv2

    if frame_of(file) is not None:
        return f"{file.parent.stem}_{file.name}.png"
    return file.name if cv2.haveImageWriter(file.name) else f"{file.stem}.png"


def encoded(image: Any, target: Path) -> bytes:
    """The picture in the format of its name. Raises: InputError where that holds no such picture."""
    from calibrant.opencv import cv2

    jpeg = target.suffix.lower() in (".jpg", ".jpeg", ".jpe")
    try:
        ok, data = cv2.imencode(target.suffix, image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if jpeg else [])
    except cv2.error as error:
        raise InputError(f"cannot write {target} in its format: {error.err}") from None
    if not ok:
        raise InputError(f"cannot write {target}: OpenCV does not write such an image as {target.suffix}")
    return bytes(data)


def check_maps(path: Path | None) -> None:
    """Raises: InputError for a maps file whose name says no format."""
    if path is not None and not path.name.lower().endswith(MAP_KINDS):
        raise InputError(f"--maps {path}: the name says the format; expected {', '.join(MAP_KINDS)}")


def maps_bytes(path: Path, arrays: Mapping[str, Any]) -> bytes:
    """Maps for cv2.remap and matrices by name: NumPy's archive, or OpenCV's YAML by the path's name."""
    import gzip
    import io

    import numpy as np

    from calibrant.opencv import cv2

    if path.suffix.lower() == ".npz":
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **arrays)
        return buffer.getvalue()
    storage = cv2.FileStorage("maps.yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, value in arrays.items():
        storage.write(name, value)
    text = storage.releaseAndGetString().encode()
    return gzip.compress(text) if path.suffix.lower() == ".gz" else text
