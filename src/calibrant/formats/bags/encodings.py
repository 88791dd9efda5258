"""Pictures of messages as arrays: sensor_msgs/Image by its encoding, sensor_msgs/CompressedImage by its format.

Encodings as sensor_msgs/image_encodings.hpp names them (https://github.com/ros2/common_interfaces); colour comes out as
BGR, Bayer patterns are interpolated, 16 bits stay 16 bits.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrant.errors import InputError
from calibrant.formats.images.picture_bytes import damage, refuse_vast, require_picture
from calibrant.opencv import cv2

_PLAIN = {
    "mono8": ("u1", 1),
    "mono16": ("u2", 1),
    "bgr8": ("u1", 3),
    "rgb8": ("u1", 3),
    "bgra8": ("u1", 4),
    "rgba8": ("u1", 4),
    "bgr16": ("u2", 3),
    "rgb16": ("u2", 3),
    "bgra16": ("u2", 4),
    "rgba16": ("u2", 4),
}
_RED_FIRST = ("rgb8", "rgba8", "rgb16", "rgba16")
_BAYER = re.compile(r"bayer_(?P<order>rggb|bggr|gbrg|grbg)(?P<bits>8|16)")
_YUV = {"yuv422": "UYVY", "uyvy": "UYVY", "yuv422_yuy2": "YUY2", "yuyv": "YUY2"}
_GENERIC = re.compile(r"(?P<bits>8|16|32)(?P<kind>U|F)C(?P<channels>[134]?)")
"""OpenCV's own names: a type and channels without a meaning; 1 channel is grey, 3 or 4 are BGR, as OpenCV has them."""


def decoded_image(message: Any, where: str) -> NDArray[Any]:
    """A raw picture (h, w), or (h, w, 3 or 4) BGR. Raises: InputError naming `where` for an encoding that is not read,
    or bytes that are not as many as height and step say."""
    encoding = str(message.encoding)
    bayer, yuv = _BAYER.fullmatch(encoding), _YUV.get(encoding)
    if bayer is not None:
        kind, channels = ("u1" if bayer["bits"] == "8" else "u2"), 1
    elif yuv is not None:
        kind, channels = "u1", 2
    else:
        kind, channels = _plain(encoding, where)
    pixels = _pixels(message, kind, channels, where)
    if bayer is not None:
        return demosaiced(pixels, bayer["order"])
    if yuv is not None:
        return np.asarray(cv2.cvtColor(pixels, getattr(cv2, f"COLOR_YUV2BGR_{yuv}")))
    if encoding in _RED_FIRST:
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR if channels == 3 else cv2.COLOR_RGBA2BGRA))
    return pixels


def demosaiced(pixels: NDArray[Any], order: str) -> NDArray[Any]:
    """Colour (h, w, 3) BGR of a Bayer pattern. order: the colours of the first two pixels of the first two rows."""
    # OpenCV names the pattern by the second row's second and third pixel.
    named = {"rggb": "BG", "bggr": "RG", "gbrg": "GR", "grbg": "GB"}[order]
    return np.asarray(cv2.cvtColor(pixels, getattr(cv2, f"COLOR_Bayer{named}2BGR")))


def decoded_compressed(message: Any, where: str) -> NDArray[Any]:
    """A compressed picture, JPEG or PNG, as `decoded_image` gives it. Raises: InputError naming `where`."""
    form = str(message.format)
    if "compressedDepth" in form:
        raise InputError(f"{where}: the picture is compressed depth ({form}), which shows no board; name another topic")
    data = np.asarray(message.data, np.uint8)
    content = data.tobytes()
    require_picture(content, f"{where}: the picture ({form or 'no format given'})")
    problem = damage(content)
    if problem is not None:
        raise InputError(f"{where}: the picture ({form or 'no format given'}) is damaged: {problem}")
    try:
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        raise InputError(f"{where}: the picture cannot be decoded: {error.err}") from None
    except MemoryError:
        raise InputError(f"{where}: the picture is larger than this computer's memory") from None
    if image is None:
        raise InputError(f"{where}: the picture ({form or 'no format given'}, {data.size} bytes) is damaged")
    bayer = _BAYER.match(form)
    return demosaiced(image, bayer["order"]) if bayer is not None and image.ndim == 2 else np.asarray(image)


def _plain(encoding: str, where: str) -> tuple[str, int]:
    generic = _GENERIC.fullmatch(encoding)
    if encoding in _PLAIN:
        return _PLAIN[encoding]
    if generic is not None and not (generic["kind"] == "F") ^ (generic["bits"] == "32"):
        return f"{generic['kind'].lower()}{int(generic['bits']) // 8}", int(generic["channels"] or 1)
    raise InputError(
        f"{where}: the encoding {encoding!r} is not read; expected {', '.join(_PLAIN)}, bayer_rggb8 …, "
        f"{', '.join(_YUV)}, 8UC1 …: republish it as one of these (image_proc, image_transport)"
    )


def _pixels(message: Any, kind: str, channels: int, where: str) -> NDArray[Any]:
    """(h, w), or (h, w, channels), without the bytes that fill rows."""
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    height, width, step = int(message.height), int(message.width), int(message.step)
    row = width * channels * dtype.itemsize
    data = np.asarray(message.data, np.uint8)
    refuse_vast((width, height), data.size, f"{where}: the picture")
    step = step or row
    if height < 1 or width < 1 or step < row or data.size < step * (height - 1) + row:
        raise InputError(
            f"{where}: {data.size} bytes in rows of {step} are no {width}x{height} px of {message.encoding}; the "
            "message is damaged"
        )
    rows = np.lib.stride_tricks.as_strided(np.ascontiguousarray(data), (height, row), (step, 1))
    out = np.ascontiguousarray(rows).view(dtype).reshape(height, width, channels)
    out = out.astype(dtype.newbyteorder("="))  # a copy: a message is for reading only
    return out[..., 0] if channels == 1 else out
