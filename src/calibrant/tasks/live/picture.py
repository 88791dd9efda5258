"""A picture as sensor_msgs has it, in grey values: rows of bytes in one of the encodings of image_encodings.hpp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrant.errors import InputError

COMPRESSED = "compressed"
"""Of sensor_msgs/CompressedImage: JPEG or PNG."""
_CHANNELS = {"mono8": 1, "8uc1": 1, "bgr8": 3, "8uc3": 3, "rgb8": 3, "bgra8": 4, "8uc4": 4, "rgba8": 4}
_DEEP = ("mono16", "16uc1")
_BAYER = {"bayer_rggb8": "BG", "bayer_bggr8": "RG", "bayer_gbrg8": "GR", "bayer_grbg8": "GB"}
"""OpenCV names a pattern by its second row's second and third pixel."""
_MOST_PIXELS = 200_000_000


@dataclass(frozen=True, eq=False)
class Picture:
    """topic, stamp seconds, frame: the camera's optical one; data: rows of `step` bytes, or a compressed file."""

    topic: str
    stamp: float
    frame: str
    width: int
    height: int
    encoding: str
    step: int
    data: bytes
    big_endian: bool = False

    def grey(self) -> NDArray[np.uint8]:
        """(height, width). Raises: InputError for an encoding that is not known, or too few bytes."""
        from calibrant.detection.images.images import to_grey8
        from calibrant.opencv import cv2

        if self.encoding == COMPRESSED:
            found = cv2.imdecode(np.frombuffer(self.data, np.uint8), cv2.IMREAD_UNCHANGED) if self.data else None
            if found is None:
                raise InputError(f"{self.topic}: a compressed picture that is neither JPEG nor PNG")
            return to_grey8(found)
        name = self.encoding.lower()
        if name in _DEEP:
            return to_grey8(self._rows(">u2" if self.big_endian else "<u2", 1)[..., 0].astype(np.uint16))
        if name in _BAYER:
            code = getattr(cv2, f"COLOR_Bayer{_BAYER[name]}2GRAY")
            return np.asarray(cv2.cvtColor(np.ascontiguousarray(self._rows("u1", 1)[..., 0]), code))
        if name not in _CHANNELS:
            raise InputError(
                f"{self.topic}: pictures in {self.encoding}, expected {', '.join((*_CHANNELS, *_DEEP, *_BAYER))}"
            )
        rows = self._rows("u1", _CHANNELS[name])
        if rows.shape[2] == 1:
            return np.ascontiguousarray(rows[..., 0])
        code = cv2.COLOR_RGB2GRAY if name.startswith("rgb") else cv2.COLOR_BGR2GRAY
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(rows[..., :3]), code))

    def _rows(self, kind: str, channels: int) -> NDArray:
        """(height, width, channels)."""
        needed = self.width * channels * np.dtype(kind).itemsize
        if not (0 < self.width * self.height <= _MOST_PIXELS) or self.step < needed:
            raise InputError(f"{self.topic}: {self.width}x{self.height} px with {self.step} bytes a row")
        if len(self.data) < self.step * self.height:
            raise InputError(f"{self.topic}: {len(self.data)} bytes, expected {self.step * self.height}")
        rows = np.frombuffer(self.data, np.uint8, self.step * self.height).reshape(self.height, self.step)
        return rows[:, :needed].copy().view(kind).reshape(self.height, self.width, channels)
