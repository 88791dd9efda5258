"""Read images upright, in grey or as they are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.detection.images.files import frame_of
from calibrant.detection.images.recordings import source_of
from calibrant.errors import InputError
from calibrant.formats.images import header as image_header
from calibrant.formats.images.picture_bytes import damage, require_picture
from calibrant.opencv import cv2
from calibrant.reading.files import PICTURE, read_bytes

_SUN_RASTER = b"\x59\xa6\x6a\x95"


def load_grey(path: str | Path) -> NDArray[np.uint8]:
    """An image as grey levels (h, w), 8 bits, turned upright as its EXIF data say.

    Images of more than 8 bits are divided by the power of two that fits their brightest pixel into 8 bits, so that 10,
    12 and 14 bits in 16 keep their contrast.
    Raises: InputError when the file is missing, empty, cut off, damaged, animated, or no image.
    """
    path = Path(path)
    frame = frame_of(path)
    if frame is not None:
        return to_grey8(source_of(frame[0]).read_frame(*frame))
    data = _bytes_of(path)
    _refuse_damaged(path, data)
    image = _decoded_image(path, data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        # Colour in floating point, for one, has no grey form in the decoder.
        image = _decoded_image(path, data, cv2.IMREAD_UNCHANGED)
    return to_grey8(_upright(path, data, image))


def load_image(path: str | Path) -> NDArray[Any]:
    """An image as it is stored, (h, w) grey or (h, w, 3 or 4) BGR with alpha, 8, 16 or 32 bits, turned upright.

    Raises: as `load_grey`.
    """
    path = Path(path)
    frame = frame_of(path)
    if frame is not None:
        return source_of(frame[0]).read_frame(*frame)
    data = _bytes_of(path)
    _refuse_damaged(path, data)
    return _upright(path, data, _decoded_image(path, data, cv2.IMREAD_UNCHANGED))


def orientation_of(path: str | Path) -> int:
    """EXIF's orientation 1 to 8 of an image file, by which the other functions turn it; 1 for a recording's frame.

    Raises: InputError when the file cannot be read.
    """
    path = Path(path)
    return image_header.UPRIGHT if frame_of(path) is not None else image_header.orientation(_bytes_of(path))


def _bytes_of(path: Path) -> bytes:
    data = read_bytes(path, most=PICTURE, what="image")
    require_picture(data, f"image {path}")
    return data


def _refuse_damaged(path: Path, data: bytes) -> None:
    """Raises: InputError for a JPEG or PNG file whose bytes were changed: decoders still make a picture of it."""
    problem = damage(data)
    if problem is not None:
        raise InputError(f"image {path} is damaged ({problem}); copy it again from the camera, or leave it out")


def _decoded_image(path: Path, data: bytes, flags: int) -> NDArray[Any] | None:
    """The pixels, or None where the decoder has no such form. Raises: InputError for what it cannot read at all."""
    if image_header.is_heif(data):
        return _heif_image(path, data)
    if data[:4] == _SUN_RASTER:
        # OpenCV 4.13 and before give a grey raster without a palette as all black, except in colour.
        flags = cv2.IMREAD_COLOR
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise InputError(f"image {path} cannot be decoded: {error.err}") from None
    except MemoryError:
        raise InputError(f"image {path} is larger than this computer's memory") from None


def _heif_image(path: Path, data: bytes) -> NDArray[Any]:
    """BGR of a phone's HEIC picture, upright, by the optional decoder. Raises: InputError with the cure without it."""
    try:
        import pillow_heif
    except ImportError:
        raise InputError(
            f"image {path} is HEIC, a phone's format, which OpenCV does not read: pip install pillow-heif, or convert "
            "it to JPEG or PNG (heif-convert; on the phone: Settings, Camera, Formats, Most Compatible)"
        ) from None
    try:
        rgb = np.asarray(pillow_heif.read_heif(data))
    except (ValueError, RuntimeError, OSError, SyntaxError) as error:
        raise InputError(f"image {path} cannot be decoded: {error}") from None
    return np.ascontiguousarray(rgb[..., 2::-1]) if rgb.ndim == 3 else rgb


def _upright(path: Path, data: bytes, image: NDArray[Any] | None) -> NDArray[Any]:
    if image is None or image.size == 0:
        raise InputError(
            f"{path} is not an image that can be read (its {len(data)} bytes are damaged or another format)"
        )
    return image_header.turned(image, image_header.orientation(data))


def to_grey8(image: NDArray) -> NDArray[np.uint8]:
    """Grey levels (h, w) in 8 bits of an image (h, w) or (h, w, 3 or 4) in BGR, of any depth."""
    if image.ndim == 3:
        channels = image.shape[2]
        if channels == 1:
            image = image[..., 0]
        elif channels in (3, 4):
            image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY if channels == 3 else cv2.COLOR_BGRA2GRAY)
        else:
            raise InputError(f"an image of {channels} channels is neither grey nor colour")
    if image.ndim != 2:
        raise InputError(f"expected an image of shape (h, w) or (h, w, channels), got {image.shape}")
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    if image.dtype == np.bool_:
        return image.astype(np.uint8) * np.uint8(255)
    values = np.nan_to_num(image.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0)
    brightest = float(values.max(initial=0.0))
    if brightest <= 0:
        return np.zeros(image.shape, np.uint8)
    full = 2.0 ** np.ceil(np.log2(brightest + 1.0)) if np.issubdtype(image.dtype, np.integer) else brightest * 256 / 255
    return np.clip(np.rint(values * (256.0 / full)), 0, 255).astype(np.uint8)


def to_bgr8(image: NDArray[Any]) -> NDArray[np.uint8]:
    """(h, w, 3) of uint8 from (h, w) or (h, w, 3 or 4) of any depth; grey is grey in all three.

    Colours of more than 8 bits are divided by the power of two that fits the brightest of all into 8.
    """
    if image.ndim == 2:
        return np.asarray(cv2.cvtColor(to_grey8(image), cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    colour = np.ascontiguousarray(image[..., :3])
    if colour.dtype == np.uint8:
        return colour
    return to_grey8(colour.reshape(len(colour), -1)).reshape(colour.shape)
